"""The rig `damper`: a record's motion is imposed, the force is read by the damper's own sensor and a load
cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mrdamp.diagnosis.hypotheses.damper_effects import damper_terms, rms
from mrdamp.diagnosis.hypotheses.nominal_effects import about_nominal
from mrdamp.diagnosis.hypotheses.outside import (
    command_rivals,
    commanded,
    force_rivals,
    forced,
    grouped,
    inside_of,
    moved,
    read,
)
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Settings, Sizes, Term, near
from mrdamp.diagnosis.problem.command_memory import with_waves
from mrdamp.diagnosis.problem.designs import Envelope, Signal
from mrdamp.diagnosis.problem.excerpts import STEP, Lead, excerpts
from mrdamp.diagnosis.problem.residuals import Problem, compared
from mrdamp.diagnosis.problem.rig import STEADY, Simulator, own_noise
from mrdamp.model import Model, core
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.log_filter import FILTERED, LOGGER, logged, rings_before_jumps
from mrdamp.records.motion import slowness
from mrdamp.records.sampling import derivative
from mrdamp.records.smoothing import noise_level, smoothed
from mrdamp.records.upsampling import FineInputs as Fine
from mrdamp.records.upsampling import repaired_ends as repaired_ends
from mrdamp.records.upsampling import upsampled

_COLUMNS = {"force_N": "force", "reference_force_N": "reference"}
_NOISE_SEED = 20
#: Hz, range of the sines of a proposed test.
_BAND = 0.3, 10.0
#: s, steps of the chain: in a search, in a search for coarse runs or with an implicit stage (mount, gas), and
#: in the last fit.
_COARSE, _ROUGH, _FINE = 1e-3, 2e-3, 5e-4
#: The logged motion is used if it reduces the nominal simulator's error to below this share of that with a
#: smoothed motion.
_LOGGED = 0.9
#: Factor on the range of a parameter that may be further off.
_WIDER = 8.0


@dataclass(frozen=True)
class _Asked:
    """Settings under a record's inputs; pieces: substeps between its time steps."""

    settings: Sequence[Settings]
    inputs: Fine
    pieces: float = 1.0


@dataclass(frozen=True, eq=False)
class DamperRig(Simulator):
    """Simulator and records of a damper case (see `mrdamp.diagnosis.problem.rig.Rig`).

    rough: in a search the step is as long as with a mount, and a mount is solved once per step instead of
    twice. threads: number of simulations in parallel. wider: names of nominal parameters with a wider range.
    spans: ranges of the whole records if these are excerpts. step: s, of the chain in a search. as_logged:
    the motion is used with its noise, as `mrdamp predict` does. known: terms by name, with settings known
    from channels of one quantity; only small changes of these are fitted. settled: effects of the simulator are not
    free with its law, as a baseline shows them: what has changed may be one of them.
    """

    records: tuple[Record, ...]
    rough: bool = False
    threads: int = 1
    wider: frozenset[str] = frozenset()
    spans: Sizes | None = None
    step: float = _COARSE
    as_logged: bool = False
    known: Mapping[str, Settings] = field(default_factory=dict)
    leads: tuple[Lead, ...] = ()
    settled: bool = False

    @cached_property
    def channels(self) -> tuple[str, ...]:
        return tuple(c for c in _COLUMNS if all(c in r.channels for r in self.records))

    @cached_property
    def motions(self) -> tuple[Array, ...]:
        """Displacement (n,) m of each record."""
        repaired = (repaired_ends(np.asarray(r.displacement)) for r in self.records)
        return tuple(x if self.as_logged else smoothed(x) for x in repaired)

    def velocity(self, record: int) -> Array:
        """(n,) m/s, from the smoothed displacement."""
        return derivative(self.motions[record], self.records[record].sample_time)

    @cached_property
    def slow(self) -> float:
        """See `mrdamp.records.motion.slowness`."""
        return slowness((x, self.velocity(k)) for k, x in enumerate(self.motions))

    @cached_property
    def filtered(self) -> bool:
        """True if jumps of a command show that the log was filtered; all records have the same logger."""
        return not self.hold and any(rings_before_jumps(np.asarray(r.command)) for r in self.records)

    @cached_property
    def sizes(self) -> Sizes:
        """Ranges of the records."""
        if self.spans is not None:
            return self.spans
        force = [r.channel(self.channels[-1]) for r in self.records]
        v = [self.velocity(k) for k in range(len(self.records))]
        a = [derivative(v[k], r.sample_time) for k, r in enumerate(self.records)]
        return Sizes(
            force=rms(np.concatenate(force)),
            stroke=max(float(np.ptp(r.displacement)) for r in self.records) / 2,
            velocity=rms(np.concatenate(v)),
            acceleration=rms(np.concatenate(a)),
            command=max(float(np.abs(r.command).max()) for r in self.records) or 1.0,
            heat=max(self.heat),
            sample_time=max(r.sample_time for r in self.records),
        )

    @cached_property
    def heat(self) -> tuple[float, ...]:
        """J, dissipated in each record."""
        return tuple(
            float(np.sum(np.abs(r.channel(self.channels[-1]) * self.velocity(k))) * r.sample_time)
            for k, r in enumerate(self.records)
        )

    def searched(self) -> DamperRig:
        """The rig for a search: with excerpts of long records."""
        short = excerpts(self.records, self.heat, thinned=not self.as_logged, slow=self.slow)
        if short == self.records:
            return self
        leads = tuple(self._lead(k, one) for k, one in enumerate(short))
        step = _COARSE if self.as_logged else STEP
        return replace(self, records=short, spans=self.sizes, step=step, leads=leads)

    def _lead(self, record: int, excerpt: Record) -> Lead:
        """Simulation of a record by the nominal simulator up to its excerpt."""
        whole = self._fine(record, STEP)
        force = self._runs([_Asked([{}], whole)], ("force",))[0][0, 0]
        dt = self.records[record].sample_time
        first = round(float(excerpt.time[0] - self.records[record].time[0]) / dt)
        return Lead(force[: first + 1], dt)

    def with_motion(self) -> DamperRig:
        """The rig with the motion, smoothed or as logged, for which the nominal simulator's error is smaller.

        The parameters of a law that was identified with a logged motion depend on the noise in it: vibration
        makes a hysteresis yield earlier.
        """
        logged = replace(self, as_logged=True)
        costs = [float(np.sum(Problem(rig, coarse=True).nominal() ** 2)) for rig in (self, logged)]
        return logged if costs[1] < _LOGGED * costs[0] else self

    @cached_property
    def nominal(self) -> tuple[Coordinate, ...]:
        effects = () if self.settled else self._catalogue
        return self.numbers(effects, self.records, _WIDER, self.wider.__contains__)

    @cached_property
    def _catalogue(self) -> tuple[Term, ...]:
        return with_waves(damper_terms(self.sizes), self.records)

    @property
    def still(self) -> bool:
        return all(float(np.ptp(r.command)) <= STEADY * self.sizes.command for r in self.records)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        terms = about_nominal(self._catalogue, self.nominal_model.effects)
        return tuple(near(t, self.known[t.name]) if t.name in self.known else t for t in terms)

    @cached_property
    def rivals(self) -> tuple[Term, ...]:
        return (*command_rivals(self.sizes), *force_rivals(self.sizes))

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        return self.simulate_together(settings, [record], coarse=coarse)[0]

    def simulate_together(
        self, settings: Sequence[Settings], records: Sequence[int], *, coarse: bool = False
    ) -> list[Array]:
        mount = any(s.get("mount_compliance_k", 0) > 0 or s.get("backlash_gap", 0) > 0 for s in settings)
        solved = mount or any(s.get("trapped_gas_series", 0) > 0 for s in settings)
        # A filter needs samples between those of its log.
        longest = self.rough or (solved and not self.filtered)
        step = (_ROUGH if longest else self.step) if coarse else _FINE
        # The chain halves the step with a mount.
        pieces = 0.5 if coarse and mount and (self.rough or self.filtered) else 1.0
        asked: list[_Asked] = []
        places: list[tuple[int, list[int], Array | float]] = []
        for place, record in enumerate(records):
            fine = self._fine(record, step)

            def run(some: Sequence[Settings], command: Array, fine: Fine = fine) -> Array:
                return self._runs([_Asked(some, replace(fine, u=command), pieces)])[0]

            sent, key = np.asarray(self.records[record].command), (record, fine.factor, pieces)
            for rows, command, added in self.commands(run, settings, sent, fine.u, key):
                asked.append(_Asked([settings[k] for k in rows], replace(fine, u=command), pieces))
                places.append((place, rows, added))
        shape = len(settings), len(self.channels)
        out = [np.empty((*shape, self.records[record].n)) for record in records]
        for (place, rows, added), part in zip(places, self._runs(asked), strict=True):
            out[place][rows] = part + added
        if self.leads and "force_N" in self.channels:
            own = self.channels.index("force_N")
            for row, one in enumerate(settings):
                if one.get("sensor_leakage_tau", 0) > 0:
                    for record, made in zip(records, out, strict=True):
                        made[row, own] -= self.leads[record].leaked(one, self.records[record])
        return out

    def driven(self, record: int) -> Record:
        return self.records[record]

    def compared(self, simulated: Mapping[str, Array], record: int) -> Array:
        return np.vstack([simulated[c] for c in self.channels])

    def rougher(self, terms: Sequence[Term]) -> DamperRig | None:
        """The same rig with longer steps in a search. None if the records' samples are no further apart, or
        with a command delay: a fraction of a step matters at the jumps of the command."""
        longer = any(r.sample_time > 1.5 * _COARSE * self.slow for r in self.records)
        if any(t.stage == "mount" for t in terms):
            return self._rough
        return self._rough if longer and all(t.stage != "driver" for t in terms) else None

    @cached_property
    def _rough(self) -> DamperRig | None:
        return None if self.rough else replace(self, rough=True)

    def through(
        self, record: int, command: Array, settings: Settings, moved: Array | None = None
    ) -> dict[str, Array]:
        """Forces (n,) N of a record's motion with another command: `force` of the own sensor, and
        `reference`.

        moved: (n,) m, added to the motion.
        """
        x, dt = self.motions[record], self.records[record].sample_time
        x = x if moved is None else x + moved
        inputs = self._upsampled(x, command, dt, self._factor(dt, _COARSE))
        columns = ("force", "reference")
        out = self._runs([_Asked([settings], inputs)], columns)[0][0]
        return dict(zip(columns, out, strict=True))

    def _factor(self, sample_time: float, step: float) -> int:
        """Number of the chain's steps between samples, of about `step` (s) times the records' slowness."""
        return max(1, round(sample_time / (step * self.slow)))

    def _upsampled(self, x: Array, command: Array, sample_time: float, factor: int) -> Fine:
        return upsampled(x, command, sample_time, factor, filtered=self.filtered, hold=self.hold)

    def _fine(self, record: int, step: float) -> Fine:
        """A record's inputs at about this step (s), cached."""
        r = self.records[record]
        factor = self._factor(r.sample_time, step)
        if (record, factor) not in self._inputs:
            fine = self._upsampled(self.motions[record], r.command, r.sample_time, factor)
            self._inputs[record, factor] = fine
        return self._inputs[record, factor]

    @cached_property
    def _inputs(self) -> dict[tuple[int, int], Fine]:
        return {}

    def _runs(self, asked: Sequence[_Asked], columns: Sequence[str] = ()) -> list[Array]:
        """(sets, channels, n) of each."""
        law, names = self.nominal_model.law, columns or [_COLUMNS[c] for c in self.channels]
        out = [np.empty((len(one.settings), len(names), len(one.inputs.x))) for one in asked]
        parts, sets = [], []
        vectors: dict[int, Array] = {}  # one for the settings of all records

        def vector(one: Settings) -> Array:
            if id(one) not in vectors:
                vectors[id(one)] = core.vector(law, inside_of(self.base | one))
            return vectors[id(one)]

        for one, made in zip(asked, out, strict=True):
            dt, hold = one.inputs.sample_time, one.inputs.hold
            for outside, rows in grouped(one.settings):
                x, v, a = moved(outside, (one.inputs.x, one.inputs.v, one.inputs.a), dt)
                params = np.array([vector(one.settings[k]) for k in rows])
                command = commanded(outside, one.inputs.u, dt)
                sets.append(core.Sets(params, dt, x, command, v, a, hold, True, dt / one.pieces))
                parts.append((one, made, outside, rows, x, v))
        runs = core.run_records(law, sets, threads=self.threads, narx=self.nominal_model.narx, columns=names)
        for (one, made, outside, rows, x, v), run in zip(parts, runs, strict=True):
            run = forced(outside, run, x, v)
            for k, name in enumerate(names):
                made[rows, k] = read(outside, name, run[:, k], one.inputs.u)
        each = zip(out, asked, strict=True)
        return [np.ascontiguousarray(logged(made, one.inputs.filtered, one.inputs.factor)) for made, one in each]

    def input_noise(self, settings: Settings, record: int) -> Array:
        """(channels,) N: RMS force error due to the displacement noise that remains after smoothing."""
        r = self.records[record]
        level = noise_level(r.displacement)
        rng = np.random.default_rng(np.random.SeedSequence(_NOISE_SEED, spawn_key=(record,)))
        again = self.motions[record] + level * rng.standard_normal(r.n)
        again = again if self.as_logged else smoothed(again, level)
        inputs = self._fine(record, _COARSE)
        disturbed = self._upsampled(again, r.command, r.sample_time, inputs.factor)
        with_noise, without = self._runs([_Asked([settings], disturbed), _Asked([settings], inputs)])
        kept = (with_noise - without)[0][:, compared(r.n, r.sample_time)]
        return np.asarray(np.sqrt(np.mean(kept**2, axis=1)))

    @cached_property
    def envelope(self) -> Envelope:
        """Limits of the next test: the ranges of the records; the command from 0 to the simulator's limit."""
        v = max(float(np.quantile(np.abs(self.velocity(k)), 0.999)) for k in range(len(self.records)))
        return self.limits("displacement_m", self.sizes.stroke, v, _BAND, self.records)

    def admitted(self, signal: Signal, settings: Settings) -> Signal:
        return signal  # its motion is limited already

    def try_signal(self, settings: Sequence[Settings], signal: Signal) -> Array:
        factor = self._factor(self.sizes.sample_time, _ROUGH)
        inputs = upsampled(signal.motion, signal.command, self.sizes.sample_time, factor, hold=self.hold)
        return self._runs([_Asked(settings, inputs)])[0]

    @cached_property
    def noise_shares(self) -> Array:
        return own_noise(self.records, self.channels)

    def conditions(self, record: int) -> dict[str, Array]:
        r, v = self.records[record], self.velocity(record)
        return {
            "velocity (m/s)": v,
            "command": np.asarray(r.command),
            "command rate (1/s)": derivative(r.command, r.sample_time),
            "displacement (m)": self.motions[record],
            "acceleration (m/s2)": derivative(v, r.sample_time),
        }

    def model(self, settings: Mapping[str, float]) -> Model:
        found = self.with_settings(settings)
        return replace(found, extra={**found.extra, LOGGER: FILTERED}) if self.filtered else found
