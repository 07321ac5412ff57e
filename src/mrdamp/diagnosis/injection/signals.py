"""A record's motion and force without noise, for the injection of effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from mrdamp.diagnosis.hypotheses.damper_effects import rms
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.sampling import lowpass
from mrdamp.records.smoothing import smoothed

#: Cut-off of the derivatives as a share of half the sampling rate, zero-phase: faster parts come from the
#: interpolation.
_CUT = 0.35
#: Of the damper's own sensor and of the load cell.
FORCES = ("force_N", "reference_force_N")


@dataclass(frozen=True, eq=False)
class Signals:
    """Smooth motion and force of one record, (n,) each, SI units. Derivatives are those of the smoothed
    motion."""

    record: Record

    @cached_property
    def x(self) -> Array:
        """Displacement, m."""
        return smoothed(np.asarray(self.record.displacement))

    @cached_property
    def v(self) -> Array:
        """Velocity, m/s."""
        return self._derivative(1)

    @cached_property
    def a(self) -> Array:
        """Acceleration, m/s2."""
        return self._derivative(2)

    @cached_property
    def force(self) -> Array:
        """Force of the load cell if there is one, else of the damper's own sensor, N."""
        return smoothed(np.asarray(self.record.channel(next(c for c in FORCES[::-1] if c in self.record.channels))))

    def _derivative(self, order: int) -> Array:
        dt = self.record.sample_time
        spline = CubicSpline(self.record.time, lowpass(self.x, dt, _CUT * 0.5 / dt))
        return np.asarray(spline(self.record.time, order))


@dataclass(frozen=True)
class Scales:
    """Ranges of the records: RMS force without the preload (N), stroke amplitude (m), RMS velocity (m/s) and
    acceleration (m/s2), largest command (A or V), and the simulator's preload (N)."""

    force: float
    stroke: float
    velocity: float
    acceleration: float
    command: float
    preload: float

    @classmethod
    def of(cls, records: Sequence[Record], model: Model) -> Scales:
        preload = model.attributes.get("gas_spring_f0", 0.0) + model.attributes.get("sensor_offset_f", 0.0)
        found = [Signals(r) for r in records]
        return cls(
            rms(np.concatenate([s.force - preload for s in found])),
            max(float(np.ptp(r.displacement)) for r in records) / 2,
            rms(np.concatenate([s.v for s in found])),
            rms(np.concatenate([s.a for s in found])),
            max(float(np.abs(r.command).max()) for r in records),
            preload,
        )
