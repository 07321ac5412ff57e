"""A quarter car on roads: one run, what is kept of it, what tuning tries; clairvoyant commands."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import expm

from mrdamp.compare.beam import WIDTHS, ToCome, judged, search, started
from mrdamp.compare.bench import ELECTRIC, UNCONTROLLED, Measure, PlantBench, PlantRun, require_periods
from mrdamp.control.told import knowledge
from mrdamp.envs.car import Car, car_damper, linear_run
from mrdamp.envs.frame_rows import PERIOD, CarChain
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.criteria import STATES, wk_sections
from mrdamp.simulation.roads import Road, bump, iso8608, read_road
from mrdamp.simulation.rows import ChainRows
from mrdamp.structures.lumped import QuarterCar

#: Class, speed (m/s) and seed of the roads; seeds from nine million on are for judging alone, at other speeds.
_UNSEEN = (
    ("A", 30.0, 9_000_201), ("B", 20.0, 9_000_202), ("B", 30.0, 9_000_203), ("C", 12.0, 9_000_204),
    ("C", 20.0, 9_000_205), ("C", 28.0, 9_000_206), ("D", 8.0, 9_000_207), ("D", 18.0, 9_000_208),
)  # fmt: skip
_DURATION = 12.0  # s
_MPC = "clipped-mpc"
_TUNED = {"best-constant": "constant"} | {
    f"{kind}-tuned": kind
    for kind in (
        "skyhook-switch", "skyhook", "groundhook", "hybrid", "add", "sh-add", "clipped-lq", "lq-tracking", _MPC,
    )
}  # fmt: skip


@dataclass(frozen=True)
class CarBench(PlantBench):
    """A quarter car with its damper. Raises InputError."""

    car: QuarterCar = field(default_factory=QuarterCar)
    model: Model = field(default_factory=car_damper, kw_only=True)

    reference: ClassVar[str] = "the linear suspension, a dashpot of .3 of critical"
    measures: ClassVar[tuple[Measure, ...]] = (
        Measure("comfort", "weighted acceleration", ratio=True),
        Measure("load_ratio", "dynamic tyre load", ratio=True),
        Measure("stroke", "RMS stroke", ratio=True),
        Measure("acceleration", "weighted acceleration (m/s2)"),
        Measure("load_share", "dynamic tyre load over static"),
        Measure("airborne", "without contact (%)"),
        Measure("peak_stroke", "peak stroke (m)"),
        *ELECTRIC,
        Measure("dissipated_energy", "dissipated (J)"),
    )
    headline: ClassVar[tuple[str, ...]] = (
        "comfort", "load_ratio", "stroke", "airborne", "mean_command", "switching_rate",
    )  # fmt: skip
    claimed: ClassVar[tuple[str, ...]] = ("comfort", "load_ratio", "mean_command")
    unseen_amplitudes: ClassVar[tuple[float, ...]] = (1.0,)
    #: The largest command makes the suspension nearly rigid: the way to a bound begins at none.
    base: ClassVar[str] = "passive-off"
    #: The trade-off that is tuned for, and one near comfort alone; its weights are a choice.
    bounds: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "clairvoyant": {"comfort": 0.5, "load_ratio": 0.5},
        "clairvoyant-comfort": {"comfort": 0.9, "load_ratio": 0.1},
    }

    @property
    def tuned(self) -> Mapping[str, str]:
        """Without clipped MPC where its solver is not installed."""
        solver = importlib.util.find_spec("osqp") is not None
        return {name: kind for name, kind in _TUNED.items() if kind != _MPC or solver}

    @property
    def default(self) -> tuple[str, ...]:
        return "passive-off", "passive-on", *self.tuned

    @cached_property
    def structure(self) -> Car:
        return Car(self.car, self.model)

    def uncontrolled(self, load: Road) -> dict[str, Any]:
        require_periods(load, self.period)
        time = np.arange(0.0, load.duration, self.timestep)
        square = [float(np.mean(x * x)) for x in linear_run(self.car, load.at(time), self.timestep)]
        return dict(zip(PERIOD[:3], square, strict=True))

    def kept(self, run: PlantRun) -> dict[str, Any]:
        mean = dict(zip(PERIOD, run.of_period.mean(axis=0).tolist(), strict=True))
        return {
            **{key: mean[key] for key in ("comfort", "load", "stroke", "airborne")},
            "peak_stroke": float(run.of_period[:, PERIOD.index("stroke_peak")].max()),
            "dissipated_energy": float(run.of_period[:, PERIOD.index("energy")].sum()),
        }

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        ratios = {key: math.sqrt(kept[key] / uncontrolled[key]) for key in PERIOD[:3]}
        own = {"acceleration": math.sqrt(kept["comfort"]), "load_share": math.sqrt(kept["load"])}
        own["load_ratio"] = ratios.pop("load")
        return {**kept, **own, **ratios, "airborne": 100 * kept["airborne"]}

    def effort(self, kind: str) -> tuple[int, int]:
        """Every class of roads is among the loads; inverse models are slow."""
        quick = kind in ("constant", "skyhook-switch", "add", "sh-add", "clipped-lq")
        return 7, 3_000_000 if quick else 1_000_000

    def unseen_loads(self) -> tuple[Road, ...]:
        drawn = (iso8608(road_class, speed, _DURATION, seed) for road_class, speed, seed in _UNSEEN)
        return (*drawn, bump(0.08, 1.0, 6.0), bump(0.05, 4.0, 20.0))

    def read(self, files: Sequence[Path], speed: float) -> list[Road]:
        roads = [read_road(file, speed).at_speed(speed) for file in files]
        for file, road in zip(files, roads, strict=True):
            if not np.ptp(road.height) > 0:
                raise InputError(f"{file}: the road is flat throughout; there is nothing to control")
        return roads

    def own_identity(self) -> list[Any]:
        return [asdict(self.car), self.model.to_dict()["model"], self.period, self.timestep]

    def about(self) -> str:
        c = self.car
        return (
            f"{self.model.name} in a quarter car of {c.body:g} and {c.wheel:g} kg, control period "
            f"{1e3 * self.period:g} ms; ratios are over {self.reference}; {knowledge(self.model)}"
        )

    def clairvoyant(self, starts: Mapping[str, Sequence[str]], load: Road, amplitude: float) -> dict[str, Any]:
        """As of every bench.

        A bound's weights are of ratios of RMS values, a beam's cost is a sum of squares: it is that of the slopes at
        the ratios that were found before.
        """
        scaled, linear = load.scaled(amplitude), self.run(UNCONTROLLED, load, amplitude)
        rows = partial(started, self, CarChain, _STEP, scaled)
        first = rows(1)
        periods, levels = int(first.steps[0]), self.command_max * np.array(_LEVELS)
        pushes = first.pushes(scaled)

        def ratios(commands: Array) -> dict[str, float]:
            plants, total = rows(1).plants, np.zeros(len(PERIOD))
            for command in commands:
                total += plants.advance(np.array([[command]]))[0][0]
            return {key: math.sqrt(total[k] / periods / linear[PERIOD[k]]) for key, k in _COLUMNS.items()}

        def beam(width: int, dashpot: float, slopes: Mapping[str, float]) -> Array:
            to_come = car_to_come(self.car, pushes, first.plants.inner, periods, slopes, dashpot)

            def cost(plants: ChainRows) -> Array:
                return np.asarray(sum(s * plants.criteria[:, _COLUMNS[key]] for key, s in slopes.items()))

            return search(lambda n: rows(n).plants, periods, levels, cost, to_come, (width,)).commands

        out = {}
        for name, weights in self.bounds.items():
            found: list[tuple[float, dict[str, float], float, Array]] = []
            dashpots: tuple[float, ...] = _DASHPOTS
            values: list[float] = []
            for width in WIDTHS:
                at = found[0][1] if found else dict.fromkeys(weights, 1.0)
                slopes = {key: w / (2 * at[key] * linear[PERIOD[_COLUMNS[key]]]) for key, w in weights.items()}
                for dashpot in dashpots:
                    commands = beam(width, dashpot, slopes)
                    reached = ratios(commands)
                    value = sum(w * reached[key] for key, w in weights.items())
                    found.append((value, reached, dashpot, commands))
                found.sort(key=lambda one: one[0])
                values.append(found[0][0])
                dashpots = (found[0][2],)
            out[name] = judged(self, name, starts[name][0], load, amplitude, found[0][3], values)
        return out


_STEP = 1e-3  # s, of the chain at most
#: Dashpots of the estimate of what is to come, over the critical one. The narrowest beam tries all of them, the wider
#: ones go on with the best. On three to five validation roads .35 is better than .1, .2 and .5 for both criteria, and
#: .25 than .35 for comfort.
_DASHPOTS = (0.15, 0.25, 0.35)
#: Commands over the largest: fine where the damper is near a passive suspension's. Other ones were not tried.
_LEVELS = (0.0, 0.025, 0.05, 0.1, 0.2, 0.4, 1.0)
_COLUMNS = {"comfort": PERIOD.index("comfort"), "load_ratio": PERIOD.index("load")}


def car_to_come(
    car: QuarterCar, pushes: Array, inner: int, periods: int, slopes: Mapping[str, float], dashpot: float
) -> ToCome:
    """Of the car with a dashpot in the damper's place and a tyre that holds contact, on the road.

    pushes: (steps,) of the road's acceleration, m/s2, means over the chain's steps; inner: steps a period; slopes: of
    the period's means, `comfort` and `load_ratio`; dashpot: over the critical one.
    """
    a, b, out = weighted_car(car, dashpot * car.critical_damping, _STEP)
    cost = sum(s / inner * np.outer(out[key], out[key]) for key, s in slopes.items())

    def states(plants: ChainRows) -> Array:
        return np.concatenate([plants.coordinates(), plants.velocities(), plants.weighting()], axis=1)

    return ToCome(a, b[:, None], np.asarray(cost), pushes[: inner * periods, None], inner, states, now=True)


def weighted_car(car: QuarterCar, dashpot: float, step: float) -> tuple[Array, Array, dict[str, Array]]:
    """Discrete a (12, 12) and b (12,) of the car with its weighting filter, from the road's acceleration.

    Returns them and rows (12,) of the weighted acceleration (`comfort`, m/s2) and the tyre load over its static value,
    less one (`load_ratio`).

    dashpot: N s/m in the damper's place; step: s. States: heights of wheel and body over the road, their rates, and the
    filter's states in the order of `mrdamp.simulation.rows.ChainRows.weighting`.
    """
    k, c, kt, ct = car.stiffness, car.damping + dashpot, car.tyre_stiffness, car.tyre_damping
    strut = np.array([-k, k, -c, c])
    tyre = np.array([kt, 0.0, ct, 0.0])
    system = np.zeros((5, 5))
    system[0, 2] = system[1, 3] = 1.0
    system[2, :4], system[3, :4] = (strut - tyre) / car.wheel, -strut / car.body
    system[2:4, 4] = -1.0
    moved = expm(step * system)
    n = 4 + STATES
    a, b = np.zeros((n, n)), np.zeros(n)
    a[:4, :4], b[:4] = moved[:4, :4], moved[:4, 4]
    signal = np.zeros(n)
    signal[:4] = -strut / car.body  # of the body, absolute
    unit = np.eye(n)
    for i, (b0, b1, b2, _, a1, a2) in enumerate(wk_sections(step)):
        one, two = 4 + 2 * i, 5 + 2 * i
        passed = b0 * signal + unit[one]
        a[one] = b1 * signal - a1 * passed + unit[two]
        a[two] = b2 * signal - a2 * passed
        signal = passed
    return a, b, {"comfort": signal, "load_ratio": np.append(-tyre / car.weight, np.zeros(STATES))}
