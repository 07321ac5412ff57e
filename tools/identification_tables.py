"""Renews docs/identification/README.md: runs the commands that it shows, and writes the tables and pictures of a set
between `<!-- SET -->` and `<!-- end -->`.

    python tools/identification_tables.py embedded
    python tools/identification_tables.py --data FOLDER utfsm utfpr nees

FOLDER holds a folder of records per set. A model that lies in out/identification already is not fitted again.
"""

from __future__ import annotations

import argparse
import io
import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from identification_sets import LAWS, SETS, VARYING, Page, Row, Table
from matplotlib.figure import Figure
from PIL import Image

from mrdamp.cli import main as mrdamp
from mrdamp.identify import error, identify, pooled, simulate
from mrdamp.identify.fit import error_of
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.narx.data import series
from mrdamp.narx.evaluation import one_step_error
from mrdamp.narx.network import Network
from mrdamp.narx.splits import cut_varying
from mrdamp.pictures.identification import model_loops
from mrdamp.records import Record, RecordSet, embedded, read_records

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "docs" / "identification"
WORK = ROOT / "out" / "identification"


def records_of(name: str, data: Path | None, cutoff: float | None) -> RecordSet:
    """The set, its displacement low-passed at a cut-off (Hz)."""
    records = embedded() if name == "embedded" else read_records(_folder(name, data))
    return records if cutoff is None else records.smoothed(cutoff)


def command(name: str, row: Row, cutoff: float | None, folder: str) -> list[str]:
    """The arguments of `mrdamp` that make a row's model; folder: where the sets lie."""
    where = [] if name == "embedded" else [f"{folder}/{name}"]
    smooth = [] if cutoff is None else ["--cutoff", f"{cutoff:g}"]
    return ["identify", *where, *row.arguments, *smooth, "-o", f"{row.file}.json"]


def run(name: str, row: Row, cutoff: float | None, data: Path | None) -> Model:
    """The row's model, fitted where its file is missing."""
    folder = WORK / name
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{row.file}.json"
    if not path.exists():
        arguments = command(name, row, cutoff, str(data))
        arguments[-1] = str(path)
        arguments = [str(folder / a) if a.endswith(".png") else a for a in arguments]
        print("mrdamp", shlex.join(arguments), flush=True)
        if code := mrdamp(arguments):
            raise SystemExit(code)
    return Model.read(path)


def commands(name: str, t: Table) -> list[str]:
    """What makes the models of a table; laws whose commands differ in nothing else share a line."""
    laws: dict[str, list[str]] = {}
    for row in t.rows:
        law = row.arguments[1]
        words = "mrdamp " + shlex.join(command(name, row, t.cutoff, "records"))
        laws.setdefault(words.replace(law, "${law}"), []).append(law)
    return [
        f"for law in {' '.join(some)}; do {words}; done" if some[1:] else words.replace("${law}", some[0])
        for words, some in laws.items()
    ]


def table(name: str, t: Table, data: Path | None) -> tuple[list[str], dict[str, Model]]:
    """The lines of a table, and its models by file name."""
    records = records_of(name, data, t.cutoff)
    if t.protocol == "varying":
        records = cut_varying(records, VARYING)
    lines = [f"### {t.title}", "", t.text, "", "```"]
    lines += [*commands(name, t), "```", ""]
    head = ["model", "fitted records", "held-out records"]
    head += ["held out at the network's rate"] if t.sample_time else []
    head += [f"without {t.without}"] if t.without else []
    head += ["held out, one step ahead"] if t.one_step else []
    head += ["reference"] if any(row.mark is not None for row in t.rows) else []
    lines += ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    models = {row.file: run(name, row, t.cutoff, data) for row in t.rows}
    for row in t.rows:
        model = models[row.file]
        fitted, new = ([error(model, r) for r in half] for half in (records.train, records.validation))
        values: list[float | None] = [pooled(fitted), pooled(new)]
        if t.sample_time:
            rest = [slower(r, t.sample_time) for r in records.validation]
            values.append(pooled([error_of(r, "force_N", force_of(model, r)) for r in rest]))
        if t.without:
            values.append(pooled([e for e in new if t.without not in e.record]))
        if t.one_step:
            values.append(one_step(model, records.validation))
        values += [row.mark] if "reference" in head else []
        lines.append("| " + " | ".join([row.name, *("" if v is None else f"{v:.3f}" for v in values)]) + " |")
    lines += [""]
    return lines, models


def one_step(model: Model, records: Sequence[Record]) -> float | None:
    """Error of a network one step ahead; None for a law, which has no such prediction."""
    if model.weights is None:
        return None
    network = Network.from_text(model.weights)
    return pooled([one_step_error(network, series(r, network.sample_time)) for r in records])


def force_of(model: Model, record: Record) -> Array:
    """Force (n,) N in free run; on a record of `slower` with its low-passed velocity, no central difference."""
    if record.path or "velocity_m_s" not in record.channels:
        return simulate(model, record)
    given = {name: record.channel(name) for name in ("displacement_m", "velocity_m_s", "command")}
    return model.simulate(record.sample_time, given)["force_N"]


def slower(record: Record, sample_time: float) -> Record:
    """The record as a network of this sample time (s) is trained on it: every channel but the command low-passed."""
    s = series(record, sample_time)
    channels = {"displacement_m": s.x, "velocity_m_s": s.v, "command": s.i, "force_N": s.force}
    return Record(record.name, None, sample_time, channels)


def left_out(name: str, page: Page, records: RecordSet) -> list[str]:
    """Each law fitted without one motion of all records and evaluated on it, as the reference (one start, quadratic)"""
    store = WORK / name / "left_out.json"
    found: dict[str, list[float]] = json.loads(store.read_text()) if store.exists() else {}
    for law in LAWS:
        if law in found:
            continue
        parts = []
        for motion in page.left_out:
            train = [r for r in records if motion not in r.name]
            held = [r for r in records if motion in r.name]
            parts.append(identify(law, train, held, dependence="quadratic", starts=1, threads=1))
        values = [fit.held_out_nrmse for fit in parts]
        values += [pooled([e for fit in some for e in fit.held_out]) for some in (parts[:-1], parts)]
        found[law] = [round(value, 3) for value in values]
        store.write_text(json.dumps(found))
    text = "Fitted to the other motions, nearest to the reference's tests. One start, quadratic in the current."
    head = ["law", *page.left_out, f"all but {page.left_out[-1]}", "all", "reference"]
    lines = ["### One motion left out", "", text, "", f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    marks = {row.file: row.mark for row in page.tables[0].rows}
    for law in LAWS:
        cells = [law.replace("_", " "), *(f"{v:.3f}" for v in found[law]), f"{marks[law]:.3f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def loops(path: Path, record: Record, models: Mapping[str, Model], rows: Mapping[str, str]) -> str:
    """Writes the picture of loops of models (files and their names in rows); returns its line."""
    forces = {rows[file]: force_of(models[file], record) for file in rows}
    fig = model_loops(record.time, record.displacement, record.velocity(), record.channel("force_N"), forces)
    save(fig, path)
    return f"![Loops of record {record.name}]({path.name})"


def save(fig: Figure, path: Path) -> None:
    """A small PNG: few colours in lines and letters."""
    stream = io.BytesIO()
    fig.savefig(stream, format="png", dpi=150)
    shrink(stream, path)


def shrink(source: io.BytesIO | Path, path: Path) -> None:
    """A PNG with a palette."""
    with Image.open(source) as image:
        image.convert("RGB").quantize(64).save(path, optimize=True)


def write(name: str, data: Path | None) -> None:
    """Renews a set's section."""
    page = SETS[name]
    lines = [f"## {page.title}", "", page.text, ""]
    models: dict[str, Model] = {}
    for t in page.tables:
        more, found = table(name, t, data)
        lines += more
        models |= found
    if page.left_out:
        lines += left_out(name, page, records_of(name, data, None))
    for count, (record, files) in enumerate(page.loops):
        names = {row.file: row.name for t in page.tables for row in t.rows if row.file in files}
        path = PAGES / (f"{name}-loops-{count + 1}.png" if count else f"{name}-loops.png")
        measured = records_of(name, data, page.tables[0].cutoff)[record]
        rate = next((t.sample_time for t in page.tables if t.sample_time), None)
        lines += [loops(path, slower(measured, rate) if rate else measured, models, names), ""]
    for file in page.shown:
        row = next(row for t in page.tables for row in t.rows if row.file == file)
        for picture in sorted((WORK / name).glob(f"{file}*.png")):
            shrink(picture, PAGES / f"{name}-{picture.name}")
            lines += [f"![{row.name}: {picture.stem.split('-')[-1]}]({name}-{picture.name})", ""]
    path = PAGES / "README.md"
    before, begin, rest = path.read_text(encoding="utf-8").partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition("<!-- end -->")
    path.write_text("\n".join([before + begin, *lines]) + end + after, encoding="utf-8")


def _folder(name: str, data: Path | None) -> Path:
    if data is None or not (data / name).is_dir():
        raise SystemExit(f"{name}: no folder of its records; give --data FOLDER with {name}/train in it")
    return data / name


def main(arguments: Sequence[str] | None = None) -> int:
    """Renews the sections of the given sets."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sets", nargs="*", default=["embedded"], help=f"of {', '.join(SETS)}")
    parser.add_argument("--data", type=Path, help="folder that holds the measured sets")
    options = parser.parse_args(arguments)
    for name in options.sets:
        if name not in SETS:
            parser.error(f"no set {name}; there are {', '.join(SETS)}")
    for name in options.sets:
        write(name, options.data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
