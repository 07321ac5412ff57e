"""Inverses compared with each other on a rig: a damper with every effect of a real one, records of it to identify from,
the same motion and wanted force for all; and their page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrdamp.files import csv_text, write_atomic
from mrdamp.identify import Fit, identify
from mrdamp.inverse.baselines import Fixed, Inverse, Switching, command_range
from mrdamp.inverse.network import NetworkInverse, train_inverse
from mrdamp.inverse.tracking import STEP, LawInverse, RandomMotion, Track, random_level, rms, track
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.narx.data import counted
from mrdamp.parallel import Progress, silent
from mrdamp.pictures.damper import force_tracking
from mrdamp.records import Record, RecordSet
from mrdamp.records.csv_file import render
from mrdamp.report import Page

_FORCE_NOISE = 0.005  # standard deviations, of the RMS force, displacement and velocity
_MOTION_NOISE = 0.0005
_VELOCITY_NOISE = 0.002
_SECONDS = 4.0  # of runs that sizes and judgements come from
_RATE = 500.0  # Hz, of the records that are made


@dataclass(frozen=True)
class Sizes:
    """RMS force (N) under the largest command, displacement (m), velocity (m/s), acceleration (m/s2)."""

    force: float
    displacement: float
    velocity: float
    acceleration: float
    command: float

    @classmethod
    def of(cls, model: Model, motion: RandomMotion, command: float) -> Sizes:
        run = track(model, motion, np.zeros(round(_SECONDS / STEP)), Fixed(command))
        _, _, a = motion.sample(run.time)
        return cls(rms(run.force), rms(run.displacement), rms(run.velocity), rms(a), command)

    @property
    def noise(self) -> tuple[float, float, float]:
        """Standard deviations of what is measured of stroke (m), velocity (m/s) and force (N)."""
        return (
            _MOTION_NOISE * self.displacement, _VELOCITY_NOISE * self.velocity, _FORCE_NOISE * self.force,
        )  # fmt: skip


def with_effects_of_a_rig(model: Model, s: Sizes) -> Model:
    """The model with what a real rig adds, each by a few percent of its size; effects that it has stay as they are."""
    stiffness = s.force / s.displacement
    added = {
        "driver_lag": {"tau": 6e-3, "tau2": 1.5e-3},
        "command_delay": {"d": 2e-3},
        "saturation": {"i_s": 1.5 * s.command},
        "remanence": {"b": 0.03 * s.command, "d": 0.2 * s.command},
        # A minute at this size warms the fluid by 20 K.
        "heating": {"kappa": 0.004, "kappa_yield": 0.004, "capacity": 3 * s.force * s.velocity},
        "asymmetry": {"a": 0.03, "width": 0.05 * s.velocity},
        "shear_thinning": {"m": 0.9, "v_s": s.velocity},
        "trapped_gas": {"d": 0.1, "s_g": 0.1 * s.displacement},
        "gas_spring": {"k": 0.05 * stiffness, "f0": 0.02 * s.force},
        "seal_friction": {"coulomb": 0.03 * s.force, "breakaway": 1.3, "v_s": 0.05 * s.velocity,
                          "presliding": 0.01 * s.displacement},
        "moving_mass": {"m": 0.01 * s.force / s.acceleration},
        "mount_compliance": {"k": 20 * stiffness},
        "backlash": {"gap": 0.01 * s.displacement},
        "sensor_gain": {"g": 1.02},
        "sensor_offset": {"f": 0.01 * s.force},
        "sensor_leakage": {"tau": 20.0},
        "sensor_lag": {"tau": 5e-4},
    }  # fmt: skip
    if model.law == "narx":  # has no viscosity of its own
        del added["shear_thinning"], added["heating"]
    own = {effect.name: dict(effect.parameters) for effect in model.effects}
    effects = tuple(Effect(name, added.get(name, {}) | own.get(name, {})) for name in {**added, **own})
    return replace(model, effects=effects, name=f"{model.name} with effects of a rig")


def records_of(
    plant: Model, motion: RandomMotion, s: Sizes, *, count: int = 6, seconds: float = 12.0, seed: int = 0
) -> RecordSet:
    """Records of the damper with measurement noise: random motions of the same spectrum under random commands.

    Half of the commands are smooth with every level as likely, half are steps; every third record is held out.
    """
    seeds = np.random.SeedSequence(seed).spawn(count)
    made = []
    for k, child in enumerate(seeds):
        numbers = child.generate_state(4)
        t = np.arange(round(seconds * _RATE), dtype=np.float64) / _RATE
        x, v, a = replace(motion, seed=int(numbers[0])).sample(t)
        rng = np.random.default_rng(child)
        level = random_level(t, 8.0, int(numbers[1])) if k % 2 else _steps(t, rng)
        inputs = {
            "displacement_m": x,
            "velocity_m_s": v,
            "acceleration_m_s2": a,
            "command": s.command * level,
        }
        out = plant.simulate(1 / _RATE, inputs, hold=True)
        noise = rng.standard_normal((3, len(t))) * np.array(s.noise)[:, None]
        channels = {
            "displacement_m": x + noise[0], "velocity_m_s": v + noise[1], "command": inputs["command"],
            "force_N": out["force_N"] + noise[2],
        }  # fmt: skip
        made.append(Record(f"{'smooth' if k % 2 else 'steps'}_{k + 1}", None, 1 / _RATE, channels))
    validation = set(range(2, count, 3)) or {count - 1}
    return RecordSet(
        "made",
        tuple(r for k, r in enumerate(made) if k not in validation),
        tuple(r for k, r in enumerate(made) if k in validation),
    )


def _steps(t: Array, rng: np.random.Generator) -> Array:
    """Levels from 0 to 1 that hold for 20 to 300 ms."""
    ends = np.cumsum(rng.uniform(0.02, 0.3, round(t[-1] / 0.02) + 2))
    levels = np.clip(rng.uniform(-0.15, 1.15, len(ends)), 0.0, 1.0)
    return np.asarray(levels[np.searchsorted(ends, t)])


#: Kinds of wanted force: between what the least and the largest command would bring, or another random force cut off
#: at these two, as wanted by an optimal controller, independent of the damper's motion.
WANTED = ("between", "unrelated")
NETWORK_PERIOD = 2e-3  # s
_LEVEL_HZ = 2.0  # highest frequency of a wanted force
_UNRELATED = 0.4  # its RMS over that of the force under the largest command


@dataclass(frozen=True, eq=False)
class Trial:
    """Tracks by kind of wanted force, and what was tried.

    Attributes: tracks: kind -> one per inverse. plant: the controlled damper. model: of the law inverse, as assumed.
    network: the trained one. fit: where the model was identified for the trial. sizes: of the plant under the motion.
    """

    tracks: dict[str, tuple[Track, ...]]
    plant: Model
    model: Model
    network: NetworkInverse | None
    fit: Fit | None
    sizes: Sizes

    @property
    def columns(self) -> tuple[str, ...]:
        return (
            "inverse", "RMS error (N)", "of wanted (%)", "command path (ranges/s)", "mean command",
        )  # fmt: skip

    def rows(self, kind: str) -> list[tuple[str, float, float, float, float]]:
        return [
            (t.name, t.error, 100 * t.relative_error, t.switching(self.sizes.command), t.mean_command)
            for t in self.tracks[kind]
        ]


def trial(
    model: Model,
    *,
    plant: Model | None = None,
    records: RecordSet | None = None,
    law: str | None = None,
    network: NetworkInverse | bool = True,
    exact: bool = False,
    commands: tuple[float, float] | None = None,
    motion: RandomMotion | None = None,
    seconds: float = 20.0,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
) -> Trial:
    """Tracks random forces with every kind of inverse.

    model: the assumed model of the damper, for the law inverse. plant: the controlled damper; None: the model
    with the effects of a rig that it does not contain. records: measured ones, for `law` and the network; None: made
    of the plant, with noise. law: identified from the records in place of the model. network: a trained one, or
    whether to train one. exact: also an inverse of the plant itself. commands: range. motion: None: that of the
    records, or 3 mm RMS from 0.5 to 5 Hz. seconds: of each run. Raises InputError.
    """
    say = progress or silent
    low, high = command_range(model, commands)
    motion = motion or (RandomMotion(3e-3, 0.5, 5.0, seed) if records is None else motion_like(records, seed))
    sizes = Sizes.of(model, motion, high)
    plant = plant or with_effects_of_a_rig(model, sizes)
    fit = None
    if records is None and (law or network is True):
        say("making records of the damper", 0.0)
        records = records_of(plant, motion, sizes, seed=seed + 1)
    if law:
        assert records is not None
        fit = identify(
            law, records.train, records.validation, extras=("offset", "driver_lag"), starts=2, seed=seed,
            progress=lambda what, share: say(f"identifying: {what}", 0.3 * share),
        )  # fmt: skip
        model = fit.model
    net = None if isinstance(network, bool) else network
    if network is True:
        assert records is not None
        train, validation = (
            [counted(r, NETWORK_PERIOD) for r in part] for part in (records.train, records.validation)
        )
        net = train_inverse(
            train, validation, commands=(low, high), judge=tracking_judge(model, motion, low, high), seed=seed,
            workers=workers,
            progress=lambda what, share: say(f"network: {what}", 0.3 + 0.4 * share),
        )  # fmt: skip
    inverses: list[Inverse] = [
        Fixed(low, "constant, least"), Fixed(high, "constant, largest"), Switching(high),
        LawInverse(model, commands=(low, high)),
    ]  # fmt: skip
    if net is not None:
        inverses.append(net)
    if exact:
        inverses.append(LawInverse(plant, commands=(low, high), name="law inverse, exact"))
    shown = replace(motion, seed=seed + 100)  # none that a record has
    off, on = _passive(plant, shown, low, high, seconds)
    tracks: dict[str, tuple[Track, ...]] = {}
    for count, kind in enumerate(WANTED):
        wanted = wanted_force(kind, off, on, seed + 200)
        found = []
        for k, inverse in enumerate(inverses):
            say(f"tracking: {kind}, {inverse.name}", 0.7 + 0.15 * (count + k / len(inverses)))
            found.append(track(plant, shown, wanted, inverse, noise=sizes.noise, seed=seed + 300))
        tracks[kind] = tuple(found)
    return Trial(tracks, plant, model, net, fit, sizes)


def wanted_force(kind: str, off: Array, on: Array, seed: int) -> Array:
    """A random force (n,) N, a sample every `STEP`, within the reach of the passive forces off and on (n,)."""
    time = STEP * np.arange(len(off), dtype=np.float64)
    if kind == "between":
        return np.asarray(off + random_level(time, _LEVEL_HZ, seed) * (on - off))
    free, _, _ = RandomMotion(_UNRELATED * float(np.std(on)), 0.1 * _LEVEL_HZ, _LEVEL_HZ, seed).steady(time)
    return np.clip(free, np.minimum(off, on), np.maximum(off, on))


def motion_like(records: RecordSet, seed: int) -> RandomMotion:
    """A random motion with the RMS displacement and velocity of the training records."""
    x = float(np.mean([np.var(r.displacement) for r in records.train])) ** 0.5
    v = float(np.mean([np.mean(r.velocity() ** 2) for r in records.train])) ** 0.5
    # A flat spectrum from f / 10 to f has an RMS frequency of 0.61 f.
    top = v / x / (2 * np.pi) / 0.61
    return RandomMotion(x, 0.1 * top, top, seed)


def tracking_judge(
    model: Model, motion: RandomMotion, low: float, high: float
) -> Callable[[NetworkInverse], float]:
    """Judges inverses by their tracking of random forces in simulation, on the model: relative errors summed up.

    low, high: range of the command.
    """
    off, on = _passive(model, motion, low, high, _SECONDS)
    wanted = [wanted_force(kind, off, on, motion.seed) for kind in WANTED]
    return lambda inverse: sum(track(model, motion, w, inverse).relative_error for w in wanted)


def _passive(
    model: Model, motion: RandomMotion, low: float, high: float, seconds: float
) -> tuple[Array, Array]:
    """Forces (n,) N under the smallest and the largest command."""
    none = np.zeros(round(seconds / STEP))
    return track(model, motion, none, Fixed(low)).force, track(model, motion, none, Fixed(high)).force


_KINDS: Mapping[str, str] = {
    "between": "Wanted force between those of the least and the largest command",
    "unrelated": "Random wanted force, independent of the motion, clipped to the damper's range",
}


def write_page(result: Trial, out: Path, command_unit: str) -> Path:
    """Writes index.html, by kind of wanted force a table and the runs behind it, and network.json into a folder;
    returns the page."""
    out.mkdir(parents=True, exist_ok=True)
    between = result.tracks["between"]
    best, switching = min(between, key=lambda t: t.error), next(t for t in between if t.name == "on/off switching")
    summary = (
        f"Force tracking in MuJoCo over {between[0].time[-1]:.0f} s of random motion, of which figures leave out the "
        f"first {best.start:g} s: the least RMS error is {100 * best.relative_error:.1f} % of the wanted force "
        f"({best.name}), that of on/off switching {100 * switching.relative_error:.1f} %."
    )
    page = Page(f"Inverse models of {result.plant.name}", summary, footer="Made by `mrdamp inverse`.")
    for kind, heading in _KINDS.items():
        page.figure(
            heading,
            draw(result, kind, command_unit),
            "Section with the largest wanted force. " + _noise(result),
            "Wanted and true force over time, and the command, for each inverse.",
        )
        page.table("", result.columns, result.rows(kind))
        lines = [(row[0], *(f"{v:.6g}" for v in row[1:])) for row in result.rows(kind)]
        write_atomic(out / f"{kind}.csv", csv_text(result.columns, lines))
        write_atomic(out / f"{kind}_runs.csv.gz", render(_runs(result.tracks[kind]), 7))
    _models(page, result)
    if result.network:
        result.network.write(out / "network.json")
    path = out / "index.html"
    page.write(path)
    return path


def _runs(tracks: Sequence[Track]) -> dict[str, Array]:
    """Columns (n,): time, motion and wanted force, which all tracks share, then force and command of each."""
    one = tracks[0]
    columns = {"time_s": one.time, "displacement_m": one.displacement, "velocity_m_s": one.velocity}
    columns["wanted_force_N"] = one.wanted
    for t in tracks:
        name = t.name.replace(",", "")
        columns |= {f"force_N {name}": t.force, f"command {name}": t.command}
    return columns


def draw(result: Trial, kind: str, command_unit: str) -> Figure:
    """Tracks of one kind of wanted force, without the constant commands."""
    return force_tracking([t for t in result.tracks[kind] if not t.name.startswith("constant")], command_unit)


def _models(page: Page, result: Trial) -> None:
    effects = ", ".join(effect.name for effect in result.plant.effects) or "none"
    said = [f"Controlled damper: {result.plant.name}, law {result.plant.law}, effects: {effects}."]
    if result.fit:
        said.append(
            f"Law inverse: {result.model.law} identified from records, held-out free-run error "
            f"{result.fit.held_out_nrmse:.3f} of the force's standard deviation."
        )
    else:
        own = ", ".join(effect.name for effect in result.model.effects) or "none"
        said.append(f"Law inverse: {result.model.name}, law {result.model.law}, effects: {own}.")
    if result.network:
        said.append(f"Network inverse: {result.network.about}.")
    page.text("Models", said)


def _noise(result: Trial) -> str:
    x, v, f = result.sizes.noise
    return f"Measured with noise of {1e6 * x:.2g} um, {1e3 * v:.2g} mm/s and {f:.2g} N."
