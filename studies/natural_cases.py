"""Draws natural cases: `python -m studies.natural_cases OUT.json [--cases 40] [--seed 1]`.

Measured rigs as they are, in other laws, dependences on the command, and splits of the records than those that the
diagnosis was developed on. OUT.json is a list for `shared/cases/natural.py`, which identifies, diagnoses and judges.
Causes (`want`, `also`) are those that the owners of the rigs document or that are seen without a law.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.files import write_atomic

ROOT = Path(__file__).resolve().parents[1]
PRELOAD = ["gas_spring", "sensor_offset"]


@dataclass(frozen=True)
class Rig:
    """A measured set. records: globs. also: effects that the rig may have besides; known: sets of effects that may be
    identified along, of which the first has no preload."""

    records: tuple[str, ...]
    dependences: tuple[str, ...]
    want: tuple[tuple[str, ...], ...]
    also: tuple[str, ...]
    known: tuple[tuple[str, ...], ...] = ((), ("offset",))
    preload: bool = False  # its loops do not lie about zero
    thin: int = 1


RIGS = {
    "arts": Rig(
        ("train/*", "validation/*"),
        ("constant",),
        (("backlash",),),
        ("mount_compliance", "seal_friction", "asymmetry", *PRELOAD),
    ),
    "utfsm": Rig(
        ("train/*", "validation/sine*"),
        ("linear", "quadratic"),
        (("shear_thinning",), ("saturation",)),
        ("seal_friction", "trapped_gas", "backlash", *PRELOAD),
        preload=True,  # 41 N
    ),
    "utfpr": Rig(
        ("train/*", "validation/[0-3].[0-9]*", "validation/0V_ensaio[2468].1*"),
        ("linear", "quadratic"),
        (("shear_thinning",),),
        ("backlash", *PRELOAD),
        preload=True,
    ),
    "nees": Rig(
        ("train/*", "validation/*"),
        ("linear",),
        (("driver_lag", "command_delay"), ("channel_shift",)),
        ("driver_lag", "command_delay", *PRELOAD),
        known=((), ("offset",), ("offset", "driver_lag")),
        preload=True,
        thin=5,
    ),
}
LAWS = ("bouc_wen", "modified_bouc_wen", "hyperbolic_tangent")
#: Share of the records that the simulator is identified on and the case has; the others judge.
KEPT = (0.25, 0.5)


def draw(name: str, rig: Rig, files: list[str], rng: np.random.Generator) -> dict[str, Any]:
    """One case of a rig."""
    known = rig.known[rng.integers(len(rig.known))]
    count = round(len(files) * rng.uniform(*KEPT)) or 1
    order = rng.permutation(len(files))
    kept, used = (sorted(files[i] for i in part) for part in (order[:count], order[count:]))
    want = [w for w in rig.want if not set(w) & set(known)]
    if rig.preload and not known:
        want.append(tuple(PRELOAD))
    return {
        "law": LAWS[rng.integers(len(LAWS))],
        "dependence": rig.dependences[rng.integers(len(rig.dependences))],
        "extras": list(known),
        "thin": rig.thin,
        "fit": used,
        "case": used,
        "kept": kept,
        "want": [list(w) for w in want],
        "also": sorted({*rig.also, *(c for w in rig.want for c in w)}),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    root = Path(os.environ.get("MRDAMP_DATA", ROOT.parent / "shared" / "data"))
    rng = np.random.default_rng(args.seed)
    cases = {}
    for k in range(args.cases):
        name, rig = list(RIGS.items())[k % len(RIGS)]
        files = sorted(f"data/{p.relative_to(root)}" for g in rig.records for p in (root / name).glob(g))
        cases[f"{name}_{k:02d}"] = draw(name, rig, files, rng)
    write_atomic(args.out, json.dumps(cases, indent=1) + "\n")
    print(f"{args.out}: {len(cases)} cases of {len(RIGS)} rigs")


if __name__ == "__main__":
    main()
