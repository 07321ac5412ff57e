"""Renews the figures of docs/papers: each row of the two papers with what the package's commands give for it.

A figure stands in its page between `<!--norm table1 network e_t-->` and `<!--/-->`: it is `Results.norm` of these
words.

    python tools/paper_pages.py [--data FOLDER] [RUN ...]

The figures come from docs/papers/results.json, which holds what the commands of `RUNS` print with `--json`. A run that
is named, or that is missing there, is run; FOLDER holds the measured sets, whose figures stay as they are without it.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import make_foam
import numpy as np
from identification_tables import save, shrink

from mrdamp.identify.calibration import COLUMNS, embedded_tests, sensing_by_command
from mrdamp.pictures import identification as sensing
from mrdamp.records import embedded

CONDITION = "sine_4.0Hz_8.0mm_3.0V"
_SIGNALS = "--zero-mean --cutoff 80 --cutoff-force"
_HALF = "--protocol constant --command 0.5"
_CUT = "--protocol varying --record sine_5.0Hz_2.5mm_random_current"
#: Arguments of `mrdamp` by run; {data}: folder of the measured sets, {work}: of pictures.
RUNS: Mapping[str, str] = {
    "table1": f"table1 foam --condition {CONDITION} --follows paper {_SIGNALS} --picture {{work}}/foam-models.png",
    "table1_five": f"table1 foam --follows paper {_SIGNALS}",
    "table1_middle": f"table1 {{work}}/table1_middle --follows paper {_SIGNALS}",
    "table1_slow": f"table1 {{work}}/table1_slow --follows paper {_SIGNALS}",
    "table1_utfsm": "table1 {data}/utfsm --starts 2",
    "table1_utfpr": "table1 {data}/utfpr --starts 2",
    "table1_nees": "table1 {data}/nees --starts 2",
    "bingham": f"identify foam --law bingham --protocol constant --command 3 {_SIGNALS}",
    "bouc_wen_3V": f"identify foam --law bouc_wen --protocol constant --command 3 --norms {_SIGNALS}",
    "tanh_3V": f"identify foam --law hyperbolic_tangent --protocol constant --command 3 --norms {_SIGNALS}",
    "bouc_wen": f"identify foam --law bouc_wen --by-command {_SIGNALS}",
    "tanh": f"identify foam --law hyperbolic_tangent --by-command --follows paper {_SIGNALS}",
    "calibrate": "calibrate",
    "choice": f"identify self_sensing --law narx {_HALF} --select --seeds 5 --by one_step"
    " --picture {work}/sensing-choice.png",
    "choice_free": f"identify self_sensing --law narx {_HALF} --select --seeds 5",
    "constant": f"identify self_sensing --law narx {_HALF} --picture {{work}}/sensing-constant.png",
    "constant_utfsm": "identify {data}/utfsm --law narx --protocol constant --command 0.5",
    "varying": f"identify --law narx {_CUT} --picture {{work}}/sensing-varying.png",
    "varying_law": f"identify --law modified_bouc_wen {_CUT} --picture {{work}}/sensing-varying_law.png",
}
#: Of a run on a set that tools/make_foam.py makes in a folder of its name: Hz of the training tests.
FEWER: Mapping[str, tuple[float, ...]] = {"table1_middle": (1.0, 3.0), "table1_slow": (0.5,)}

#: OpenBLAS rounds in another way on each kind of processor, and a network's training ends elsewhere.
KERNEL = {"OPENBLAS_CORETYPE": "Haswell"}

ROOT = Path(__file__).resolve().parents[1]
PAGES, WORK = ROOT / "docs" / "papers", ROOT / "out" / "papers"
#: Runs on the record sets of Table 1 of the foam-damper paper, by column.
SETS = ("table1", "table1_five", "table1_utfsm", "table1_utfpr", "table1_nees")
#: Of a command's JSON, what no row needs.
_DROPPED = set("checks left_in_records effects_left_out train stages by_command course fitted warnings".split())


class Results:
    """Figures of the runs, as text; its methods are the words of the pages."""

    def __init__(self, kept: Mapping[str, Any]) -> None:
        self.kept = kept

    def fill(self, text: str) -> str:
        """The text with its figures renewed."""
        marks = re.compile(r"<!--(\w[^>]*)-->.*?<!--/-->", re.DOTALL)
        return marks.sub(lambda m: f"<!--{m[1]}-->{self._word(m[1])}<!--/-->", text)

    def command(self, run: str) -> str:
        """The command of a run, as code."""
        return f"`{_command(run)}`"

    def commands(self, *runs: str) -> str:
        """The commands of runs as a block, each behind the one that makes its set."""
        lines = []
        for run in runs:
            if run in FEWER:
                lines.append(f"python tools/make_foam.py {run} {' '.join(f'{hz:g}' for hz in FEWER[run])}")
            lines.append(_command(run))
        return "\n".join(["\n\n```", *lines, "```\n\n"])

    def norms(self, model: str, *norms: str) -> str:
        """Of a model on every set, cells of a row."""
        return " | ".join(self.norm(run, model, *norms) for run in SETS)

    def norm(self, run: str, model: str, *norms: str) -> str:
        """Of a table's row; a dash where there is none."""
        rows = (row for row in self.kept[run]["rows"] if row["model"] == model)
        return next((", ".join(f"{row[norm]:.4f}" for norm in norms) for row in rows), "-")

    def of_law(self, run: str, norm: str) -> str:
        """Of a law alone, on the condition's record."""
        return next(f"{row[norm]:.4f}" for row in self.kept[run]["norms"] if row["record"] == CONDITION)

    def share(self, run: str, model: str) -> str:
        """E_t of a table's network over that of its best law."""
        rows = {row["model"]: row["e_t"] for row in self.kept[run]["rows"]}
        return f"{rows[model] / min(value for name, value in rows.items() if 'network' not in name):.2g}"

    def peak(self, frequency: str) -> str:
        """Largest force (N) of the set's tests at a frequency."""
        tests = (r for r in embedded("foam") if r.name.startswith(f"sine_{frequency}Hz"))
        return f"{max(float(np.abs(r.channel('force_N')).max()) for r in tests):.0f}"

    def lead(self, name: str) -> str:
        """Degrees by which the force leads the displacement at 4 Hz in a record of the set."""
        r = next(r for r in embedded("foam") if r.name == name)
        f, x = (np.sum((y - y.mean()) * np.exp(-8j * np.pi * r.time)) for y in (r.channel("force_N"), r.displacement))
        return f"{np.degrees(np.angle(f / x)):.0f}"

    def attribute(self, run: str, name: str, scale: str = "1") -> str:
        """Of a law."""
        return f"{float(scale) * self.kept[run]['attributes'][name]:.3g}"

    def line(self, run: str, parameter: str, scale: str = "1") -> str:
        """Of a law by command: slope and constant, and the values at the commands in order."""
        found = next(line for line in self.kept[run]["lines"] if line["parameter"] == parameter)
        values = ", ".join(f"{float(scale) * v:.3g}" for v in found["values"])
        return f"{float(scale) * found['slope']:.4g} v {float(scale) * found['zero']:+.4g}; {values}"

    def sensor(self) -> str:
        """Sensitivity and delta_1."""
        c = self.kept["calibrate"]
        most = max(t["delta_1"] for t in c["tests"])
        return f"{c['sensitivity']:.2f} pC/N, {100 * c['delta_1']:.2f} %, every test below {100 * most:.1f} %"

    def slopes(self) -> str:
        """Range of the tests' sensitivities."""
        found = [t["sensitivity"] for t in self.kept["calibrate"]["tests"]]
        return f"{max(found):.1f} to {min(found):.1f}"

    def phases(self) -> str:
        """Range of the charge's phase, degree."""
        phases = [t["phase"] for t in self.kept["calibrate"]["tests"]]
        return f"{min(phases):+.1f} to {max(phases):+.1f}"

    def sensing(self, name: str, *commands: str) -> str:
        """delta_2 in percent at each current."""
        rows = {row["command"]: row[name] for row in self.kept["calibrate"]["sensing"]}
        return ", ".join(f"{100 * rows[float(command)]:.2f}" for command in commands)

    def alone(self, name: str) -> str:
        """delta_2 in percent of one record."""
        return f"{100 * sensing_by_command([embedded('self_sensing')[name]])[0].delta_2:.2f}"

    def trial(self, run: str, search: str, key: str, value: str) -> str:
        """One step ahead on validation: median over the seeds and range, percent."""
        t = next(t for t in self.kept[run]["choice"][search] if _name(t, key) == value)
        low, high = t["validation_range"]["one_step_nrmse"]
        return f"{100 * t['validation']['one_step_nrmse']:.2f} ({100 * low:.2f} to {100 * high:.2f})"

    def best(self, run: str, search: str, key: str) -> str:
        """The candidate of the least median, and those whose range over the seeds overlaps its own."""
        by = f"{self.kept[run]['choice']['by']}_nrmse"
        trials = [t for t in self.kept[run]["choice"][search] if t["validation"][by] is not None]
        best = min(trials, key=lambda t: float(t["validation"][by]))
        most = best["validation_range"][by][1]
        near = [_name(t, key) for t in trials if t is not best and t["validation_range"][by][0] <= most]
        return _name(best, key) + (f" (tied: {', '.join(near)})" if near else "")

    def error(self, run: str, half: str, record: str, *ways: str) -> str:
        """RMS errors of a network (one_step, free_run), or that of a law, on a record."""
        found = self.kept[run][half]
        halves = [found[way] for way in ways] or [found]
        rows = [next(r for r in some["records"] if r["record"] == record) for some in halves]
        return ", then ".join(f"{r['rmse_N']:.1f} N, {100 * r['nrmse']:.2f} %" for r in rows)

    def pooled(self, run: str, half: str, way: str) -> str:
        """Of a half, percent."""
        return f"{100 * self.kept[run][half][way]['nrmse']:.1f}"

    def errors(self, run: str, half: str, way: str) -> str:
        """The same on all records of a half."""
        rows = self.kept[run][half][way]["records"]
        return "; ".join(f"{r['record']} {r['rmse_N']:.1f} N, {100 * r['nrmse']:.1f} %" for r in rows)

    def _word(self, text: str) -> str:
        name, *words = shlex.split(text)
        return str(getattr(self, name)(*words))


def _command(run: str) -> str:
    words = RUNS[run].format(data="FOLDER", work=".")
    return f"mrdamp {words}" + (" -o model.json" if words.startswith("identify") else "")


def _name(trial: Mapping[str, Any], key: str) -> str:
    return str(trial[key][0] if key == "hidden" else trial[key])


def run(name: str, data: Path | None) -> Any:
    """What a run's command prints as JSON."""
    WORK.mkdir(parents=True, exist_ok=True)
    words = [w.format(data=data, work=WORK) for w in shlex.split(RUNS[name])]
    if name in FEWER:
        make_foam.main(WORK / name, FEWER[name])
    out = ["-o", str(WORK / f"{name}.json")] if words[0] == "identify" else []
    print("mrdamp", shlex.join(words), flush=True)
    said = subprocess.run(
        [sys.executable, "-m", "mrdamp", *words, *out, "--json"],
        env=os.environ | KERNEL, stdout=subprocess.PIPE, check=True,
    )  # fmt: skip
    found = json.loads(said.stdout)
    found.pop("model", None)  # where the file lies here
    return small(found)


def small(value: Any) -> Any:
    """Without what no row needs, numbers to six digits."""
    if isinstance(value, dict):
        return {k: small(v) for k, v in value.items() if k not in _DROPPED}
    if isinstance(value, list):
        return [small(v) for v in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def pictures() -> None:
    """Fig. 7 of the foam-damper paper, Figs. 3 to 5 of the self-sensing paper; the others are pictures of runs."""
    foam, own, test = embedded("foam").test, embedded("self_sensing"), embedded_tests()[9]
    late = {f"{r.command[0]:g} V": r.part(1.0, r.time[-1]) for r in foam}
    loops = sensing.loops_by_command(
        {name: (r.displacement, r.velocity(), r.channel("force_N")) for name, r in late.items()}
    )
    save(loops, PAGES / "foam-loops.png")
    signals = sensing.calibration_signals(test.time, *(test.channel(name) for name in COLUMNS[1:]))
    save(signals, PAGES / "sensing-signals.png")
    currents = {f"{u:g} A": own[f"sine_5.0Hz_5.0mm_{u:.2f}A"].part(2.0, 2.8) for u in (0.0, 0.25, 0.5, 0.75, 1.0)}
    both = {k: (r.time, r.channel("reference_force_N"), r.channel("force_N")) for k, r in currents.items()}
    save(sensing.force_histories({k: both[k] for k in ("0 A", "0.5 A", "1 A")}), PAGES / "sensing-histories.png")
    loops = sensing.loops_by_command(
        {k: (r.displacement, r.velocity(), r.channel("force_N")) for k, r in currents.items()}
    )
    save(loops, PAGES / "sensing-loops.png")
    of_runs = ("foam-models", "sensing-choice", "sensing-constant-one_step", "sensing-varying-one_step")
    for name in (*of_runs, "sensing-varying_law"):
        if (WORK / f"{name}.png").exists():
            shrink(WORK / f"{name}.png", PAGES / f"{name}.png")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs what is asked for or missing, and renews both pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", help=f"of {', '.join(RUNS)}")
    parser.add_argument("--data", type=Path, help="folder that holds the measured sets")
    options = parser.parse_args(arguments)
    store = PAGES / "results.json"
    kept: dict[str, Any] = json.loads(store.read_text(encoding="utf-8")) if store.exists() else {}
    for name in options.runs or [name for name in RUNS if name not in kept]:
        if name not in RUNS:
            parser.error(f"no run {name}; there are {', '.join(RUNS)}")
        if "{data}" in RUNS[name] and options.data is None:
            parser.error(f"{name} is of measured records: give --data FOLDER")
        kept[name] = run(name, options.data)
        lines = ",\n".join(f'"{key}": {json.dumps(kept[key])}' for key in sorted(kept))
        store.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    pictures()
    results = Results(kept)
    for page in sorted(PAGES.glob("*.md")):
        page.write_text(results.fill(page.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
