"""Comparison of a frame's storeys and accelerometers with their balances; no law of the damper is needed.

With a wrong damper law, most causes change a free run as much as the law's error does. A storey's balance
contains the measured damper force instead of the law, and an accelerometer's balance contains no damper
force. A fault in these parts is therefore compared with noise alone. Its cause is the effect that reduces the
error to noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrdamp.diagnosis.channels.balances import BAND, Balances, has_damper
from mrdamp.diagnosis.channels.comparison import PASSES, Compared, best_cause, through_chain
from mrdamp.diagnosis.hypotheses.outside_storeys import ground_delay, shaken
from mrdamp.diagnosis.hypotheses.terms import Settings, Term
from mrdamp.model import core
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.sampling import lowpass
from mrdamp.structures import ShearFrame

#: Samples per period of the upper band limit.
_RATE = 5.0


@dataclass(frozen=True)
class Part:
    """A storey or an accelerometer.

    kind, place. noise: over the RMS of its output. at_fault: True if its error exceeds the noise.
    """

    kind: str
    place: int
    noise: float
    at_fault: bool


def compared_parts(
    s: ShearFrame, records: Sequence[Record], terms: Sequence[Term], parts: Sequence[Part]
) -> tuple[Compared, ...]:
    """Comparisons of the storeys together and of each faulty accelerometer, with the cause that explains the
    error, if any.

    terms: the frame's whole catalogue. If no effect explains the storeys' error, `after` gives the error with
    fitted structural parameters. If all accelerometers are faulty, the displacements or the ground channel
    are: then only a delay of these is fitted. Empty if the noise is unknown.
    """
    storeys = [p for p in parts if p.kind == "storey"]
    meters = [p for p in parts if p.kind == "accelerometer"]
    if not any(p.at_fault for p in parts) or not all(p.noise > 0 for p in (*storeys, *meters)):
        return ()
    found = [Balances.of(s, r) for r in records]
    if len(meters) > 1 and all(p.at_fault for p in meters):
        late = [*(t for t in terms if t.effect == "channel_shift"), ground_delay(records[0].sample_time)]
        return (_of_displacements(found, meters, late),)
    out = []
    if any(p.at_fault for p in storeys):
        inside = any(p.at_fault and has_damper(s, p.place) for p in storeys)
        own = [t for t in terms if t.stage == "structure"]
        if inside and sum(has_damper(s, p.place) for p in storeys) == 1:
            own += [t for t in terms if t.place is None and t.effect.startswith("sensor_")]
        out.append(_of_storeys(found, storeys, own))
    for p in meters:
        if p.at_fault:
            out.append(_of_accelerometer(found, p, [t for t in terms if t.stage == "sensor" and t.place == p.place]))
    return tuple(out)


#: Error and output (n,) of a part in one unit, with the settings of a cause.
Errors = Callable[[Balances, int, Settings], tuple[Array, Array]]


def _explained(
    channels: tuple[str, str], found: Sequence[Balances], parts: Sequence[Part], terms: Sequence[Term], errors: Errors
) -> Compared:
    """The cause that explains the errors of parts over their noise, together."""

    def residual(settings: Settings) -> Array:
        out = []
        for b in found:
            for p in parts:
                error, output = (x[b.kept] for x in errors(b, p.place, settings))
                out.append(_thinned(b, error) / (p.noise * np.sqrt(np.mean(output**2))))
        return np.concatenate(out)

    return best_cause(channels, terms, residual, float(np.mean([p.noise for p in parts])))


def _of_storeys(found: Sequence[Balances], parts: Sequence[Part], terms: Sequence[Term]) -> Compared:
    """All storeys together: a mass enters the balance of every storey below it."""

    def errors(b: Balances, j: int, settings: Settings) -> tuple[Array, Array]:
        return _storey(b, j, settings), b.shear[j]

    best = _explained(("storeys' drifts", "floors' accelerations"), found, parts, terms, errors)
    if best.cause is None:
        best = replace(best, after=best.noise * _left_by_numbers(found, parts))
    return best


def _left_by_numbers(found: Sequence[Balances], parts: Sequence[Part]) -> float:
    """RMS error of the storeys' balances over their noise with fitted masses, stiffnesses and damping."""
    floors = range(1, found[0].structure.storeys + 1)
    errors, columns = [], []
    for b in found:
        for p in parts:
            j = p.place
            scale = p.noise * np.sqrt(np.mean(b.shear[j][b.kept] ** 2))
            own = [b.drift[j], b.velocity(j)]
            table = [x if k == j else np.zeros(len(x)) for k in floors for x in own]
            table += [b.acceleration(k) if k >= j else np.zeros(len(b.ground)) for k in floors]
            errors.append(_thinned(b, b.storey_error(j)[b.kept]) / scale)
            columns.append(np.array([_thinned(b, x[b.kept]) for x in table]).T / scale)
    a, y = np.vstack(columns), np.concatenate(errors)
    size = np.linalg.norm(a, axis=0)
    a = a[:, size > 0] / size[size > 0]
    left = y - a @ np.linalg.lstsq(a, y, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


def _of_accelerometer(found: Sequence[Balances], part: Part, terms: Sequence[Term]) -> Compared:
    j = part.place

    def errors(b: Balances, j: int, settings: Settings) -> tuple[Array, Array]:
        return _through_sensor(b.moved[j], b.sample_time, settings) - b.read[j], b.moved[j]

    names = f"floor{j}_displacement_m", f"floor{j}_acceleration_m_s2"
    return _explained(names, found, [part], terms, errors)


def _of_displacements(found: Sequence[Balances], parts: Sequence[Part], terms: Sequence[Term]) -> Compared:
    """All accelerometers together, with a delay of the displacements or of the ground channel."""

    def errors(b: Balances, j: int, settings: Settings) -> tuple[Array, Array]:
        t = b.sample_time * np.arange(len(b.ground))
        relative = np.interp(t + settings.get("channel_shift_d", 0.0), t, b.moved[j] - b.ground)
        return shaken(settings, b.ground, b.sample_time) + relative - b.read[j], b.moved[j]

    return _explained(("floors' displacements", "floors' accelerations"), found, parts, terms, errors)


def _storey(b: Balances, storey: int, settings: Settings) -> Array:
    """(n,) N, band-passed error of a storey's balance with the settings of one cause."""
    own = {k.partition("@")[0]: v for k, v in settings.items() if k.endswith(f"@{storey}")}
    masses = {int(k.partition("@")[2]): v for k, v in settings.items() if k.startswith("floor_mass_dm@")}
    error = b.structural(storey) - b.shear[storey]
    if has_damper(b.structure, storey):
        assert b.force is not None
        sensor = {k: v for k, v in settings.items() if k.startswith("sensor_")}
        # Sensor reading of the force that closes the storey's balance.
        error = b.force + error if not sensor else b.force - _through_sensor(-error, b.sample_time, sensor)
    error = error + sum(dm * b.acceleration(k) for k, dm in masses.items() if k >= storey)
    if not own or "floor_mass_dm" in own:
        return np.asarray(error)
    v = b.velocity(storey)
    k, c = b.structure.stiffness[storey - 1], b.structure.damping[storey - 1]
    more = own.get("storey_stiffness_e", 0.0) * k * b.drift[storey] + own.get("storey_damping_e", 0.0) * c * v
    more += own.get("storey_damping_quadratic", 0.0) * np.abs(v) * v
    if "joint_friction_width" in own:
        more += own["joint_friction_coulomb"] * np.tanh(v / own["joint_friction_width"])
    elif "joint_friction_presliding" in own:
        more += _bristle(b.drift[storey], v, b.sample_time, own)
    return np.asarray(error + lowpass(more, b.sample_time, BAND))


def _bristle(x: Array, v: Array, dt: float, own: Settings) -> Array:
    """(n,) N, dry friction with presliding: the chain's seal friction without a damper."""
    seal = {
        "seal_friction_coulomb": own["joint_friction_coulomb"],
        "seal_friction_breakaway": 1.0,
        "seal_friction_presliding": own["joint_friction_presliding"],
    }
    return core.run("bingham", {**PASSES, "gas_spring_k": 0.0, **seal}, dt, x, v)["force"]


def _through_sensor(reading: Array, dt: float, settings: Settings) -> Array:
    """(n,) output of the chain's sensor stage for a reading; settings with or without a place."""
    plain = {k.partition("@")[0]: v for k, v in settings.items()}
    return through_chain(reading, dt, plain) if plain else reading


def _thinned(b: Balances, values: Array) -> Array:
    """Decimated samples, at the rate that the band needs."""
    return values[:: max(1, round(1 / (_RATE * BAND * b.sample_time)))]

