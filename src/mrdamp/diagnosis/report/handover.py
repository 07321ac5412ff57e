"""The corrected simulator's MJCF as it is handed over, and a check that MuJoCo reproduces the diagnosis's simulation
with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from mrdamp.diagnosis.fits.final import AGREEMENT
from mrdamp.diagnosis.problem.residuals import squared_gap
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.simulation.mjcf import write_mjcf
from mrdamp.simulation.predict import as_logged, as_read, played

#: Number of records in the check, those whose command changes most.
_STEPPED = 3


@dataclass(frozen=True)
class Agreement:
    """One record, simulated by the C entry (as in the diagnosis) and with the written MJCF in MuJoCo.

    Gaps, channels pooled, and RMS difference of the two simulations, all relative to the RMS of the measurement.
    """

    record: str
    offline_gap: float
    mujoco_gap: float
    difference: float

    @property
    def within(self) -> bool:
        """True if the two gaps agree within 1 % of the RMS."""
        return abs(self.mujoco_gap - self.offline_gap) <= AGREEMENT

    def line(self) -> str:
        """Note for a disagreement."""
        gaps = f"{100 * self.mujoco_gap:.2f} % in MuJoCo, {100 * self.offline_gap:.2f} % offline"
        return f"MJCF stepped on {self.record}: the gap is {gaps}"


def hand_over(found: Diagnosis, records: Sequence[Record], folder: Path) -> Diagnosis:
    """Writes the corrected simulator's MJCF into a folder, steps it on three records and adds the result to
    the answer."""
    model = found.corrected
    chosen = sorted(records, key=lambda r: -float(np.std(r.command)))[:_STEPPED]
    try:
        write_mjcf(model, folder)
        rows = tuple(agreement(model, r) for r in chosen)
    except InputError as error:
        return replace(found, notes=(*found.notes, f"no MJCF of the corrected simulator: {error}"))
    off = [r.line() for r in rows if not r.within]
    return replace(found, stepped=tuple(asdict(r) for r in rows), notes=(*found.notes, *off))


def agreement(model: Model, record: Record) -> Agreement:
    """Both simulations of a record, over its measured channels. Raises InputError."""
    from mrdamp.simulation.stepping import drive_frame, drive_rig  # imports MuJoCo

    model = as_read(model, record)
    factor, sample_time, inputs = played(model, record)
    drive = drive_rig if model.rig == "damper" else drive_frame
    offline, stepped = (
        as_logged(model, record, factor, run(sample_time, inputs))
        for run in (model.simulate, lambda dt, given: drive(model, dt, given))
    )
    names = [name for name in offline if name in record.channels]

    def apart(one: Mapping[str, Array], other: Mapping[str, Array]) -> float:
        of = ((one[name], other[name], record.sample_time, record.channel(name)) for name in names)
        return float(np.sqrt(np.mean([squared_gap(*row) for row in of])))

    measured = {name: record.channel(name) for name in names}
    return Agreement(record.name, apart(offline, measured), apart(stepped, measured), apart(offline, stepped))
