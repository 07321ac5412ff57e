"""What a policy gains that is trained on with a part of the ground motion known."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from modules import TOOLS, loaded  # noqa: E402
from mrdamp.train.loads import reported_motions  # noqa: E402


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(TOOLS))
    found = loaded(TOOLS / "forecast_study.py")
    some = reported_motions()[4::14]  # one amplitude, that of the measured motions
    monkeypatch.setattr(found, "reported_motions", lambda: some)
    return found


def test_what_is_known_ahead_counts_for_nothing_before_it_is_learned(tool: ModuleType) -> None:
    quiet: list[float] = []
    one, _ = tool.trained(0, (), 1, lambda text, share: quiet.append(share))
    two, after = tool.trained(0, (0.0, 0.02), 1, lambda text, share: quiet.append(share))
    assert one.shape == (6, 2)
    assert quiet == [0.0, 0.0]
    np.testing.assert_allclose(two, one, rtol=1e-5)
    assert np.abs(after - two).max() > 1e-4
    assert 0.2 < one.mean() < 0.6


def test_what_cannot_be_known(tool: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    for ahead in ("-5", "soon"):
        with pytest.raises(SystemExit, match="2"):
            tool.main([f"--ahead={ahead}"])
        assert "forecast_study:" in capsys.readouterr().err
