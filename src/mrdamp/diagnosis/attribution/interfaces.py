"""Localisation of a damper's gap by substituting measured signals at the measured interfaces.

The error of the simulated force is a sum of parts: the driver (command against measured current), the chain
from the current to the load cell, and the damper's own sensor (reading against load cell). Substituting a
measured signal removes one part. The Shapley share of a part in the mean square of the sum is its covariance
with the sum. Noise counts only in the sum: it is that of the damper's own sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mrdamp.diagnosis.attribution.shares import Measured
from mrdamp.diagnosis.constants import SAME_UNIT
from mrdamp.diagnosis.evidence.resample import SECONDS, draws, group_sums, interval
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import compared
from mrdamp.model import core
from mrdamp.model.core import Array

_STAGES = ("driver", "magnetics", "fluid", "mechanics", "mount", "sensor")
#: Number of stages before each measured channel.
_AT = {"command": 0, "current_A": 1, "reference_force_N": 5, "force_N": 6}
#: Effects of the driver stage, which are neutral where the measured current replaces its output.
_NO_DRIVER = ("driver_lag", "command_delay")


@dataclass(frozen=True)
class Parts:
    """Shares of the measured parts of a chain.

    found: the parts in the order of the chain; empty if no interface was measured or the gap does not exceed
    the noise. drawn (draws, parts): their shares in bootstrap draws of seconds.
    """

    found: tuple[Measured, ...]
    drawn: Array


def parts(rig: DamperRig, noise: float) -> Parts:
    """Shares of the nominal simulator's gap by part. noise (N): standard deviation of force_N's noise.

    Records are weighted by their gaps: each error is divided by the RMS of its force. A displacement that is
    measured with a delay belongs to the part from the current to the load cell, whose input it is.
    """
    none = Parts((), np.zeros((0, 0)))
    inner = [n for n in ("current_A", "reference_force_N") if all(n in r.channels for r in rig.records)]
    if not inner or "force_N" not in rig.channels:
        return none
    sums = []
    for k, record in enumerate(rig.records):
        errors, force = _errors(rig, k, inner)
        keep = compared(record.n, record.sample_time)
        size = float(np.mean(force[keep] ** 2)) * (keep.stop - keep.start)
        second = np.floor((record.time[keep] - record.time[keep][0]) / SECONDS).astype(int)
        # Covariances of the parts with the sum. The last term is the own sensor's noise, which belongs to no
        # part.
        whole = np.sum(errors, axis=0)[keep]
        columns = [*(e[keep] * whole for e in errors), np.full(len(second), noise**2)]
        sums.append(group_sums(np.column_stack(columns) / size, second))
    table = np.vstack(sums)
    table[:, -2] -= table[:, -1]
    drawn = draws(len(table)) @ table[:, :-1]
    shares = _shares(table[None, :, :-1].sum(axis=1))[0]
    if interval(drawn.sum(axis=1))[0] <= 0:
        return none  # no gap beyond the noise
    spread = _shares(drawn)
    ends = ("command", *inner, "force_N")
    found = []
    for k, (before, after) in enumerate(pairwise(ends)):
        stages = _STAGES[_AT[before] : _AT[after]]
        ends_of = interval(spread[:, k])
        found.append(Measured(f"{before} to {after}", stages, float(shares[k]), ends_of, _part_by(stages)))
    return Parts(tuple(found), spread)


def _errors(rig: DamperRig, record: int, inner: list[str]) -> tuple[list[Array], Array]:
    """Error (n,) N of each part in the order of the chain, and the force (n,) N of the damper's own sensor.
    """
    r = rig.records[record]
    force = r.channel("force_N")
    whole = rig.through(record, np.asarray(r.command), {})
    body, out = whole, []
    if "current_A" in inner:
        no_driver = {row.name: row.default or 0.0 for row in core.attributes() if row.group in _NO_DRIVER}
        body = rig.through(record, _in_command_unit(r.channel("current_A"), r.command), no_driver)
        out.append(whole["reference"] - body["reference"])
    if "reference_force_N" in inner:
        load = r.channel("reference_force_N")
        out += [body["reference"] - load, load + whole["force"] - whole["reference"] - force]
    else:
        out.append(body["reference"] + whole["force"] - whole["reference"] - force)
    return out, force


def _in_command_unit(current: Array, command: Array) -> Array:
    """The current (n,) in the unit of the command: unchanged, or scaled by the ratio of their sizes if the
    units differ."""
    size = float(command @ command)
    gain = float(current @ command) / size if size > 0 else 1.0
    return current if SAME_UNIT[0] < gain < SAME_UNIT[1] or not gain > 0 else current / gain


def _shares(sums: Array) -> Array:
    """Shares (draws, parts), adding up to 1; equal shares in a draw without a gap beyond the noise."""
    total = sums.sum(axis=1, keepdims=True)
    return np.where(total > 0, sums / np.where(total > 0, total, 1.0), 1 / sums.shape[1])


def _part_by(stages: tuple[str, ...]) -> str:
    """The channel that would separate these stages."""
    wanted = (("driver", "current_A"), ("sensor", "reference_force_N"))
    return " and ".join(name for stage, name in wanted if stage in stages and len(stages) > 1)
