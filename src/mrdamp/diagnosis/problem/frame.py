"""The rig `frame`: a shear frame on a shaking table with one damper, accelerometers and displacement sensors.

Settings with a place have it after an `@`: `storey_stiffness_e@2`, `sensor_lag_tau@3`, and the structural
parameters `mass@1`, `stiffness@1`, `damping@1` (SI).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mrdamp.diagnosis.hypotheses.damper_effects import damper_terms, rms
from mrdamp.diagnosis.hypotheses.frame_effects import frame_terms, placed_effects, structure_coordinates
from mrdamp.diagnosis.hypotheses.nominal_effects import about_nominal, merged
from mrdamp.diagnosis.hypotheses.outside import command_rivals, commanded, grouped, inside_of
from mrdamp.diagnosis.hypotheses.outside_storeys import base_rivals, bent, shaken, storey_rivals
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Settings, Sizes, Term
from mrdamp.diagnosis.problem.command_memory import with_waves
from mrdamp.diagnosis.problem.designs import Envelope, Signal
from mrdamp.diagnosis.problem.rig import Simulator, own_noise
from mrdamp.errors import InputError
from mrdamp.model import Model, core
from mrdamp.model.core import Array, FrameInput
from mrdamp.model.damper import recorded
from mrdamp.records import Record
from mrdamp.records.log_filter import FACTOR, finer, jumps, logged, rings_before_jumps
from mrdamp.records.sampling import derivative
from mrdamp.structures import ShearFrame

#: s, inner step of the chain in a search and, unless a smaller one is needed, in the last fit; the frame's
#: step is half of it.
COARSE, FINE = 2e-3, 1e-3
#: s, longest step of a coarse run, and its largest multiple of the search's step.
_ROUGH, _ROUGHER = 4e-3, 4.0
#: Factor on the ranges of the nominal parameters relative to a damper's.
_WIDER = 2.0
#: Hz, range of the sines of a proposed test.
_BAND = 0.8, 16.0
#: How often a proposed test is scaled down, and to what share of what the records reach.
_SCALED, _WITHIN = 6, 0.95
#: Effects of the displacement channels.
_OF_MOTION = "channel_shift", "motion_lag"
_STRUCTURE = ("mass", "stiffness", "damping")


@dataclass(frozen=True, eq=False)
class FrameRig(Simulator):
    """Simulator and records of a frame case (see `mrdamp.diagnosis.problem.rig.Rig`).

    raw: the records as measured, which drive the simulator. block: number of samples averaged for the
    comparison, in measured and simulated channels alike: a frame moves below about 20 Hz, and noise is white.
    full_rate: records whose command jumps are compared without averaging, because a damper then oscillates
    with its floor near 100 Hz. clean: names of the blocks (`attribution.frame_blocks`) without a fault, where
    no cause is sought. sharp: those of them whose noise is so small that a sensor's fault would show. quiet: no
    block is known to be faulty, so that any fault is small; storeys are then searched as well, since resonance in
    a free run shows faults below the noise of a storey's balance. free_structure: the structural parameters are
    free together with the nominal ones. settled: as of a damper. placed: only causes with a place are sought.
    coarse_step: s, inner step of the chain in a search; jump_step: the same for records whose command
    jumps. threads: number of simulations in parallel. as_logged: all records are compared without averaging.
    """

    raw: tuple[Record, ...]
    block: int = 1
    clean: frozenset[str] = frozenset()
    sharp: frozenset[str] = frozenset()
    free_structure: bool = False
    settled: bool = False
    placed: bool = False
    quiet: bool = False
    coarse_step: float = COARSE
    jump_step: float = COARSE
    full_rate: bool = True
    threads: int = 1
    as_logged: bool = False

    @cached_property
    def records(self) -> tuple[Record, ...]:
        """The records at the rate of the comparison."""
        return tuple(averaged(r, block) for r, block in zip(self.raw, self._blocks, strict=True))

    @cached_property
    def _jumps(self) -> tuple[bool, ...]:
        return tuple(jumps(np.asarray(r.command)) for r in self.raw)

    @cached_property
    def _blocks(self) -> tuple[int, ...]:
        return tuple(1 if self.as_logged or (jump and self.full_rate) else self.block for jump in self._jumps)

    @cached_property
    def structure(self) -> ShearFrame:
        if self.nominal_model.structure is None:
            raise InputError(f"{self.nominal_model.name}: rig frame needs a structure")
        return self.nominal_model.structure

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Accelerations, then displacements of the floors from the ground up, then the force: channels of all
        records."""
        floors = range(1, self.structure.storeys + 1)
        names = [f"floor{j}_acceleration_m_s2" for j in floors] + [f"floor{j}_displacement_m" for j in floors]
        return tuple(c for c in (*names, "force_N") if all(c in r.channels for r in self.raw))

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the channels in the C entry."""
        return tuple(
            "force" if c == "force_N" else f"{c.split('_')[1]}_{c.split('_')[0].removeprefix('floor')}"
            for c in self.channels
        )

    @cached_property
    def _filtered(self) -> tuple[bool, ...]:
        """For each record, True if jumps of its command were filtered."""
        return tuple(not self.hold and rings_before_jumps(np.asarray(r.command)) for r in self.raw)

    @cached_property
    def _fine(self) -> tuple[tuple[Array, Array], ...]:
        """Interpolated ground acceleration and command of each record."""
        return tuple(
            finer(
                np.asarray(r.channel("ground_acceleration_m_s2")), np.asarray(r.command), filtered, self.hold
            )
            for r, filtered in zip(self.raw, self._filtered, strict=True)
        )

    def _driven(self, record: int, coarse: bool) -> tuple[int, Array, Array]:
        """Samples per sample of the record, ground acceleration and command that drive the simulator. For
        steps longer than a search's, inputs are interpolated only to resolve the ringing of a filter."""
        rough = coarse and self.coarse_step > COARSE and not self._filtered[record]
        if self.nominal_model.law == "narx" or rough:
            r = self.raw[record]
            return 1, np.asarray(r.channel("ground_acceleration_m_s2")), np.asarray(r.command)
        return FACTOR, *self._fine[record]

    @cached_property
    def _free_runs(self) -> list[dict[str, Array]]:
        """Free runs of the nominal simulator, one for each record."""
        return [self._run([{}], k, coarse=True)[0] for k in range(len(self.raw))]

    @cached_property
    def sizes(self) -> Sizes:
        """Ranges of the damper's variables in the nominal simulator's free runs."""
        runs = self._free_runs
        x, v, f = (np.concatenate([o[c] for o in runs]) for c in ("stroke", "stroke_velocity", "true"))
        steps = [r.sample_time / self._driven(k, True)[0] for k, r in enumerate(self.raw)]
        timed = list(zip(runs, steps, strict=True))
        heat = max(float(np.sum(np.abs(o["true"] * o["stroke_velocity"])) * dt) for o, dt in timed)
        return Sizes(
            force=rms(f) or 1.0,
            stroke=2 * rms(x),
            velocity=rms(v),
            acceleration=rms(np.concatenate([derivative(o["stroke_velocity"], dt) for o, dt in timed])),
            command=max(float(np.abs(r.command).max()) for r in self.raw) or 1.0,
            heat=heat,
            sample_time=max(r.sample_time for r in self.raw),
        )

    @cached_property
    def nominal(self) -> tuple[Coordinate, ...]:
        """The nominal parameters, then the structural ones if they are free."""
        # At small drifts a frame's response depends little on some parameters, which may then be far off.
        effects = () if self.settled else self.catalogue
        numbers = self.numbers(effects, self.records, _WIDER, lambda name: name != "n")
        return (*numbers, *(structure_coordinates(self.structure) if self.free_structure else ()))

    @cached_property
    def catalogue(self) -> tuple[Term, ...]:
        dampers = with_waves(damper_terms(self.sizes), self.raw)
        return (*frame_terms(self.structure, self.records, self.sizes), *dampers)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The catalogue without causes that clean blocks rule out.

        Of the damper only the force sensor can be ruled out, if the balance of its storeys with its reading
        closes within little noise. A frame's free run shows the damper's other effects better than its own block does.
        """
        low, high = sorted(self.structure.damper_between)
        inside = {f"storey {j}" for j in range(low + 1, high + 1)}
        meters = {f"accelerometer {j}" for j in range(1, self.structure.storeys + 1)}
        out = []
        for term in about_nominal(self.catalogue, self.nominal_model.effects):
            if term.effect in _OF_MOTION:
                at_fault = not meters & self.clean
            elif term.place is None:
                at_fault = term.stage != "sensor" or not inside & self.sharp
            elif term.stage == "sensor":
                at_fault = f"accelerometer {term.place}" not in self.sharp
            else:
                at_fault = self.quiet or f"storey {term.place}" not in self.clean
            if at_fault and (term.place is not None or not self.placed) and self._reads(term):
                out.append(term)
        return tuple(out)

    def _reads(self, term: Term) -> bool:
        """False for a fault of a channel that was not measured."""
        if term.effect in _OF_MOTION:
            return any("displacement" in c for c in self.channels)
        if term.stage != "sensor":
            return True
        return ("force_N" if term.place is None else f"floor{term.place}_acceleration_m_s2") in self.channels

    @cached_property
    def rivals(self) -> tuple[Term, ...]:
        """Causes outside the catalogue that act in faulty blocks."""
        floors = range(1, self.structure.storeys + 1)
        places = [j for j in floors if f"storey {j}" not in self.clean]
        x = np.hstack([[o[f"displacement_{j}"] for j in floors] for o in self._free_runs])
        drift = np.diff(x, axis=0, prepend=np.zeros((1, x.shape[1])))
        size, largest = np.sqrt(np.mean(drift**2, axis=1)), np.abs(drift).max(axis=1)
        commands = () if "damper" in self.clean else command_rivals(self.sizes)
        base = base_rivals(self.structure, self.sizes.sample_time) if places else ()
        return (*commands, *storey_rivals(self.structure, places, size, largest), *base)

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        r = self.raw[record]
        factor, _, fine = self._driven(record, coarse)

        def run(some: Sequence[Settings], command: Array) -> Array:
            runs = self._run(some, record, coarse=coarse, command=command)
            return np.array([[o[c] for c in self.columns] for o in runs])

        key = (record, factor, self._step(record, coarse))
        out = np.empty((len(settings), len(self.columns), len(fine)))
        for rows, command, added in self.commands(run, settings, np.asarray(r.command), fine, key):
            out[rows] = run([settings[k] for k in rows], command) + added
        if factor > 1:
            out = logged(out, self._filtered[record])
        late = [k for k, c in enumerate(self.columns) if c.startswith("displacement")]
        for row, setting in zip(out, settings, strict=True):
            for k in late:
                row[k] = recorded(row[k], r.sample_time, {**self.base, **setting})
        return block_means(out, self._blocks[record])

    def driven(self, record: int) -> Record:
        return self.raw[record]

    def compared(self, simulated: Mapping[str, Array], record: int) -> Array:
        return block_means(np.vstack([simulated[c] for c in self.channels]), self._blocks[record])

    def rougher(self, terms: Sequence[Term]) -> FrameRig | None:
        return self._rough

    @cached_property
    def _rough(self) -> FrameRig | None:
        steps = {name: getattr(self, name) for name in ("coarse_step", "jump_step")}
        longer = {name: min(_ROUGH, _ROUGHER * step) for name, step in steps.items()}
        return replace(self, **longer) if longer != steps else None

    def input_noise(self, settings: Settings, record: int) -> Array:
        return np.zeros(len(self.channels))  # the table's motion and the command are taken as exact

    @cached_property
    def noise_shares(self) -> Array:
        """The levels are those after averaging over `block` samples."""
        return own_noise(self.raw, self.channels) * np.sqrt(self.block / np.array(self._blocks))[:, None]

    @property
    def still(self) -> bool:
        return False  # a frame's causes outside its driver are told by its floors

    def conditions(self, record: int) -> dict[str, Array]:
        r, (low, high) = self.records[record], self.structure.damper_between
        stroke = self._floor(record, high) - self._floor(record, low)
        out = {
            "velocity (m/s)": derivative(stroke, r.sample_time),
            "displacement (m)": stroke,
            "command": np.asarray(r.command),
            "command rate (1/s)": derivative(r.command, r.sample_time),
        }
        for j in range(1, self.structure.storeys + 1):
            if (j - 1, j) != (low, high):
                out[f"drift of storey {j} (m)"] = self._floor(record, j) - self._floor(record, j - 1)
        ground = np.asarray(r.channel("ground_acceleration_m_s2"))
        return out | {"ground acceleration (m/s2)": ground}

    def model(self, settings: Mapping[str, float]) -> Model:
        return self.with_settings(settings, placed_effects(settings), structure=self._structure(settings))

    def _floor(self, record: int, floor: int) -> Array:
        """Measured displacement (n,) of a floor at the rate of the comparison; zeros if it was not measured.
        """
        r = self.records[record]
        return np.asarray(r.channels.get(f"floor{floor}_displacement_m", np.zeros(r.n)))

    @cached_property
    def envelope(self) -> Envelope:
        """Limits of the next test: the ground acceleration of the records."""
        ground = "ground_acceleration_m_s2"
        strongest = max(float(np.abs(r.channel(ground)).max()) for r in self.raw)
        return self.limits(ground, strongest, None, _BAND, self.raw)

    def admitted(self, signal: Signal, settings: Settings) -> Signal:
        """What the records reach is that of the nominal simulator on them."""
        floors = range(1, self.structure.storeys + 1)
        names = ("stroke", "stroke_velocity", *(f"acceleration_{j}" for j in floors))
        most = {name: max(float(np.abs(run[name]).max()) for run in self._free_runs) for name in names}
        for _ in range(_SCALED):
            (run,) = self._tried([settings], signal)
            over = max(float(np.abs(run[name]).max()) / (most[name] or 1.0) for name in names)
            if over <= 1:
                break
            signal = replace(signal, motion=signal.motion * (_WITHIN / over))
        return signal

    def try_signal(self, settings: Sequence[Settings], signal: Signal) -> Array:
        return np.array([[o[c] for c in self.columns] for o in self._tried(settings, signal)])

    def _tried(self, settings: Sequence[Settings], signal: Signal) -> list[dict[str, Array]]:
        channels = {"ground_acceleration_m_s2": signal.motion, "command": signal.command}
        record = Record("trial", None, self.sizes.sample_time, channels)
        trial = replace(self._rough or self, raw=(record,), block=1)
        return trial._run(settings, 0, coarse=True)

    def _run(
        self, settings: Sequence[Settings], record: int, *, coarse: bool, command: Array | None = None
    ) -> list[dict[str, Array]]:
        """Columns for each of the settings at the run's time steps. command: at these steps, in place of the
        record's."""
        factor, ground, own_command = self._driven(record, coarse)
        command = own_command if command is None else command
        sample_time = self.raw[record].sample_time / factor
        step = self._step(record, coarse)
        out: list[dict[str, Array]] = [{}] * len(settings)
        for outside, rows in grouped(settings):
            own = [inside_of(settings[k]) for k in rows]
            vectors = [
                core.vector(
                    self.nominal_model.law,
                    inside_of(self.base | {k: v for k, v in s.items() if "@" not in k}),
                )
                for s in own
            ]
            runs = core.run_frame_many(
                self.nominal_model.law,
                np.array(vectors),
                [bent(outside, self._frame(s)) for s in own],
                sample_time,
                shaken(outside, ground, sample_time),
                commanded(outside, command, sample_time),
                hold=self.hold,
                substep=step,
                threads=self.threads,
                narx=self.nominal_model.narx,
            )
            for k, run in zip(rows, runs, strict=True):
                out[k] = run
        return out

    def _step(self, record: int, coarse: bool) -> float:
        """s, inner step of the chain in a record."""
        jump = self._jumps[record]
        step = self.jump_step if jump else self.coarse_step
        return step if coarse else min(step / 2 if jump else step, FINE)

    def _structure(self, settings: Mapping[str, float]) -> ShearFrame:
        s = self.structure
        values = {kind: np.array(getattr(s, kind), dtype=np.float64) for kind in _STRUCTURE}
        for key, value in settings.items():
            kind, _, place = key.partition("@")
            if kind in _STRUCTURE:
                values[kind][int(place) - 1] = value
        return ShearFrame(values["mass"], values["stiffness"], values["damping"], s.damper_between)

    def _frame(self, settings: Settings) -> FrameInput:
        effects = merged(self.nominal_model.effects, placed_effects(settings))
        frame = self._structure(settings)
        return Model("bingham", _NO_DAMPER, tuple(e for e in effects if e.place), "frame", frame).frame


def block_means(values: Array, block: int) -> Array:
    """Means over blocks of samples: (..., n) -> (..., n // block)."""
    n = values.shape[-1] // block * block
    return np.asarray(values[..., :n].reshape(*values.shape[:-1], -1, block).mean(axis=-1))


def averaged(record: Record, block: int) -> Record:
    """A record of block means; unchanged for a block of 1."""
    if block == 1:
        return record
    channels = {name: block_means(np.asarray(x), block) for name, x in record.channels.items()}
    return Record(record.name, record.path, block * record.sample_time, channels, record.ignored)


#: `Model.frame` requires a law, on which the frame does not depend.
_NO_DAMPER = dict.fromkeys(("c0a", "c0b", "fya", "fyb", "v_ref"), 0.0)
