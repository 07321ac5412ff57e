"""The law of a frame's damper identified again on the frame's baseline; damper of `test_diagnosis_baseline_law`."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mrdamp.diagnosis.attribution import frame_damper as module
from mrdamp.diagnosis.attribution.frame_blocks import blocks
from mrdamp.diagnosis.attribution.frame_damper import frame_baseline_law
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.problem.baseline_law import BaselineLaw
from mrdamp.model import Effect, Model
from mrdamp.records import Record
from mrdamp.structures import ShearFrame
from test_diagnosis_baseline_law import DT, baseline, lines, records


def in_frame(record: Record) -> Record:
    """The damper's test as the first storey's motion, the damper mounted from floor 1 to the ground. Nothing in this
    module asks for the frame's own response."""
    channels = {
        "ground_acceleration_m_s2": 0.1 * np.sin(5 * DT * np.arange(record.n)),
        "command": record.command,
        "floor1_displacement_m": -np.asarray(record.displacement),
        "force_N": record.channel("force_N"),
    }
    return Record(record.name, None, DT, channels)


@cache
def case() -> Case:
    two = np.ones(2)
    structure = ShearFrame(100 * two, 5e5 * two, 100 * two, damper_between=(1, 0))
    model: Model = replace(
        lines(),
        rig="frame",
        structure=structure,
        effects=(*lines().effects, Effect("storey_stiffness", {"e": 0.02}, 2)),
    )
    tests, own = (tuple(in_frame(r) for r in some) for some in (records(), baseline()))
    return Case("frame", Path(), model, tests, (), own)


@cache
def found() -> BaselineLaw:
    again = frame_baseline_law(case(), blocks(case()))
    assert again is not None
    return again


@pytest.mark.slow
def test_the_law_of_a_frames_damper_is_found_on_its_baseline() -> None:
    again, one = found(), case()
    assert again.after < 0.5 * again.before
    assert again.given is one.model
    assert again.model.structure is one.model.structure
    assert [e.name for e in again.model.effects if e.place] == ["storey_stiffness"]
    error = [
        next(b for b in blocks(replace(one, model=m)) if b.kind == "damper").gap
        for m in (one.model, again.model)
    ]
    assert error[1] < 0.5 * error[0]


@pytest.mark.slow
def test_a_frame_without_a_baseline_or_a_damper_to_compare_keeps_its_law() -> None:
    one = case()
    assert frame_baseline_law(replace(one, baseline=()), blocks(one)) is None
    assert frame_baseline_law(one, [b for b in blocks(one) if b.kind != "damper"]) is None


def test_a_law_that_reaches_the_noise_is_not_identified_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("identified again")

    monkeypatch.setattr(module, "baseline_law", never)
    noisy = [replace(b, noise=b.gap) if b.kind == "damper" else b for b in blocks(case())]
    assert frame_baseline_law(case(), noisy) is None
