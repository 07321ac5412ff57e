"""Localisation of a frame's gap by substituting measured signals at every measured interface.

Three kinds of block lie between measured channels. Each is tested with measured inputs, independently of the
others:

- an accelerometer: its reading against the twice-differentiated displacement of the floor and the ground;
- a storey: its drift force against the inertia of the floors above and the damper's force;
- the damper: its force under the measured stroke and command.

The noise of each block is the difference of two runs of one test, or, if it is more, what the same processing makes
of the simulator's own channels with that noise: velocities from samples of a motion whose acceleration jumps are not
exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrdamp.diagnosis.attribution.shares import Intervals, Shares, intervals, of_total
from mrdamp.diagnosis.attribution.stage_evidence import StageEvidence
from mrdamp.diagnosis.attribution.stages import LAW_STAGE, stage_shares
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.balances import BAND, Balances, damper_sign
from mrdamp.diagnosis.constants import BLOCK_FAULT
from mrdamp.diagnosis.evidence.resample import SECONDS, draws, group_sums
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import STAGES
from mrdamp.model import Model, core
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.sampling import derivative, lowpass
from mrdamp.records.smoothing import noise_level, smoothed
from mrdamp.simulation.predict import free_run
from mrdamp.structures import ShearFrame

_STAGE = {"accelerometer": "sensor", "storey": "structure"}


@dataclass(frozen=True)
class Block:
    """A part of the rig between measured channels.

    kind: accelerometer, storey or damper; place: from 1 (damper: None). gap: RMS error over RMS output,
    records pooled; noise: the same for noise alone. drawn (draws,): squared gap in bootstrap draws of
    seconds.
    """

    kind: str
    place: int | None
    gap: float
    noise: float
    drawn: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def name(self) -> str:
        return self.kind if self.place is None else f"{self.kind} {self.place}"

    @property
    def clean(self) -> bool:
        """True if noise alone explains the gap."""
        return self.gap < BLOCK_FAULT * self.noise

    def excess(self, draw: int | None = None) -> float:
        """Mean square of the gap beyond the noise, perhaps in a bootstrap draw; 0 for a clean block."""
        square = self.gap**2 if draw is None else float(self.drawn[draw])
        return 0.0 if self.clean else max(square - self.noise**2, 0.0)


def blocks(case: Case) -> tuple[Block, ...]:
    """All blocks that the records' channels allow to test: from the ground up, the damper last."""
    model, structure = case.model, case.model.structure
    assert structure is not None
    errors = [_errors(model, structure, r) for r in case.records]
    own = [_errors(model, structure, _simulated(model, r, k)) for k, r in enumerate(case.records)]
    pairs = [(errors[k], _errors(model, structure, r)) for r, k in case.repeats if k is not None]
    out = []
    for kind, place in errors[0]:
        found, outputs = zip(*(e[kind, place] for e in errors), strict=True)
        sizes = [_mean_square(output) for output in outputs]
        gap = float(np.sqrt(np.mean([np.mean(e**2) / size for e, size in zip(found, sizes, strict=True)])))
        # Noise is equal in all records and does not scale with the signal.
        apart = [a[kind, place][0] - b[kind, place][0] for a, b in pairs]
        noise = np.mean([np.mean(d**2) / 2 for d in apart]) if apart else 0.0
        simulated = (e[kind, place] for e in own)
        made = float(np.mean([_mean_square(error) / _mean_square(output) for error, output in simulated]))
        level = float(np.sqrt(max(noise * np.mean([1 / size for size in sizes]), made)))
        rows = zip(found, case.records, sizes, strict=True)
        sums = np.concatenate([_by_second(e, r.sample_time) / (size, 1.0) for e, r, size in rows])
        drawn = draws(len(sums)) @ sums
        out.append(Block(kind, place or None, gap, level, drawn[:, 0] / drawn[:, 1]))
    return tuple(out)


def place_shares(found: Sequence[Block]) -> tuple[Shares, Intervals]:
    """Share of each block in the sum of excesses, adding up to 1, and 95 % intervals; all 0 and none if no block is
    faulty."""
    return _places(found), intervals([_places(found, draw) for draw in _draws(found)])


def shares_by_stage(
    search: Search,
    chosen: Fit,
    verdict: str,
    found: Sequence[Block],
    evidence: StageEvidence | None = None,
) -> tuple[Shares, Intervals]:
    """Shares of the gap by stage, adding up to 1, and their 95 % intervals; none if the shares follow by definition.

    With named effects: their parts in the change of the channels. With a cause outside the catalogue: its stage.
    Without either: the shares of the faulty blocks. The damper's share counts as fluid if its parameters are wrong. If
    its cause is unknown, it is divided by the evidence of its stages (`evidence`), which is drawn as the blocks are,
    or, without that, evenly.
    """
    if verdict == "effect" and chosen.hypothesis.terms:
        return stage_shares(search, chosen, verdict)
    nearest, _ = stage_shares(search, chosen, verdict)
    if search.looks_like is not None:
        return {s: nearest.get(s, 0.0) for s in STAGES}, {}

    def shares(draw: int | None = None) -> Shares:
        return _of_blocks(found, evidence.at(draw) if evidence else nearest, _places(found, draw))

    return shares(), intervals([shares(draw) for draw in _draws(found)])


def _places(found: Sequence[Block], draw: int | None = None) -> Shares:
    return of_total({b.name: b.excess(draw) for b in found})


def _draws(found: Sequence[Block]) -> range:
    """Bootstrap draws; none if no block is faulty."""
    return range(0 if all(b.clean for b in found) else len(found[0].drawn))


def _of_blocks(found: Sequence[Block], nearest: Shares, places: Shares) -> Shares:
    if not sum(places.values()) > 0:
        return {s: nearest.get(s, 0.0) for s in STAGES}
    damper = of_total({s: nearest.get(s, 0.0) for s in STAGES if s not in ("sensor", "structure")})
    damper = damper if sum(damper.values()) > 0 else {LAW_STAGE: 1.0}
    out = dict.fromkeys(STAGES, 0.0)
    for b in found:
        parts = damper if b.kind == "damper" else {_STAGE[b.kind]: 1.0}
        for s, part in parts.items():
            out[s] += part * places[b.name]
    return out


def _errors(model: Model, s: ShearFrame, r: Record) -> dict[tuple[str, int], tuple[Array, Array]]:
    """Error of each block (kind, place) and its output, (n,) each in one unit."""
    out: dict[tuple[str, int], tuple[Array, Array]] = {}
    found = Balances.of(s, r)
    dt, keep = r.sample_time, found.kept
    for j in found.accelerometers():
        out["accelerometer", j] = (found.read[j] - found.moved[j])[keep], found.moved[j][keep]
    for j in found.shear:
        out["storey", j] = found.storey_error(j)[keep], found.shear[j][keep]
    if {"force_N", *(f"floor{j}_displacement_m" for j in s.damper_between if j)} <= set(r.channels):
        x, v = stroke(r, s)
        answer = core.run(model.law, model.attributes, dt, x, v, u=r.command, narx=model.narx)["force"]
        force = lowpass(r.channel("force_N"), dt, BAND)
        out["damper", 0] = (lowpass(answer, dt, BAND) - force)[keep], force[keep]
    return out


def _simulated(model: Model, r: Record, seed: int) -> Record:
    """The record as the simulator would have been measured, with the white noise of the record's channels."""
    rng = np.random.default_rng(seed)
    run = free_run(model, r)
    noise = {name: noise_level(np.asarray(r.channel(name))) for name in run if name in r.channels}
    return r.with_channels({name: run[name] + noise[name] * rng.standard_normal(r.n) for name in noise})


def stroke(r: Record, s: ShearFrame) -> tuple[Array, Array]:
    """Displacement (m) and velocity (m/s) of the damper, (n,), in its sign convention.

    Displacements and accelerations are combined by frequency, with Wiener weights for white noise in both.
    """
    low, high = sorted(s.damper_between)
    sign = damper_sign(s)
    x = r.channel(f"floor{high}_displacement_m") - (r.channel(f"floor{low}_displacement_m") if low else 0.0)
    readings = [
        r.channels.get(f"floor{k}_acceleration_m_s2") if k else r.channel("ground_acceleration_m_s2")
        for k in (low, high)
    ]
    if readings[0] is None or readings[1] is None:
        smooth = smoothed(x)
        return sign * smooth, sign * derivative(smooth, r.sample_time)
    a = readings[1] - readings[0]
    n = 2 * r.n  # zero padding against wrap-around
    omega = 2 * np.pi * np.fft.rfftfreq(n, r.sample_time)
    ratio = (noise_level(x) / max(noise_level(a), 1e-12)) ** 2
    spectrum = (np.fft.rfft(x, n) - ratio * omega**2 * np.fft.rfft(a, n)) / (1 + ratio * omega**4)
    both = np.fft.irfft(spectrum, n), np.fft.irfft(1j * omega * spectrum, n)
    return sign * both[0][: r.n], sign * both[1][: r.n]


def _by_second(error: Array, sample_time: float) -> Array:
    """Contribution of each second to an error's mean square, and its share of the samples (seconds, 2).
    error: (n,)."""
    number = np.floor(sample_time * np.arange(len(error)) / SECONDS).astype(np.intp)
    return group_sums(np.column_stack([error**2, np.ones(len(error))]) / len(error), number)


def _mean_square(values: Array) -> float:
    return float(np.mean(values**2)) or 1.0
