"""Balances of a frame's storeys and accelerometers from measured channels, without a law of the damper.

Storey: its drift force and, if the damper acts in it, the measured damper force must equal the inertia forces
of the floors above. Accelerometer: its reading must equal the twice-differentiated displacement of the floor
plus the ground's acceleration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.sampling import derivative, lowpass, second_derivative
from mrdamp.structures import ShearFrame

#: Hz, pass band of all signals: it contains the frame's motion and little of the noise of the displacements.
BAND = 20.0
#: s, excluded at both ends of a record (filters, initial states).
ENDS = 0.2


def has_damper(s: ShearFrame, storey: int) -> bool:
    """True if the damper acts in a storey (possibly one of several)."""
    low, high = sorted(s.damper_between)
    return low < storey <= high


def damper_sign(s: ShearFrame) -> float:
    """Of the damper's force and stroke: 1 if it goes from a floor to a higher one."""
    return 1.0 if s.damper_between[1] > s.damper_between[0] else -1.0


@dataclass(frozen=True)
class Balances:
    """A record's band-passed signals, (n,) each, by number of the storey or floor.

    drift (m). shear (N): inertia force of the floors above. moved (m/s2): acceleration from displacement and
    ground. read (m/s2): accelerometer. ground (m/s2). force (N): of the damper, signed as a load of its
    storeys. kept: samples within the record's trimmed range.
    """

    structure: ShearFrame
    sample_time: float
    drift: Mapping[int, Array]
    shear: Mapping[int, Array]
    moved: Mapping[int, Array]
    ground: Array
    read: Mapping[int, Array]
    force: Array | None
    kept: slice

    @classmethod
    def of(cls, s: ShearFrame, r: Record) -> Balances:
        """Balances of a record of the frame; without storeys and floors that lack a channel."""
        dt, ground = r.sample_time, np.asarray(r.channel("ground_acceleration_m_s2"))
        floors = range(1, s.storeys + 1)
        x = {0: np.zeros(r.n)}
        for j in floors:
            name = f"floor{j}_displacement_m"
            if name in r.channels:
                x[j] = lowpass(r.channel(name), dt, BAND)
        shaken = lowpass(ground, dt, BAND)
        moved = {j: shaken + second_derivative(x[j], dt) for j in x if j > 0}
        read = {
            j: lowpass(r.channel(f"floor{j}_acceleration_m_s2"), dt, BAND)
            for j in floors
            if f"floor{j}_acceleration_m_s2" in r.channels
        }
        force = damper_sign(s) * lowpass(r.channel("force_N"), dt, BAND) if "force_N" in r.channels else None
        drift, shear = {}, {}
        for j in floors:
            above = range(j, s.storeys + 1)
            complete = all(k in moved or k in read for k in above) and (force is not None or not has_damper(s, j))
            if not complete or j not in x or j - 1 not in x:
                continue
            shear[j] = -sum((s.mass[k - 1] * _either(moved, read, k) for k in above), np.zeros(r.n))
            drift[j] = x[j] - x[j - 1]
        end = round(ENDS / dt)
        return cls(s, dt, drift, shear, moved, shaken, read, force, slice(end, r.n - end))

    def acceleration(self, floor: int) -> Array:
        """(n,) m/s2, acceleration of a floor above a storey that has a balance."""
        return _either(self.moved, self.read, floor)

    def velocity(self, storey: int) -> Array:
        """(n,) m/s, velocity of the storey's drift."""
        return derivative(self.drift[storey], self.sample_time)

    def structural(self, storey: int) -> Array:
        """(n,) N, elastic and damping force of the storey."""
        k, c = self.structure.stiffness[storey - 1], self.structure.damping[storey - 1]
        return np.asarray(k * self.drift[storey] + c * self.velocity(storey))

    def storey_error(self, storey: int) -> Array:
        """(n,) N, storey force plus damper force minus the inertia force of the floors above."""
        own = self.structural(storey)
        if has_damper(self.structure, storey):
            assert self.force is not None
            own = own + self.force
        return np.asarray(own - self.shear[storey])

    def accelerometers(self) -> tuple[int, ...]:
        """Floors whose accelerometer can be compared."""
        return tuple(j for j in self.read if j in self.moved)


def _either(moved: Mapping[int, Array], read: Mapping[int, Array], floor: int) -> Array:
    """Acceleration by displacement if there is one: a faulty accelerometer then does not enter the balance.
    """
    return moved[floor] if floor in moved else read[floor]
