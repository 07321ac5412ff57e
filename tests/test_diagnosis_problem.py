"""Residuals of many records: in threads, in their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import Barrier

import numpy as np

from mrdamp.diagnosis.hypotheses.terms import Settings
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.errors import InputError
from mrdamp.model.core import Array
from toy_rig import ToyRig, toy

SETTINGS: list[Settings] = [{"gain": 2.2}, {"gain": 2.2, "cubic": 0.3}]


@dataclass(frozen=True)
class Together(ToyRig):
    """A toy whose records are only simulated two at a time."""

    barrier: Barrier | None = None

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        if self.barrier is not None:
            self.barrier.wait(timeout=20)
        if record == 4 and "cubic" in settings[-1]:
            raise InputError("not this one")
        return super().simulate(settings, record)


def test_records_are_simulated_side_by_side_with_the_same_outcome() -> None:
    alone = Together(toy({}).records)
    both = replace(alone, threads=2, barrier=Barrier(2))
    one, two = Problem(alone), Problem(both)
    np.testing.assert_array_equal(two.of_settings(SETTINGS[:1]), one.of_settings(SETTINGS[:1]))
    assert two.runs == one.runs == len(alone.records)


def test_a_record_that_is_refused_is_so_in_threads_too() -> None:
    alone = Together(toy({}).records)
    one, two = Problem(alone).outputs(SETTINGS), Problem(replace(alone, threads=2)).outputs(SETTINGS)
    np.testing.assert_array_equal(two, one)
    assert np.isnan(one[1]).any()
    assert not np.isnan(one[0]).any()
