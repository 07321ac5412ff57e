"""Renews the tables of docs/control.md, between `<!-- NAME -->` and `<!-- end -->`; the frame's on rows of the chain.

    mrdamp compare frame --tune --jobs 2 -o out/tune && cp out/tune/tuned.json src/mrdamp/data/controllers/frame.json
    mrdamp compare cable --engine chain -o out/cable && mrdamp compare car --engine chain -o out/car
    python tools/control_tables.py --work out

Reads result.json in out/cable and out/car, where there is one; runs the rest, and keeps runs in out/tables.jsonl.
Measured motions are those in ../shared/data/earthquakes; without them that table stays as it is.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mrdamp.compare import tuning
from mrdamp.compare.bench import Bench
from mrdamp.compare.benches import PARTS, on_rows, scaled
from mrdamp.compare.car import CarBench
from mrdamp.compare.comparison import Comparison, Summary, difference
from mrdamp.compare.contenders import contenders, shipped_policies
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.linear import CableBench
from mrdamp.compare.tables import markdown, short
from mrdamp.envs.training_loads import read_motions, unseen_motions
from mrdamp.files import write_atomic
from mrdamp.model import Effect
from mrdamp.motions import GroundMotion

ROOT = Path(__file__).resolve().parents[1]
PAGE, RECORDS = ROOT / "docs" / "control.md", ROOT.parent / "shared" / "data" / "earthquakes"
AMPLITUDES = (0.1, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
PERCENT = (-10, 10)
LAG = 0.003  # s, of the force sensor
PEAKS = ("controller", "J1", "J2", "mean of both minus passive-on")
MODEL_BASED = ("clipped-optimal-tuned", "modulated-optimal-tuned", "force-tracking-tuned")
#: Near passive-on everywhere: shown once.
CONSTANT = ("best-constant", "lyapunov-tuned", "max-dissipation-tuned")


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--work", type=Path, default=Path("out"), help="folder of the runs")
    p.add_argument("--jobs", type=int, default=2)
    a = p.parse_args()
    tables = Tables(a.work, a.jobs)
    text = PAGE.read_text(encoding="utf-8")
    for name in [found for found in re.findall(r"<!-- ([a-z]+) -->\n", text) if found != "end"]:
        found = getattr(tables, name)()
        if found is not None:
            head, _, rest = text.partition(f"<!-- {name} -->\n")
            text = f"{head}<!-- {name} -->\n\n{found}\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
            write_atomic(PAGE, text)
        print(f"{name}: {'left as it is' if found is None else 'renewed'}", flush=True)


class Tables:
    """Each method is a table, by the name in the page; None leaves it as it is."""

    def __init__(self, work: Path, jobs: int) -> None:
        self.work, self.jobs = work, jobs
        self.bench = FrameBench(frame_model(), engine="chain")
        settings = tuning.shipped(self.bench)
        assert settings is not None
        shipped = shipped_policies("frame")
        names = ["passive-off", "passive-on", *settings, *shipped]
        self.rows = contenders(self.bench, names, settings, shipped)

    def run(
        self, benches: Mapping[str, FrameBench], loads: Sequence[GroundMotion], amplitudes: Sequence[float]
    ) -> dict[str, Comparison]:
        keep = self.work / "tables.jsonl"
        return on_rows(benches, self.rows, loads, amplitudes, jobs=self.jobs, keep=keep)

    def cable(self) -> str | None:
        return _compared(self.work / "cable", CableBench(), ("motion",))

    def car(self) -> str | None:
        return _compared(self.work / "car", CarBench(), ("comfort", "load_ratio"))

    def unseen(self) -> str:
        result = self.run({"": self.bench}, unseen_motions(), self.bench.unseen_amplitudes)[""]
        return f"{markdown(PEAKS, _peaks(result))}\n{_differences(result)}"

    def measured(self) -> str | None:
        if not RECORDS.is_dir():
            return None
        result = self.run({"": self.bench}, read_motions([RECORDS]), AMPLITUDES)[""]
        rows = [row for row in _peaks(result) if row[0] not in CONSTANT]
        return f"{markdown(PEAKS, rows)}\n{_differences(result)}"

    def spread(self) -> str:
        model = self.bench.model
        benches = {
            f"{part} {p:+d} %": replace(self.bench, model=scaled(model, part, 1 + p / 100), told=model)
            for part in PARTS
            for p in PERCENT
        }
        found = self.run(benches, unseen_motions(), self.bench.unseen_amplitudes)
        rows = [
            (_name(c.name, len(c.specs)), *(_spread(r.gain(c.name)) for r in found.values()))
            for c in self.rows
            if c.learned or c.name in MODEL_BASED
        ]
        return markdown(("minus passive-on", *found), rows)

    def lag(self) -> str:
        """A force sensor that lags, known and unknown."""
        model = self.bench.model
        lagged = replace(model, effects=(*model.effects, Effect("sensor_lag", {"tau": LAG})))
        benches = {
            "no lag": self.bench,
            "3 ms, known": replace(self.bench, model=lagged),
            "3 ms, unknown": replace(self.bench, model=lagged, told=model),
        }
        found = self.run(benches, unseen_motions(), self.bench.unseen_amplitudes)
        rows = [
            (_name(c.name, len(c.specs)), *(_short(float(r.rated(c.name).mean())) for r in found.values()))
            for c in self.rows
            if c.learned or c.name in ("passive-on", *MODEL_BASED)
        ]
        return markdown(("mean of J1 and J2", *found), rows)


def _compared(folder: Path, bench: Bench, ratios: Sequence[str]) -> str | None:
    """Means of a comparison, and what it is tuned for less that of the best constant command, paired."""
    file = folder / "result.json"
    if not file.is_file():
        return None
    data = json.loads(file.read_text(encoding="utf-8"))["controllers"]
    rated = {
        name: np.sum([w * np.array(row["measures"][k]["runs"]) for k, (_, w) in bench.objective.items()], axis=0)
        for name, row in data.items()
    }
    rows = []
    for name, row in data.items():
        m = row["measures"]
        cells = [f"{m[key]['mean']:.3f}" for key in ratios]
        cells.append(_spread(difference(rated[name], rated["best-constant"])))
        cells.append(short(m["mean_command"]["mean"]))
        rows.append((_name(name, len(row["specs"])), *cells))
    titles = {m.key: m.title.format(unit="V") for m in bench.measures}
    heads = ("controller", *(titles[key] for key in ratios), "minus best-constant", titles["mean_command"])
    return markdown(heads, rows)


def _peaks(result: Comparison) -> list[tuple[str, ...]]:
    return [
        (
            _name(c.name, len(c.specs)),
            *(_short(result.summary(c.name, key).mean) for key in ("J1", "J2")),
            _spread(result.gain(c.name)),
        )
        for c in result.contenders
    ]


def _differences(result: Comparison) -> str:
    """Mean of J1 and J2: learned controllers less those that they are claimed to be better than, or level with."""
    rated = {c.name: result.rated(c.name) for c in result.contenders}
    names = ("adjoint", "learned")
    rows = [
        (other, *(_spread(difference(rated[name], rated[other])) for name in names)) for other in MODEL_BASED
    ]
    return markdown(("mean of both", *(f"{name} minus it" for name in names)), rows)


def _name(name: str, seeds: int) -> str:
    return f"{name}, {seeds} seeds" if seeds > 1 else name


def _short(value: float, form: str = ".3f") -> str:
    return re.sub(r"^([+-]?)0\.", r"\1.", f"{value:{form}}")


def _spread(s: Summary) -> str:
    """As the page writes differences: -.030 (-.045 to -.016), 0 of a controller to itself."""
    if not s.mean and s.low == s.high:
        return "0"
    mean, low, high = (_short(value, "+.3f") for value in (s.mean, s.low, s.high))
    return f"{mean} ({low} to {high})"


if __name__ == "__main__":
    main()
