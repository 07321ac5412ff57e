"""The table of policies under noise of their sensors."""

from __future__ import annotations

from importlib import resources
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("torch")

from modules import TOOLS, loaded

SHIPPED = resources.files("mrdamp") / "data" / "policies" / "frame"


@pytest.fixture(scope="module")
def tool(monkeypatch_module: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch_module.syspath_prepend(str(TOOLS))
    return loaded(TOOLS / "policy_noise.py")


@pytest.fixture(scope="module")
def monkeypatch_module() -> object:
    with pytest.MonkeyPatch.context() as patch:
        yield patch


def test_peaks_are_those_of_training_and_grow_with_noise(
    tool: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twelve of the 84 motions: a policy is better than passive-on in the mean, less so under much noise."""
    policy = tool.Policy.read(str(SHIPPED / "adjoint" / "seed_0.json"))
    some = tool.reported_motions()[3::7]
    monkeypatch.setattr(tool, "reported_motions", lambda: some)
    clean, base = tool.peaks([policy], 0.0)
    noisy, same = tool.peaks([policy], 2e-3)
    assert clean.shape == (1, len(some), 2)
    np.testing.assert_array_equal(base, same)  # a constant command sees nothing
    assert clean.mean() < base.mean() - 0.02
    assert noisy.mean() > clean.mean() + 0.01


def test_what_cannot_be_evaluated(tool: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(SHIPPED / "adjoint" / "seed_0.json")
    with pytest.raises(SystemExit, match="2"):
        tool.main(["--noise", "-1", "--", file])
    assert "noise is [-1.0]" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        tool.main([file + ".none"])
    assert "policy_noise:" in capsys.readouterr().err
