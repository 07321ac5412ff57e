"""One fit per constant command, and lines through the parameters."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.identify.by_command import constant_groups, identify_by_command
from mrdamp.pictures.identification import parameter_lines
from sine_records import bingham_record, grid, straight, viscous


def test_the_lines_are_those_of_the_damper() -> None:
    train = grid(straight, (0.0, 0.6, 1.2))
    held = [bingham_record("h", 0.006, 1.5, 0.9, viscous, straight, 99)]
    found = identify_by_command("bingham", train, held, starts=1)
    p = found.fit.model.parameters
    assert (p["fya"], p["fyb"]) == pytest.approx((40.0, 300.0), rel=0.03)
    assert (p["c0a"], p["c0b"]) == pytest.approx((400.0, 250.0), rel=0.06)
    assert found.fit.model.attributes["gas_spring_f0"] == pytest.approx(12.0, abs=0.5)
    assert found.fit.held_out_nrmse < 0.02
    lines = {line.parameter: line for line in found.lines}
    assert lines["fya"].commands == (0.0, 0.6, 1.2)
    assert lines["fya"].values == pytest.approx([40.0, 220.0, 400.0], rel=0.05)
    assert set(lines) == {"c0a", "fya"}
    assert [model.parameters["v_ref"] for _, model, _ in found.at] == [p["v_ref"]] * 3
    shown = [lines[name] for name in ("c0a", "fya")]
    fig = parameter_lines(
        [line.parameter for line in shown],
        ["N s/m", "N"],
        np.array(shown[0].commands),
        [np.array(line.values) for line in shown],
        [(line.zero, line.slope) for line in shown],
    )
    points = fig.axes[1].get_lines()[1]
    assert points.get_ydata() == pytest.approx(shown[1].values)


def test_records_with_a_varying_command_are_left_out() -> None:
    varying = bingham_record("v", 0.004, 2.0, np.repeat([0.0, 1.2], 500), viscous, straight, 5)
    groups = constant_groups([*grid(straight, (0.4, 0.8)), varying])
    assert [(u, len(records)) for u, records in groups] == [(0.4, 2), (0.8, 2)]
    with pytest.raises(InputError, match="need 2 constant commands; the records have 1"):
        identify_by_command("bingham", [*grid(straight, (0.4,)), varying])
