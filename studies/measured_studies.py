"""Diagnoses simulators that lack something on measured records: `python -m studies.measured_studies [NAME ...]`.

Each study identifies a law without an effect that its rig has, diagnoses it on the training records, and evaluates
the corrected simulator on the validation records, which neither step used. Writes out/measured/NAME/ (model, case,
diagnosis, page) and studies/measured.json. The data are read from ../shared/data or the folder MRDAMP_DATA.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrdamp.cli import main as mrdamp
from mrdamp.files import write_atomic
from mrdamp.identify import identify
from mrdamp.model import Model
from mrdamp.records import Record, RecordSet, embedded, read_records
from mrdamp.records.csv_file import render

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "studies" / "measured.json"
OUT = ROOT / "out" / "measured"
_SKIP = 0.1  # s that do not count, as in the diagnosis


@dataclass(frozen=True)
class Study:
    """records: a folder of the measured data, empty for the embedded set. law: identified without any effect.
    constant: from tests at constant command alone, and diagnosed on the others. missing: what the rig has, or may."""

    records: str
    law: str
    missing: str
    constant: bool = False


STUDIES: Mapping[str, Study] = {
    "embedded": Study("", "bouc_wen", "what a changing current shows", constant=True),
    "utfsm": Study("utfsm", "bingham", "hysteresis"),
    "utfpr": Study("utfpr", "bouc_wen", "the force's offset"),
    "nees": Study("nees", "modified_bouc_wen", "offset, stiffness and the command's lag"),
}


def data(study: Study) -> RecordSet | None:
    """The study's records, None where they are not to be had."""
    if not study.records:
        return embedded()
    folder = Path(os.environ.get("MRDAMP_DATA", ROOT.parent / "shared" / "data")) / study.records
    return read_records(folder) if folder.is_dir() else None


def gap(model: Model, records: Sequence[Record]) -> float:
    """RMS error over the RMS of the force, records pooled."""
    parts = []
    for r in records:
        inputs = {"displacement_m": r.displacement, "command": r.command}
        force, skip = r.channel("force_N"), round(_SKIP / r.sample_time)
        error = (model.simulate(r.sample_time, inputs)["force_N"] - force)[skip:]
        parts.append(np.mean(error**2) / np.mean(force[skip:] ** 2))
    return float(np.sqrt(np.mean(parts)))


def run(name: str, study: Study) -> dict[str, object] | None:
    """One study; None where its data are not there."""
    found = data(study)
    if found is None:
        return None
    folder = OUT / name
    fitted = [r for r in found.train if not study.constant or not _varies(r)]
    shown = [r for r in found.train if _varies(r)] if study.constant else list(found.train)
    judged = [r for r in found.validation if not study.constant or _varies(r)]
    folder.mkdir(parents=True, exist_ok=True)
    nominal = identify(study.law, fitted, extras=()).model
    nominal.write(folder / "nominal.json")
    files = []
    for r in shown:
        files.append(folder / "records" / f"{r.name}.csv")
        files[-1].parent.mkdir(exist_ok=True)
        write_atomic(files[-1], render(r.channels))
    case, out = folder / "case", folder / "diagnosis"
    if not case.exists() and mrdamp(
        ["case", str(folder / "nominal.json"), *map(str, files), "-o", str(case)]
    ):
        raise SystemExit(2)
    if mrdamp(["diagnose", str(case), "-o", str(out)]):
        raise SystemExit(2)
    answer = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    corrected = Model.read(out / "corrected.json")
    return {
        "law": study.law,
        "missing": study.missing,
        "records": [len(fitted), len(shown), len(judged)],
        "sentence": answer["sentence"],
        "verdict": answer["verdict"],
        "effects": [{k: e[k] for k in ("name", "probability", "parameters")} for e in answer["effects"]],
        "tied": answer["indistinguishable"],
        "inside": answer["gap"],
        "unseen_tests": {"nominal": gap(nominal, judged), "corrected": gap(corrected, judged)},
        "seconds": answer.get("seconds"),
    }


def _varies(record: Record) -> bool:
    return float(np.ptp(record.command)) > 1e-3


def main() -> int:
    results = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    for name in sys.argv[1:] or STUDIES:
        found = run(name, STUDIES[name])
        if found is None:
            print(f"{name}: no data; MRDAMP_DATA names the folder that holds {STUDIES[name].records}/")
            continue
        results[name] = found
        RESULTS.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(RESULTS, json.dumps(results, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
