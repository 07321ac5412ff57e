"""Cases of a damper rig outside the package: `python -m studies.other_rig OUT [--seed 501]`.

Writes records and OUT/cases.json, a list for `shared/cases/natural.py` with OUT as its root. The rig: Bouc-Wen with
n = 1.4, fields by tanh, and a yield displacement that grows by a quarter with the current, which no law here has; all
records at once by Runge-Kutta in steps of 20 us; 500 Hz, 1 % noise of the force, 2 um of the displacement. Half of
the cases ask what a simulator misses on the records that it was identified on, half what has changed since. Takes 6 GB
of memory and three minutes.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from mrdamp.files import write_atomic

Array = NDArray[np.float64]
STEP, RATE, SECONDS = 2e-5, 500, 6.0
EVERY = round(1 / (STEP * RATE))
T = STEP * np.arange(round(SECONDS / STEP) + 1)

#: Motion (kind, Hz, m), and a command (A) that is constant or jumps (s).
TESTS = {
    "sine_1Hz_0A": (("sine", 1.0, 0.012), 0.0),
    "sine_2Hz_0.5A": (("sine", 2.0, 0.009), 0.5),
    "sine_2.5Hz_1A": (("sine", 2.5, 0.010), 1.0),
    "sine_3Hz_1.5A": (("sine", 3.0, 0.007), 1.5),
    "sine_4Hz_2A": (("sine", 4.0, 0.005), 2.0),
    "random_0A": (("random", 5.0, 0.004), 0.0),
    "random_steps": (("random", 4.0, 0.005), -0.37),
    "sine_steps": (("sine", 1.7, 0.010), -0.29),
    "sweep_1A": (("sweep", 5.0, 0.006), 1.0),
}
KEPT = {
    "kept_random_steps": (("random", 4.5, 0.0045), -0.31),
    "kept_sine_1.5Hz": (("sine", 1.5, 0.011), 1.2),
    "kept_sine_steps": (("sine", 3.3, 0.006), -0.5),
    "kept_random": (("random", 3.5, 0.005), 0.3),
}
#: Causes and draws of their sizes, SI units.
CAUSES: Mapping[str, Callable[[np.random.Generator], dict[str, float]]] = {
    "shear_thinning": lambda r: {"knee": r.uniform(0.05, 0.09), "power": r.uniform(0.45, 0.6)},
    "seal_friction": lambda r: {"seal": r.uniform(50, 110)},
    "gas_spring": lambda r: {"preload": r.uniform(80, 160), "spring": r.uniform(4e3, 9e3)},
    "driver_lag": lambda r: {"lag": r.uniform(0.012, 0.03)},
    "command_delay": lambda r: {"delay": r.uniform(0.01, 0.025)},
    "channel_shift": lambda r: {"shift": r.uniform(0.002, 0.005) * r.choice([-1, 1])},
    "motion_lag": lambda r: {"average": r.uniform(0.05, 0.09)},
    "backlash": lambda r: {"gap": r.uniform(5e-4, 1.2e-3)},
    "mount_compliance": lambda r: {"mount": r.uniform(3e5, 6e5)},
    "moving_mass": lambda r: {"mass": r.uniform(6, 14)},
    "asymmetry": lambda r: {"side": r.uniform(0.06, 0.13)},
    "saturation": lambda r: {"knee_current": r.uniform(1.0, 1.5)},
    "remanence": lambda r: {"loop": r.uniform(0.15, 0.3)},
    "sensor_lag": lambda r: {"sensor": r.uniform(0.004, 0.01)},
    "heating": lambda r: {"heat": r.uniform(0.25, 0.5)},
    "trapped_gas": lambda r: {"dip": r.uniform(0.5, 0.9), "stroke": r.uniform(1e-3, 3e-3)},
}
NAMES = sorted({key for draw in CAUSES.values() for key in draw(np.random.default_rng(0))})
LAWS = (
    ("bouc_wen", "linear"),
    ("bouc_wen", "quadratic"),
    ("hyperbolic_tangent", "quadratic"),
    ("modified_bouc_wen", "linear"),
)
#: Answers that no record tells from a cause, and what a law lacks that is linear in the command.
SAME = {"gas_spring": ["gas_spring", "sensor_offset"], "driver_lag": ["driver_lag", "command_delay"]}
SAME["command_delay"] = SAME["driver_lag"]
CONTROLS, EACH = 4, 8  # of each question: cases without and with a cause


def motion(kind: tuple[str, float, float], rng: np.random.Generator) -> Array:
    name, hz, size = kind
    if name == "sine":
        x = size * np.sin(2 * np.pi * hz * T)
    elif name == "sweep":
        x = size * np.sin(2 * np.pi * (0.5 * T + (hz - 0.5) * T**2 / (2 * SECONDS)))
    else:
        few, f = T[::50], np.linspace(0.3, hz, 60)
        y = np.cos(2 * np.pi * np.outer(few, f) + rng.uniform(0, 2 * np.pi, 60)).sum(axis=1)
        x = CubicSpline(few, y * size / y.std())(T)
    rise = np.clip(T / 0.3, 0, 1)
    return np.asarray(x * rise**2 * (3 - 2 * rise))


def field_current(p: Mapping[str, float], u: Array) -> Array:
    """Coil current (n,) A that a linear circuit without memory would need for the field."""
    i = u.copy()
    if p["delay"]:
        late = round(p["delay"] / STEP)
        i = np.r_[np.full(late, u[0]), u[:-late]]
    for lag in (p["lag"], 0.004 if p["loop"] else 0.0):
        if lag:
            a = np.exp(-STEP / lag)
            i = lfilter([1 - a], [1, -a], i - i[0]) + i[0]
    if p["loop"]:
        h, change = np.zeros(len(i)), np.diff(i)
        for k, d in enumerate(change):
            h[k + 1] = h[k] + d / 0.3 * (1 - np.sign(d) * h[k])
        i = np.maximum(i - p["loop"] * h, 0)
    return np.asarray(p["knee_current"] * np.tanh(i / p["knee_current"]) if p["knee_current"] else i)


def forces(x: Array, current: Array, p: dict[str, Array]) -> Array:
    """Load cell (records, samples) N of rods moved by x (records, n) under currents (records, n)."""
    v = np.gradient(x, STEP, axis=1)
    a = np.gradient(v, STEP, axis=1)
    field = np.tanh(0.8 * current) / np.tanh(1.6)
    c, strength, width = 850 + 520 * field, 110 + 1150 * field, 7e-4 * (1 + 0.125 * current)
    rigid, stiff, damped = (p["mount"] == 0) & (p["gap"] == 0), np.where(p["mount"] > 0, p["mount"], 4e6), 60.0
    knee, power = np.where(p["knee"] > 0, p["knee"], 1.0), np.where(p["knee"] > 0, p["power"], 1.0)
    stroke = np.where(p["stroke"] > 0, p["stroke"], 1.0)

    def rates(z: Array, piston: Array, k: int, part: float) -> tuple[Array, Array, Array]:
        """Rate of z, velocity and place of the piston at a share of step k."""
        at = slice(k, k + 2)
        rod, speed = x[:, at] @ [1 - part, part], v[:, at] @ [1 - part, part]
        stretch = rod - piston
        touching = np.abs(stretch) > p["gap"] / 2
        pull = stiff * np.sign(stretch) * np.maximum(np.abs(stretch) - p["gap"] / 2, 0)
        own = (pull + damped * touching * speed - 500 * piston - strength[:, k] * z) / (c[:, k] + damped * touching)
        w = np.where(rigid, speed, own)
        dz = (w - 0.55 * np.abs(w) * np.abs(z) ** 0.4 * z - 0.45 * w * np.abs(z) ** 1.4) / width[:, k]
        return dz, w, np.where(rigid, rod, piston)

    z, piston, warm, since = np.zeros(len(x)), x[:, 0].copy(), np.zeros(len(x)), np.ones(len(x))
    last, out = np.zeros(len(x)), np.empty((len(x), (x.shape[1] - 1) // EVERY + 1))
    for k in range(x.shape[1]):
        step = min(k, x.shape[1] - 2)
        _, w, place = rates(z, piston, step, float(k - step))
        turned = np.sign(w) != last
        since, last = np.where(turned, 0.0, since + np.abs(w) * STEP), np.sign(w)
        if k % EVERY == 0:
            thin = c[:, k] * (1 + (w / knee) ** 2) ** ((power - 1) / 2) * w
            f = (thin + strength[:, k] * z) / (1 + warm) * (1 + p["side"] * np.sign(w))
            f += (500 + p["spring"]) * place + p["preload"] + p["seal"] * np.tanh(w / 8e-4)
            f *= 1 - (w > 0) * p["dip"] * np.exp(-((since / stroke) ** 2))
            out[:, k // EVERY] = f + p["mass"] * a[:, k]
            if k % 60000 == 0:
                print(f"{100 * k // x.shape[1]:3d} %", flush=True)
        if k == x.shape[1] - 1:
            break
        one = rates(z, piston, k, 0.0)
        two = rates(z + STEP / 2 * one[0], piston + STEP / 2 * one[1], k, 0.5)
        three = rates(z + STEP / 2 * two[0], piston + STEP / 2 * two[1], k, 0.5)
        four = rates(z + STEP * three[0], piston + STEP * three[1], k, 1.0)
        z, piston = (
            y + STEP / 6 * (one[i] + 2 * two[i] + 2 * three[i] + four[i]) for i, y in enumerate((z, piston))
        )
        warm += STEP * (p["heat"] * np.abs((c[:, k] * w + strength[:, k] * z) * w) / 400 - warm / 8)
    return out


def write(root: Path, states: list[dict[str, float]], parts: set[tuple[int, str]], seed: int) -> None:
    """Simulates the parts (state, `old`, `new` or `kept`) and writes a folder of records for each."""
    plan = []
    for state, part in sorted(parts):
        for number, (name, (kind, command)) in enumerate((KEPT if part == "kept" else TESTS).items()):
            rng = np.random.default_rng([seed, ("old", "new", "kept").index(part), state, number])
            x, u = motion(kind, rng), np.full(len(T), max(command, 0.0))
            if command < 0:
                u = rng.uniform(0, 2, len(T))[(T / -command).astype(int)]
            plan.append((root / f"{state:02d}_{part}" / f"{name}.csv", dict.fromkeys(NAMES, 0.0) | states[state], x, u))
    columns = {name: np.array([p[name] for _, p, _, _ in plan]) for name in NAMES}
    current = np.array([field_current(p, u) for _, p, _, u in plan])
    made = forces(np.array([x for _, _, x, _ in plan]), current, columns)
    rng = np.random.default_rng([seed, 99])
    for (path, p, x, u), force in zip(plan, made, strict=True):
        if p["sensor"]:
            a = np.exp(-1 / (RATE * p["sensor"]))
            force = lfilter([1 - a], [1, -a], force - force[0]) + force[0]
        if p["average"]:
            sums, half = np.concatenate([[0], np.cumsum(x)]), round(p["average"] / STEP / 2)
            low, high = np.maximum(np.arange(len(T)) - half, 0), np.minimum(np.arange(len(T)) + half + 1, len(T))
            x = (sums[high] - sums[low]) / (high - low)
        read = np.interp(T[::EVERY] - p["shift"], T, x) + rng.normal(0, 2e-6, len(force))
        force = force + 0.01 * force.std() * rng.normal(size=len(force))
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = np.column_stack([T[::EVERY], read, u[::EVERY], force])
        header = "time_s,displacement_m,command,force_N"
        np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=501)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    # A spring and a preload that were there are the law's own.
    causes = sorted(map(str, rng.permutation(list(CAUSES))), key=lambda name: name == "gas_spring")
    states, parts, cases = [dict[str, float]()], set[tuple[int, str]](), dict[str, Any]()
    for question, drawn in (("missed", causes[:EACH]), ("changed", causes[EACH:])):
        for number, cause in enumerate([*[""] * CONTROLS, *drawn]):
            size = CAUSES[cause](rng) if cause else {}
            if size:
                states.append(size)
            state = len(states) - 1 if size else 0
            law, dependence = LAWS[rng.integers(len(LAWS))]
            own, old = (state, "old") if question == "missed" else (state, "new"), (0, "old")
            used = own if question == "missed" else old
            parts |= {own, used, (state, "kept")}
            folder = {key: [f"{s:02d}_{part}/*"] for key, (s, part) in
                      {"fit": used, "case": own, "kept": (state, "kept"), "baseline": old}.items()}  # fmt: skip
            if question == "missed":
                del folder["baseline"]
            field = ["saturation"] if dependence == "linear" else []
            cases[f"{question}_{number:02d}"] = folder | {
                "law": law,
                "dependence": dependence,
                "extras": ["offset"],
                "want": [SAME.get(cause, [cause])] if cause else [],
                "also": field if question == "missed" else [],
                "size": size,
            }
    write(args.out, states, parts, args.seed)
    write_atomic(args.out / "cases.json", json.dumps(cases, indent=1) + "\n")
    print(f"{args.out / 'cases.json'}: {len(cases)} cases")


if __name__ == "__main__":
    main()
