"""How long the runs of a comparison last: the same for every control period and for the run that ratios are over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from env_arguments import OWN
from mrdamp.compare.benches import bench_of
from mrdamp.control.replay import Replay
from mrdamp.model import Model
from mrdamp.motions import GroundMotion

#: Ends within a swing: the largest drifts come after it.
LATE = GroundMotion("late", 5e-3, np.linspace(0.0, 1.0, 101) ** 4)
NOTHING = Model(
    "bingham", {"c0a": 1e-9, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 1.0, "command_max": 1.0}
)


def late(structure: str) -> Any:
    if structure == OWN:
        return LATE
    load = bench_of(structure).unseen_loads()[0]
    return (
        replace(load, force=load.force[:100])
        if structure == "cable"
        else replace(load, height=load.height[:300])
    )


@pytest.mark.parametrize("structure", ["cable", "car", OWN])
def test_a_constant_command_has_one_score_at_every_period(structure: str) -> None:
    """Of a controller of its own period, and of all controllers by `period`; the same seconds by the same engine."""
    load, found = late(structure), []
    for own, period in (
        (5e-4, 5e-3),
        (1e-3, 5e-3),
        (2e-3, 5e-3),
        (5e-3, 5e-3),
        (2e-2, 5e-3),
        (1e-3, 1e-3),
        (2e-2, 2e-2),
    ):
        bench = bench_of(structure, engine="chain", period=period)
        kept = bench.driven(Replay([bench.command_max], own), load, 1.0)  # type: ignore[attr-defined]
        values = bench.values(kept, bench.run("uncontrolled", load, 1.0))
        found.append([values[m.key] for m in bench.measures if m.ratio])
    np.testing.assert_allclose(found, found[:1] * len(found), rtol=1e-5)


@pytest.mark.parametrize("period", [5e-4, 3e-3, 2e-2])
def test_a_damper_that_does_nothing_has_the_ratios_of_none(period: float) -> None:
    """At fine steps: a run's means and peaks are over the starts of steps, and this load ends where it is largest."""
    made: Any = bench_of(OWN, NOTHING, engine="chain")
    bench = replace(made, timestep=6.25e-5)
    values = bench.values(
        bench.driven(Replay([0.0], period), LATE, 1.0), bench.run("uncontrolled", LATE, 1.0)
    )
    assert [values["shaking"], values["bearings"]] == pytest.approx([1.0, 1.0], abs=1e-3)
