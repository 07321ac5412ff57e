"""What a frame's measured channels say of its storeys and accelerometers without any law of the damper.

The forces on the floors above a storey are their masses times their measured accelerations; its drift and, where the
damper stands in it, the damper's measured force have to leave nothing of them. An accelerometer has to read what the
floor's displacement, differentiated twice, and the ground give.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.sampling import derivative, lowpass, second_derivative
from mrdamp.structures import ShearFrame

#: Hz, the band of all signals: what a frame does, and little of a displacement's noise.
BAND = 20.0
#: s at both ends of a record that do not count (filters, start states).
ENDS = 0.2


def has_damper(s: ShearFrame, storey: int) -> bool:
    """True where the damper stands in a storey (among others, where it spans more than one)."""
    low, high = sorted(s.damper_between)
    return low < storey <= high


@dataclass(frozen=True)
class Balances:
    """A record's signals in the band, (n,) each.

    By number of the storey or floor: drift (m), shear (N) that the floors above ask of the storey, moved (m/s2), the
    acceleration by displacement and ground, and read (m/s2), that by accelerometer. ground (m/s2); force (N) of the
    damper against the storeys that it stands in, by its sign. kept: the samples that count.
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
        """Of a record of the frame; storeys and floors whose channels are not there are left out."""
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
        sign = 1.0 if s.damper_between[1] > s.damper_between[0] else -1.0
        force = sign * lowpass(r.channel("force_N"), dt, BAND) if "force_N" in r.channels else None
        drift, shear = {}, {}
        for j in floors:
            above = range(j, s.storeys + 1)
            told = all(k in moved or k in read for k in above) and (force is not None or not has_damper(s, j))
            if not told or j not in x or j - 1 not in x:
                continue
            shear[j] = -sum((s.mass[k - 1] * _either(moved, read, k) for k in above), np.zeros(r.n))
            drift[j] = x[j] - x[j - 1]
        end = round(ENDS / dt)
        return cls(s, dt, drift, shear, moved, shaken, read, force, slice(end, r.n - end))

    def acceleration(self, floor: int) -> Array:
        """(n,) m/s2, of a floor above a storey that has a balance."""
        return _either(self.moved, self.read, floor)

    def velocity(self, storey: int) -> Array:
        """(n,) m/s, of the storey's drift."""
        return derivative(self.drift[storey], self.sample_time)

    def structural(self, storey: int) -> Array:
        """(n,) N, what the storey's own stiffness and damping carry."""
        k, c = self.structure.stiffness[storey - 1], self.structure.damping[storey - 1]
        return np.asarray(k * self.drift[storey] + c * self.velocity(storey))

    def storey_error(self, storey: int) -> Array:
        """(n,) N, what the storey and a damper in it carry less what the floors above ask of it."""
        own = self.structural(storey)
        if has_damper(self.structure, storey):
            assert self.force is not None
            own = own + self.force
        return np.asarray(own - self.shear[storey])

    def accelerometers(self) -> tuple[int, ...]:
        """Floors whose accelerometer can be compared."""
        return tuple(j for j in self.read if j in self.moved)


def _either(moved: Mapping[int, Array], read: Mapping[int, Array], floor: int) -> Array:
    """The displacements are the better accelerometers where both are there: a faulty reading stays out of it."""
    return moved[floor] if floor in moved else read[floor]
