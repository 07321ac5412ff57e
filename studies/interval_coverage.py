"""How often 95 % intervals of named causes contain the true value: `python -m studies.interval_coverage OUT ...`.

OUT: folder of a bench (`studies.blindtest --misfit`, `studies.spike_bench`) with labels.json and answers/. Counted
are parameters of answers with the right single cause that mean the same in the bench's rig and in the catalogue. The
error is the median of |estimate - true| / |true|.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from studies.blindtest.score import Share

#: Size in a label (a place's number removed) -> effect and its parameter; the second group is that of measured records.
SAME: Mapping[str, tuple[str, str]] = {
    "gain": ("sensor_gain", "g"),
    "offset": ("sensor_offset", "f"),
    "leakage": ("sensor_leakage", "tau"),
    "command.delay": ("command_delay", "d"),
    "reading.shift": ("channel_shift", "d"),
    "reading.average": ("channel_shift", "d"),
    "rod.mass": ("moving_mass", "m"),
    "stiffness": ("storey_stiffness", "e"),
    "friction": ("joint_friction", "coulomb"),
    "seal_coulomb": ("seal_friction", "coulomb"),
    "mount_gap": ("backlash", "gap"),
    "g": ("sensor_gain", "g"),
    "tau": ("sensor_leakage", "tau"),
    "d": ("channel_shift", "d"),
    "m": ("moving_mass", "m"),
    "coulomb": ("seal_friction", "coulomb"),
    "gap": ("backlash", "gap"),
}
_RELATIVE = "gain"  # of the rig's gain, the label has the change
_PLACE = re.compile(r"^(floor|storey|sensor)\d*\.")


class Value(NamedTuple):
    """A parameter of one answer: effect, true value, estimate, 95 % interval."""

    effect: str
    truth: float
    estimate: float
    low: float
    high: float

    @property
    def inside(self) -> bool:
        return self.low <= self.truth <= self.high


def values(out: Path) -> Iterator[Value]:
    """Comparable parameters of the right single causes of a bench."""
    labels = json.loads((out / "labels.json").read_text(encoding="utf-8"))
    for case, label in sorted(labels.items()):
        path = out / "answers" / case / "diagnosis.json"
        if not path.exists():
            continue
        effects = json.loads(path.read_text(encoding="utf-8"))["effects"]
        if len(effects) != 1 or _name(effects[0]) != label["label"]:
            continue
        (effect,) = effects
        for key, size in label.get("size", {}).items():
            plain = _PLACE.sub("", key)
            of, parameter = SAME.get(plain, ("", ""))
            if of != effect["name"] or parameter not in effect["intervals"]:
                continue
            low, high = effect["intervals"][parameter]
            truth = size + (plain == _RELATIVE)
            yield Value(of, truth, effect["parameters"][parameter], low, high)


def _name(effect: Mapping[str, Any]) -> str:
    return effect["name"] if effect.get("place") is None else f"{effect['name']}@{effect['place']}"


def table(found: list[Value]) -> str:
    """Markdown: a line an effect, and all of them."""
    lines = ["| effect | interval contains the true value | error, median |", "|---|---|---|"]
    for name in [*sorted({v.effect for v in found}), "all"]:
        some = [v for v in found if name in (v.effect, "all")]
        share = Share(sum(v.inside for v in some), len(some))
        low, high = share.interval
        off = float(np.median([abs(v.estimate - v.truth) / abs(v.truth) for v in some]))
        wilson = f" ({share.value:.2f}; {low:.2f} to {high:.2f})" if name == "all" else ""
        lines.append(f"| {name} | {share.right} of {share.of}{wilson} | {100 * off:.1f} % |")
    return "\n".join(lines) + "\n"


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("out", type=Path, nargs="+")
    a = p.parse_args()
    for out in a.out:
        if not (out / "labels.json").is_file() or not (out / "answers").is_dir():
            print(f"interval_coverage: {out}: labels.json and answers/ are needed", file=sys.stderr)
            return 2
    found = [v for out in a.out for v in values(out)]
    if not found:
        print("interval_coverage: no right answer has a comparable parameter", file=sys.stderr)
        return 1
    print(table(found), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
