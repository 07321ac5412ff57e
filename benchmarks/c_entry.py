"""Samples per second of the C entry against stepping the test rig in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from benchmarks.frames import BLOCK, DYKE
from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, clock, interleave, ratio
from mrdamp import models_xml
from mrdamp.model import core
from mrdamp.model.core import Array

TARGET = ">= 15"
STROKE, FREQUENCY = 0.01, 2.5  # m, Hz
SETS = 64
_HYSTERESIS = {"alpha_a": 8e4, "alpha_b": 2e5, "gamma": 3e4, "beta": 5e4, "A": 120.0, "n": 2.0, "k0": 300.0, "x0": 1e-3}
_DASHPOT, _SERIES = {"c0a": 600.0, "c0b": 300.0}, {"c1a": 8e3, "c1b": 1e4}
#: Laws of the packs, of a damper of 1 kN.
LAWS: dict[str, dict[str, float]] = {
    "bingham": {**_DASHPOT, "fya": 100.0, "fyb": 500.0, "v_ref": 0.01},
    "bouc_wen": {**_DASHPOT, **_HYSTERESIS},
    "modified_bouc_wen": {**_DASHPOT, **_SERIES, **_HYSTERESIS, "k1": 100.0},
    "hyperbolic_tangent": {
        **_DASHPOT, **_SERIES, "k0a": 500.0, "k0b": 0.0, "k1a": 8e4, "k1b": 5e4, "m0": 0.5, "f0a": 100.0, "f0b": 500.0,
        "v_ref": 0.01,
    },
}  # fmt: skip
#: Effects of the packs, by what is written behind the law.
PACKED: dict[str, dict[str, float]] = {
    "the law alone": {},
    "with a driver's lag": {"driver_lag_tau": 0.02},
    "behind a mount with backlash": {"mount_compliance_k": 5e5, "backlash_gap": 5e-4},
    "with gas in series": {"trapped_gas_force": 300.0, "trapped_gas_s_g": 3e-3, "trapped_gas_series": 1.0},
}
YIELD_FORCE, EXPONENT, YIELDS = 1e3, 1.5, (1e-3, 1e-4, 1e-5)  # N, -, m


class Entry:
    """A record of a sine through the C entry in one thread: parameter sets that are `spread` apart, in packs of up to
    `lanes`."""

    def __init__(
        self,
        dt: float,
        samples: int,
        law: str = DYKE.law,
        attributes: Mapping[str, float] | None = None,
        spread: Array | None = None,
        lanes: int = 0,
    ) -> None:
        t = np.arange(samples) * dt
        w = 2.0 * math.pi * FREQUENCY
        self.dt, self.x, self.v = dt, STROKE * np.sin(w * t), STROKE * w * np.cos(w * t)
        self.u: Array = 1.125 + 1.125 * np.sin(3.0 * t)
        one = attributes or DYKE.attributes()
        factors = np.ones((1, len(one))) if spread is None else spread
        sets = [dict(zip(one, row * np.array([*one.values()]), strict=True)) for row in factors]
        self.law, self.params, self.lanes = law, np.array([core.vector(law, s) for s in sets]), lanes

    def __call__(self) -> float:
        """Cost of a sample, us."""
        begin = clock()
        force = core.run_many(self.law, self.params, self.dt, self.x, self.u, v=self.v, lanes=self.lanes)
        cost = (clock() - begin) / force.size
        if not np.isfinite(force).all():
            raise RuntimeError("the C entry gives forces that are not finite")
        return cost


class Rig:
    """The shipped rig on the same sine. driven: motion and command set before every step, as a record needs;
    otherwise BLOCK steps of the engine in one call."""

    def __init__(self, dt: float, steps: int, *, driven: bool) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(models_xml.path("rig")))
        self.model.opt.timestep = dt
        self.data, self.every = mujoco.MjData(self.model), 1 if driven else BLOCK
        self.calls, self.now = max(steps // self.every, 1), 0
        w, period = 2.0 * math.pi * FREQUENCY, round(2.0 / FREQUENCY / dt)
        t = np.arange(0, period, self.every) * dt
        x, v = STROKE * np.sin(w * t), STROKE * w * np.cos(w * t)
        self.rows = list(zip(x.tolist(), v.tolist(), (1.125 + 1.125 * np.sin(3.0 * t)).tolist(), strict=True))

    def __call__(self) -> float:
        """Cost of a step, us."""
        m, d, rows, every, step = self.model, self.data, self.rows, self.every, mujoco.mj_step
        qpos, qvel, ctrl = d.qpos, d.qvel, d.ctrl
        begin = clock()
        for k in range(self.now, self.now + self.calls):
            qpos[0], qvel[0], ctrl[0] = rows[k % len(rows)]
            step(m, d, every)
        cost = (clock() - begin) / (self.calls * every)
        self.now += self.calls
        if not 1.0 < abs(d.sensor("damper_force").data[0]) < 1e5:
            raise RuntimeError(f"the rig's force is {d.sensor('damper_force').data[0]} N")
        return cost


def bouc_wen(travel: float) -> dict[str, float]:
    """A Bouc-Wen law that yields at YIELD_FORCE after about `travel` (m)."""
    rate = 0.5 * travel**-EXPONENT
    return {
        "c0a": 500.0,
        "c0b": 500.0,
        "alpha_a": YIELD_FORCE / travel,
        "alpha_b": 0.0,
        "gamma": rate,
        "beta": rate,
        "A": 1.0,
        "n": EXPONENT,
        "k0": 0.0,
        "x0": 0.0,
    }


def rigid(effort: Effort) -> Section:
    """Cost of a Bouc-Wen law that is nearly rigid before it yields, over that of a compliant one."""
    laws = {f"{t:g}": Entry(1e-3, 10 * effort.steps, "bouc_wen", bouc_wen(t)) for t in YIELDS}
    costs = interleave(laws, effort.rounds)
    first, *others = costs
    return Section(
        "Rigid Bouc-Wen laws",
        f"Cost of a sample at 1 ms of a Bouc-Wen law (exponent {EXPONENT:g}) by the travel at which it yields, "
        f"over that of a law that yields after {1e3 * YIELDS[0]:g} mm. Strokes are {1e3 * STROKE:g} mm.",
        tuple(
            of_ratio(f"yields after {1e3 * float(t):g} mm", ratio(costs[t], costs[first]))
            for t in others
        ),
    )


def lanes(effort: Effort) -> Section:
    """Cost of many parameter sets one after the other over that in packs."""
    rows = []
    for what, effects in PACKED.items():
        found: dict[str, list[tuple[float, str]]] = {"4": [], "8": []}
        for law, parameters in LAWS.items():
            one = {**parameters, **effects}
            # Exponents and switches stay as they are.
            varied = [name not in ("n", "trapped_gas_series") for name in one]
            spread = 1 + 0.2 * np.random.default_rng(1).random((SETS, len(one))) * varied
            tasks = {str(k): Entry(1e-3, effort.steps // 4, law, one, spread, k) for k in (1, 4, 8)}
            costs = interleave(tasks, max(effort.rounds // 8, 2))
            for k, ratios in found.items():
                ratios.append((ratio(costs["1"], costs[k]).value, law.replace("_", " ")))
        for k, ratios in found.items():
            (least, slow), (most, fast) = min(ratios), max(ratios)
            rows.append(Figure(f"{what}, {k} lanes", least, detail=f"{slow}; {most:.2f} x {fast}"))
    return Section(
        "Packs of dampers on vector units",
        f"Cost of a sample of {SETS} parameter sets, one core, one after the other over 4 (AVX2) and 8 (AVX-512) at "
        "once: least of the four laws, then the largest. The forces are the same to the bit.",
        tuple(rows),
    )


def measure(effort: Effort) -> list[Section]:
    """The tables."""
    rows = []
    for dt in (5e-4, 1e-3):
        costs = interleave(
            {
                "entry": Entry(dt, 10 * effort.steps),
                "rig": Rig(dt, effort.steps, driven=True),
                "engine": Rig(dt, effort.steps, driven=False),
            },
            effort.rounds,
        )
        driven, engine = (ratio(costs[name], costs["entry"]) for name in ("rig", "engine"))
        rows += [
            of_ratio(f"rig driven by a record, {dt * 1e3:g} ms", driven, TARGET),
            of_ratio(f"the engine's steps alone, {dt * 1e3:g} ms", engine),
        ]
    return [
        Section(
            "C entry against the rig in MuJoCo",
            f"Samples per second of `mrdamp_run` ({DYKE.id}, one thread, called from Python) over steps per second of "
            "the shipped rig, its motion and command set from Python.",
            tuple(rows),
        ),
        lanes(effort),
        rigid(effort),
    ]
