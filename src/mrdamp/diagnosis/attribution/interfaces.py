"""Where in a damper's chain the gap sits: measured signals put in at the interfaces that were measured.

The error of the simulated force is a sum: what the driver adds (command against measured current), what lies between
the current and the load cell, and what the damper's own sensor adds to the load cell's reading. Substituting the
measured signal at an interface takes one of them out. The Shapley share of a part in the mean square of the sum is
then its covariance with the whole, and noise counts only where it is in the whole: that of the own sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.attribution.shares import Measured
from mrdamp.diagnosis.constants import SAME_UNIT
from mrdamp.diagnosis.evidence.resample import SECONDS, draws, group_sums, interval
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import END, SKIP
from mrdamp.model import core
from mrdamp.model.core import Array

_STAGES = ("driver", "magnetics", "fluid", "mechanics", "mount", "sensor")
#: What takes the driver out of the chain: the measured current is what comes out of it.
_NO_DRIVER = ("driver_lag", "command_delay")


@dataclass(frozen=True)
class Parts:
    """found: the chain's parts in order, none where no interface was measured or there is no gap beyond the noise;
    drawn (draws, parts): their shares with seconds of the records drawn again."""

    found: tuple[Measured, ...]
    drawn: Array

    @classmethod
    def none(cls) -> Parts:
        """Where no interface was measured."""
        return cls((), np.zeros((0, 0)))


def parts(rig: DamperRig, noise: float) -> Parts:
    """Shares of the nominal simulator's gap by part. noise (N): standard deviation of force_N's.

    Records count by their gaps: each error over the size of its force. A displacement read late belongs to the part
    between the current and the load cell, whose input it is.
    """
    inner = [n for n in ("current_A", "reference_force_N") if all(n in r.channels for r in rig.records)]
    if not inner or "force_N" not in rig.channels:
        return Parts.none()
    sums = []
    for k, record in enumerate(rig.records):
        errors, force = _errors(rig, k, inner)
        keep = slice(round(SKIP / record.sample_time), record.n - END)
        size = float(np.mean(force[keep] ** 2)) * (keep.stop - keep.start)
        second = np.floor((record.time[keep] - record.time[keep][0]) / SECONDS).astype(int)
        # A part's covariance with the whole, and last the own sensor's noise, which is no part's fault.
        whole = np.sum(errors, axis=0)[keep]
        columns = [*(e[keep] * whole for e in errors), np.full(len(second), noise**2)]
        sums.append(group_sums(np.column_stack(columns) / size, second))
    table = np.vstack(sums)
    table[:, -2] -= table[:, -1]
    drawn = draws(len(table)) @ table[:, :-1]
    shares = _shares(table[None, :, :-1].sum(axis=1))[0]
    if interval(drawn.sum(axis=1))[0] <= 0:
        return Parts.none()  # no more gap than noise: nothing to share
    spread = _shares(drawn)
    ends = ("command", *inner, "force_N")
    found = tuple(
        Measured(
            f"{before} to {after}",
            _between(before, after),
            float(share),
            interval(spread[:, k]),
            _part_by(_between(before, after)),
        )
        for k, (before, after, share) in enumerate(zip(ends, ends[1:], shares, strict=False))
    )
    return Parts(found, spread)


def _errors(rig: DamperRig, record: int, inner: list[str]) -> tuple[list[Array], Array]:
    """Error (n,) N of each part in the order of the chain, and the own sensor's force (n,) N."""
    r = rig.records[record]
    force = r.channel("force_N")
    whole = rig.through(record, np.asarray(r.command), {})
    body, out = whole, []
    if "current_A" in inner:
        body = rig.through(record, _in_command_unit(r.channel("current_A"), r.command), _no_driver())
        out.append(whole["reference"] - body["reference"])
    if "reference_force_N" in inner:
        load = r.channel("reference_force_N")
        out += [body["reference"] - load, load + whole["force"] - whole["reference"] - force]
    else:
        out.append(body["reference"] + whole["force"] - whole["reference"] - force)
    return out, force


def _in_command_unit(current: Array, command: Array) -> Array:
    """The current (n,) as a command: as it is, or where the command has another unit, by the ratio of their sizes."""
    size = float(command @ command)
    gain = float(current @ command) / size if size > 0 else 1.0
    return current if SAME_UNIT[0] < gain < SAME_UNIT[1] or not gain > 0 else current / gain


def _no_driver() -> dict[str, float]:
    return {row.name: row.default or 0.0 for row in core.attributes() if row.group in _NO_DRIVER}


def _shares(sums: Array) -> Array:
    """Shares (draws, parts), adding up to 1; equal ones in a draw without a gap beyond the noise."""
    total = sums.sum(axis=1, keepdims=True)
    return np.where(total > 0, sums / np.where(total > 0, total, 1.0), 1 / sums.shape[1])


def _between(before: str, after: str) -> tuple[str, ...]:
    first = {"command": 0, "current_A": 1, "reference_force_N": 5}[before]
    last = {"current_A": 1, "reference_force_N": 5, "force_N": 6}[after]
    return _STAGES[first:last]


def _part_by(stages: tuple[str, ...]) -> str:
    """The channel that would part the stages further."""
    wanted = (("driver", "current_A"), ("sensor", "reference_force_N"))
    return " and ".join(name for stage, name in wanted if stage in stages and len(stages) > 1)
