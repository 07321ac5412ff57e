"""A frame's damper alone: its measured stroke is imposed and its force compared with the measured one. Its law is
identified again on the baseline in this way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mrdamp.diagnosis.attribution.baseline_law import BaselineLaw, baseline_law, gap_of
from mrdamp.diagnosis.attribution.frame_blocks import Block, stroke
from mrdamp.diagnosis.attribution.stage_evidence import StageEvidence
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import INEXACT
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
from mrdamp.records import Record


def damper_evidence(case: Case, found: Sequence[Block]) -> StageEvidence | None:
    """Evidence of the stages of a frame's damper; its own force sensor is not a stage here.

    None if the damper's block is clean while others are faulty, or if its channels were not measured.
    """
    eligible = (b for b in found if b.kind == "damper" and (not b.clean or all(other.clean for other in found)))
    block = next(eligible, None)
    if block is None:
        return None
    rig = damper_alone(case)
    force = np.concatenate([r.channel("force_N") for r in rig.records])
    noise = block.noise * float(np.sqrt(np.mean(force**2)))
    return StageEvidence.of(Problem.thinned(rig, coarse=True), noise)


def frame_baseline_law(case: Case, found: Sequence[Block], threads: int = 1) -> BaselineLaw | None:
    """The law of a frame's damper identified again on the baseline (`baseline_law`), in the frame's simulator.

    None without baseline records, if the damper's motion or force was not measured, or if the given law reaches the
    noise there. found: the blocks of the case's records.
    """
    noise = next((b.noise for b in found if b.kind == "damper"), None)
    if not case.baseline or noise is None:
        return None
    alone, before = (replace(damper_alone(c), threads=threads) for c in (case, replace(case, records=case.baseline)))
    if gap_of(alone, alone.nominal_model, before.records) <= INEXACT**0.5 * noise:
        return None
    again = baseline_law(alone, before.records)
    if again is None:
        return None
    return replace(again, given=case.model, model=with_law(case.model, again.model))


def with_law(frame: Model, law: Model) -> Model:
    """The model of a frame with the law and the effects of a damper alone, and its own in the frame."""
    placed = tuple(e for e in frame.effects if e.place is not None)
    return replace(frame, law=law.law, parameters=law.parameters, effects=(*law.effects, *placed))


def damper_alone(case: Case) -> DamperRig:
    """The rig of a frame's damper with its measured stroke in the sign convention of the damper's
    displacement."""
    model, structure = case.model, case.model.structure
    assert structure is not None
    records = []
    for r in case.records:
        read = {name: np.asarray(r.channel(name)) for name in ("command", "force_N")}
        records.append(Record(r.name, None, r.sample_time, {"displacement_m": stroke(r, structure)[0], **read}))
    effects = tuple(e for e in model.effects if e.place is None)
    own = Model(model.law, model.parameters, effects, weights=model.weights, name=model.name, extra=model.extra)
    return DamperRig(own, tuple(records))
