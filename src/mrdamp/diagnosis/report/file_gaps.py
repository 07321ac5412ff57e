"""Gaps of the written files: every reported figure is computed again with the files."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.problem.baseline_law import BaselineLaw
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.residuals import Problem, compared
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.diagnosis.report.result import Diagnosis, step
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.predict import free_run

#: Largest difference between the gap of the fit and that of the file, as a share of the measurement's RMS.
AGREEMENT = 0.01


def with_file_gaps(
    found: Diagnosis, case: Case, problem: Problem, residual: Array, base: Array | None = None
) -> Diagnosis:
    """The answer with the gaps that `mrdamp predict` gives with case.json and corrected.json on the case's
    records.

    problem, residual (samples,): of the last fit, with the whole records. Its figures are compared with the
    files', and a note reports differences above AGREEMENT. The reported figures are always the files'. base:
    (channels,) gap of the nominal simulator on the rig's baseline, if there are such records.
    """
    nominal = predicted_gap(case.model, problem)
    corrected = predicted_gap(found.corrected, problem)
    notes = list(found.notes)
    fitted = problem.of_settings([{}])[0] if found.verdict == "none" else residual
    for name, file, inside in (
        ("nominal", nominal, problem.of_settings([{}])[0]),
        ("corrected", corrected, fitted),
    ):
        own = float(np.sqrt(np.mean(problem.gaps(inside) ** 2)))
        if abs(file - own) > AGREEMENT:
            notes.append(
                f"the {name} simulator has a gap of {100 * file:.1f} % by its file and {100 * own:.1f} % in the fit:"
                " the displacement's noise acts on the law; figures are the file's"
            )
    gap = replace(
        found.gap,
        nominal=nominal,
        corrected=corrected,
        left_out=found.gap.corrected,
        baseline=None if base is None else float(np.sqrt(np.mean(base**2))),
    )
    return replace(found, gap=gap, notes=tuple(notes))


def with_given(found: Diagnosis, again: BaselineLaw, problem: Problem) -> Diagnosis:
    """The answer of a search with the law identified again, with the given simulator in the first place: its gap,
    its bar and its residuals in the pictures. Where it predicts the records better than what was found, it is handed
    over.

    problem: of the last fit, with the whole records.
    """
    rig = problem.rig
    if isinstance(rig, DamperRig):
        own: Rig = DamperRig(again.given, rig.records).with_motion()
    else:
        assert isinstance(rig, FrameRig)
        own = replace(rig, nominal_model=again.given)
    given = Problem(own, problem.records, stride=problem.stride, coarse=problem.coarse, trust=problem.trust)
    residual = given.of_settings([{}])[0]
    bars = (step("nominal", given.gaps(residual)), replace(found.waterfall[0], name="law of the baseline"))
    alone: dict[str, Any] | None = {**again.to_dict(), "gap": found.gap.nominal}
    nominal = predicted_gap(again.given, problem)
    if nominal < found.gap.corrected:
        note = f"what was found leaves {100 * found.gap.corrected:.1f} %: the given simulator is handed over"
        gap = replace(found.gap, corrected=nominal, left_out=nominal)
        found, alone = replace(found, corrected=again.given, gap=gap, notes=(*found.notes, note)), None
    return replace(
        found,
        gap=replace(found.gap, nominal=nominal, baseline=again.given_gap),
        waterfall=(*bars, *found.waterfall[1:]),
        baseline_law=alone,
        pictures={**found.pictures, "nominal": residual / given.weights},
    )


def predicted_gap(model: Model, problem: Problem) -> float:
    """RMS error over the measurement's RMS, by the path of `mrdamp predict`; records and channels have equal
    weight."""
    rig = problem.rig
    squares = []
    for k in problem.records:
        try:
            channels = rig.compared(free_run(model, rig.driven(k)), k)
        except InputError:
            return float("nan")
        measured = rig.measured(k)
        keep = compared(rig.records[k].n, rig.records[k].sample_time)
        squares += [_square(one[keep], other[keep]) for one, other in zip(channels, measured, strict=True)]
    return float(np.sqrt(np.mean(squares)))


def _square(simulated: Array, measured: Array) -> float:
    return float(np.mean((simulated - measured) ** 2)) / (float(np.mean(measured**2)) or 1.0)
