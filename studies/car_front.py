"""Draws weighted acceleration over tyre load of the quarter car: `python -m studies.car_front [FOLDER ...]`.

Twenty validation roads on the chain; every point is a setting, its mean over the roads relative to the linear
suspension. FOLDER: further trainings of `mrdamp train mrdamp/QuarterCar-v0 --algo es`, besides the shipped ones; a
folder's seeds are one training. Results are kept in out/car_front.json and used again.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.car import CarBench
from mrdamp.compare.contenders import shipped_policies
from mrdamp.envs.training_loads import validation_roads
from mrdamp.files import write_atomic
from mrdamp.pictures import style

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "docs" / "pictures" / "car_front.png"
KEPT = ROOT / "out" / "car_front.json"
ROADS = 20
#: Settings of each classical family: those around the tuned one that are on its front on the tuning roads.
FAMILIES: Mapping[str, Sequence[str]] = {
    "clipped MPC": [f"clipped-mpc:holding={h},stroke=0.1,r=0.1" for h in ("0.1", "0.3", "1")],
    "LQ with tracking": [
        "lq-tracking:holding=0.1,stroke=0.01,r=1",
        "lq-tracking:holding=0.3,stroke=0.01,r=1",
        "lq-tracking:holding=0.3,stroke=0.1,r=0.1",
        "lq-tracking:holding=1,stroke=0.01,r=1",
    ],
    "skyhook": [f"skyhook:damping={c}" for c in ("1697", "3394.11", "5656.85")],
    "SH-ADD": [f"sh-add:alpha=3,level={level}" for level in ("0.1", "0.2", "0.4")],
    "hybrid, share .75": [f"hybrid:damping={c},share=0.75" for c in ("3394.11", "5656.85")],
}


def main() -> int:
    bench, roads = CarBench(engine="chain"), validation_roads()[:ROADS]
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {}

    def point(spec: str) -> Array:
        """(2,) mean load and acceleration ratios."""
        key = hashlib.sha256("".join(bench.key(spec, road, 1.0) for road in roads).encode()).hexdigest()
        if key not in kept:
            values = [
                bench.values(bench.run(spec, road, 1.0), bench.run(UNCONTROLLED, road, 1.0)) for road in roads
            ]
            kept[key] = np.mean([[v["load_ratio"], v["comfort"]] for v in values], axis=0).tolist()
            KEPT.parent.mkdir(exist_ok=True)
            write_atomic(KEPT, json.dumps(kept))
        print(f"{spec[-60:]}: load {kept[key][0]:.4f}, acceleration {kept[key][1]:.4f}", flush=True)
        return np.array(kept[key])

    trained = [
        *shipped_policies("car").values(),
        *(sorted(Path(f).glob("**/policy.json")) for f in sys.argv[1:]),
    ]
    learned = [np.array([point(f"policy:{file}") for file in files]) for files in trained]
    families = {name: np.array([point(spec) for spec in specs]) for name, specs in FAMILIES.items()}
    figure(families, learned).savefig(FILE, dpi=150)
    return 0


@style.styled
def figure(families: Mapping[str, Array], learned: Sequence[Array]) -> Figure:
    """families: (settings, 2) of load and acceleration, by name; learned: (seeds, 2) of each training."""
    drawn = style.figure(0.62 * style.WIDTH)
    ax = drawn.subplots()
    for k, (name, points) in enumerate(families.items()):
        load, acceleration = points[np.argsort(points[:, 0])].T
        ax.plot(load, acceleration, "o-", markersize=3, linewidth=1, color=style.COLOURS[k + 1], label=name)
    means = np.array([seeds.mean(axis=0) for seeds in learned])
    load, acceleration = means[np.argsort(means[:, 0])].T
    ax.plot(load, acceleration, "-", linewidth=1.5, color=style.COLOURS[0])
    for seeds in learned:
        ax.plot(seeds[:, 0], seeds[:, 1], "s", markersize=4, color=style.COLOURS[0])
    ax.plot([], [], "s-", color=style.COLOURS[0], label="learned")
    ax.set_xlabel("dynamic tyre load over that of the linear suspension")
    ax.set_ylabel("weighted acceleration over the same")
    ax.legend(fontsize=7)
    return drawn


if __name__ == "__main__":
    sys.exit(main())
