"""The table of policies on the gap rig's frames: intervals, rows and what is refused."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from modules import TOOLS, loaded
from mrdamp.train.loads import by_motion


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    return loaded(TOOLS / "policy_robustness.py")


def test_an_interval_is_of_seeds_and_motions(tool: ModuleType) -> None:
    """Normal effects of 40 seeds and of 60 motions, seven amplitudes of which are alike: twice the mean's standard
    deviation on either side, and not that of 420 motions."""
    rng = np.random.default_rng(1)
    motions = np.repeat(0.4 * rng.standard_normal((1, 60)), 7, axis=1)
    table = 0.3 * rng.standard_normal((40, 1)) + motions + 1.0
    low, high = tool.interval(by_motion(table))
    assert low < table.mean() < high
    assert (high - low) / 4 == pytest.approx(np.hypot(0.3 / np.sqrt(40), 0.4 / np.sqrt(60)), rel=0.25)


def test_the_added_lag_is_seen_in_the_row_of_a_frame(
    tool: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    """A softer storey, one motion: without the lag the policy is worse than passive-on and than with it."""
    file = str(resources.files("mrdamp") / "data" / "policies" / "frame" / "learned" / "seed_1.json")
    found = []
    for options in ([], ["--as-trained"]):
        assert tool.main([*options, "--effects", "storey_stiffness@1", "--loads", "1", "--", file]) == 0
        row = capsys.readouterr().out.splitlines()[-1].split("|")
        assert row[1].strip() == "storey_stiffness@1"
        found.append((float(row[2]), float(row[3])))
    (base, matched), (again, alone) = found
    assert base == again
    assert alone > base + 0.02
    assert alone > matched + 0.02


def test_a_lag_of_the_sensor_that_is_told_is_seen_in_the_row(
    tool: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(resources.files("mrdamp") / "data" / "policies" / "frame" / "learned" / "seed_1.json")
    found = []
    for options in ([], ["--sensor-lag", "0.003"]):
        assert tool.main([*options, "--effects", "sensor_lag", "--loads", "1", "--", file]) == 0
        found.append(float(capsys.readouterr().out.splitlines()[-1].split("|")[3]))
    assert found[1] < found[0] - 0.01
    with pytest.raises(SystemExit, match="2"):
        tool.main(["--sensor-lag", "-1", file])
    assert "force sensor's lag is -1" in capsys.readouterr().err


def test_a_file_that_is_no_policy_is_refused_in_a_line(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "p.json"
    wrong.write_text("{}")
    with pytest.raises(SystemExit, match="2"):
        tool.main([str(wrong)])
    assert "not a policy" in capsys.readouterr().err
