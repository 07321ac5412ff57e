"""The commands on the gap between a simulator and a rig: `mrdamp case`, `diagnose`, `sensitivity` and `gap`."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from pathlib import Path
from typing import Any

from mrdamp.commands import (
    HOLD,
    OutFolder,
    add_command,
    add_jobs,
    progress_bar,
    seed,
    show_progress,
)
from mrdamp.errors import InputError
from mrdamp.sets import named_model

#: Size of a channel over the simulator's, or its inverse, from which its unit is asked for: a g is 9.8 m/s2.
_UNLIKE = 5.0
#: How many times as much of a floor's acceleration the simulator's leaves with the ground's as without it, from which
#: it was measured relative to the table. Of 18 frames of other makers the most is .99; with such channels they have
#: 1.01 to 324.
_RELATIVE = 2.0


def add_to(commands: Any) -> None:
    """Adds case, diagnose, sensitivity and gap to the subparsers of an argparse parser."""
    p = add_command(
        commands,
        "case",
        run_case,
        "put a model and the records that it should match into a folder for `mrdamp diagnose`",
        "mrdamp case model.json records/*.csv -o case",
    )
    p.add_argument("model", help="a model file, or the name of a parameter set")
    p.add_argument("records", type=Path, nargs="+", help="record files, or folders of them")
    p.add_argument("--repeat", type=Path, nargs="+", default=[], help="records that repeat an earlier test")
    p.add_argument(
        "--baseline",
        type=Path,
        nargs="+",
        default=[],
        help="records of the rig before the change, or folders of them",
    )
    p.add_argument(
        "--hold",
        choices=HOLD,
        help="hold the command between samples, or interpolate linearly (default: the model's, else found)",
    )
    p.add_argument("-o", "--out", type=OutFolder, required=True, help="folder to write; it must not exist")

    p = add_command(
        commands,
        "diagnose",
        run_diagnose,
        "why the simulator and the rig differ: where, which cause, and the corrected simulator",
        "mrdamp diagnose case/ -o out/case",
    )
    p.add_argument("case", type=Path, help="folder with a case.json and its records")
    p.add_argument("-o", "--out", type=OutFolder, required=True, help="folder to write")
    add_jobs(p, default=None)

    p = add_command(
        commands,
        "sensitivity",
        run_sensitivity,
        "detection limits of a diagnosis on your rig, from effects of several sizes injected into its records",
        "mrdamp sensitivity case/ -o out/sensitivity --jobs 2",
    )
    p.add_argument("case", type=Path, help="folder with a case.json and its records (rig damper)")
    p.add_argument(
        "-o", "--out", type=OutFolder, required=True, help="folder to write; an interrupted run continues"
    )
    p.add_argument("--effects", nargs="+", default=[], metavar="NAME", help="of the catalogue (default: all)")
    p.add_argument(
        "--sizes",
        nargs="+",
        type=float,
        metavar="SHARE",
        help="change of the simulator's residual over the RMS force (default: 0.02 0.05 0.15 0.4)",
    )
    add_jobs(p)
    p.add_argument(
        "--seed", type=seed, default=0, help="of the effects' signs and shapes (default: %(default)s)"
    )

    p = add_command(
        commands,
        "gap",
        run_gap,
        "what the gap of a measured frame costs a controller, and how much of it a diagnosis recovers",
        "mrdamp gap case/ --controller force-tracking -o out/gap",
    )
    p.add_argument("case", type=Path, help="case folder of a measured frame, for which its corrected simulator stands")
    add_options(p)
    p.add_argument(
        "-o", "--out", type=OutFolder, required=True,
        help="folder for gap.json, diagnosis.txt and corrected.json",
    )  # fmt: skip


def run_case(a: argparse.Namespace) -> int:
    """Reads everything first, then writes the folder."""
    from mrdamp.diagnosis.case.audit import of_frame
    from mrdamp.diagnosis.case.folder import against, read_case
    from mrdamp.identify.provenance import IDENTIFIED_ON
    from mrdamp.records import read_record, record_files
    from mrdamp.records.checks import warnings_of
    from mrdamp.records.division import refuse_copies
    from mrdamp.simulation.predict import INPUTS, clamped

    if a.out.exists():
        raise InputError(f"{a.out}: there is one already; give another folder")
    model = named_model(a.model)
    required = INPUTS[model.rig]
    files = [f for path in a.records for f in record_files(path)]
    names = {file: file.name for file in files}
    for file in a.repeat:
        names[file] = file.name if "repeat" in file.name.lower() else f"repeat_{file.name}"
    untouched = {f: f"baseline_{f.name}" for path in a.baseline for f in record_files(path)}
    if both := [str(f) for f in untouched if f in names]:
        raise InputError(f"case: --baseline: {', '.join(both)} is among the records too")
    names |= untouched
    if len(set(names.values())) < len(names):
        raise InputError("case: two records have the same file name; rename one of them")
    records = {file: read_record(file, required=required) for file in names}
    refuse_copies(list(records.values()))
    shared = [
        c for c in next(iter(records.values())).channels if all(c in r.channels for r in records.values())
    ]
    some = dict.fromkeys(c for r in records.values() for c in r.channels if c not in shared)
    checks = [f"{', '.join(some)}: not in all records; left out"] if some else []
    if model.structure is not None:
        floors = [f"floor{j}" for j in range(1, model.structure.storeys + 1)]
        above = [c for c in shared if c.startswith("floor") and c.partition("_")[0] not in floors]
        checks += [f"{', '.join(above)}: the model has {len(floors)} storeys; left out"] if above else []
    rates = {round(1 / r.sample_time, 6) for r in records.values()}
    body = model.to_dict()["model"]
    data: dict[str, Any] = {"name": a.out.name, "format": 1, "rig": model.rig}
    if len(rates) == 1:
        data["sample_rate_hz"] = next(iter(rates))
    hold = HOLD.get(a.hold, model.hold)
    if hold is not None:
        data["hold"] = hold
    data |= {
        "nominal": body,
        "channels": shared,
        "records": [n for f, n in names.items() if f not in untouched],
    }
    if IDENTIFIED_ON in model.extra:
        data[IDENTIFIED_ON] = model.extra[IDENTIFIED_ON]
    if untouched:
        data["baseline"] = list(untouched.values())
    a.out.mkdir(parents=True)
    try:
        for file, name in names.items():
            shutil.copyfile(file, a.out / name)
        (a.out / "case.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        case = read_case(a.out)  # what `mrdamp diagnose` would refuse is refused here
    except InputError as error:
        shutil.rmtree(a.out, ignore_errors=True)
        given = {str(a.out / name): str(file) for file, name in names.items()} | {str(a.out / "case.json"): str(a.out)}
        told = next((str(error).replace(copy, file) for copy, file in given.items() if copy in str(error)), str(error))
        raise InputError(told) from None
    except BaseException:
        shutil.rmtree(a.out, ignore_errors=True)
        raise
    found = against(model, case.records)
    unlike = [name for name, (ratio, *_) in found.items() if not 1 / _UNLIKE < ratio < _UNLIKE]
    ground = all(name in unlike for name in found if name.startswith("floor")) and model.rig == "frame"
    which = "the ground's unit, or its own" if ground else "its unit"
    checks += [f"{name} is {found[name][0]:.2g} times that of the simulator: check {which}" for name in unlike]
    checks += [
        f"{name} is rather that of the simulator relative to the table: give the absolute acceleration"
        for name, (_, alike, less) in found.items()
        if 1 - alike**2 > _RELATIVE * abs(1 - less**2)
    ]
    if len(rates) > 1:
        checks.append(f"records at {', '.join(f'{rate:g}' for rate in sorted(rates))} Hz")
    checks += [f"{r.label}: {said}" for r in records.values() if (said := clamped(model, r))]
    for check in [*checks, *warnings_of(list(records.values())), *of_frame(list(records.values()))]:
        print(f"check: {check}")
    print(a.out / "case.json")
    return 0


def run_diagnose(a: argparse.Namespace) -> int:
    """Diagnoses a case, writes diagnosis.json, corrected.json, its MJCF and a page, prints sentence and table."""
    import numpy as np

    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.diagnosis.report.handover import hand_over
    from mrdamp.diagnosis.report.page import page
    from mrdamp.diagnosis.report.sentence import table
    from mrdamp.diagnosis.run import diagnose
    from mrdamp.files import together, write_atomic
    from mrdamp.records.csv_file import render

    if a.jobs is not None and a.jobs < 1:
        raise InputError(f"--jobs is {a.jobs}; at least 1")
    case = read_case(a.case)
    a.out.mkdir(parents=True, exist_ok=True)
    found = diagnose(case, jobs=a.jobs or os.cpu_count() or 1, progress=show_progress)
    with together():
        found.corrected.write(a.out / "corrected.json")
        found = hand_over(found, case.records, a.out / "mjcf")
        if found.next_signal is not None:
            write_atomic(a.out / "next_experiment.csv", render(found.next_signal))
        write_atomic(a.out / "arrays.npz", lambda file: np.savez_compressed(file, **found.pictures))
        write_atomic(a.out / "diagnosis.json", json.dumps(found.to_dict(), indent=1) + "\n")
        page(found, case.model, case.records).write(a.out / "index.html")
    print(found.sentence)
    print(table(found))
    print(f"page: {a.out / 'index.html'}")
    return 0


def run_sensitivity(a: argparse.Namespace) -> int:
    """Diagnoses every trial that has no answer yet; the page and the JSON are renewed after each."""
    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.diagnosis.injection.page import page
    from mrdamp.diagnosis.injection.sensitivity import SIZES, Study, run_study
    from mrdamp.diagnosis.injection.summary import sentence, table, to_dict
    from mrdamp.files import together, write_atomic

    if a.jobs < 1 or a.seed < 0:
        raise InputError("--jobs must be at least 1 and --seed not negative")
    study = Study.of(read_case(a.case), a.effects, a.sizes or SIZES, a.seed)
    answers, largest = [], max(t.size for t in study.trials)
    first = sum(t.size in (0.0, largest) for t in study.trials)
    with progress_bar() as progress:
        for answers in run_study(study, a.out, a.jobs, progress):
            with together():
                write_atomic(a.out / "sensitivity.json", json.dumps(to_dict(study, answers), indent=1) + "\n")
                page(study, answers).write(a.out / "index.html")
            if len(answers) == first:
                print(f"from the largest size alone: {sentence(study, answers)}", file=sys.stderr, flush=True)
    print(sentence(study, answers))
    print(table(study, answers))
    print(f"page: {a.out / 'index.html'}")
    return 1 if any(found.error for found in answers) else 0


def add_options(p: argparse.ArgumentParser) -> None:
    """Those of `Options`, and the number of processes."""
    p.add_argument(
        "--controller",
        default="clipped-optimal",
        help="a kind, tuned in each simulator; one with options; policy:FILE; or a policy trained in each: learned, "
        "learned:algorithm=ppo,timesteps=200000 (default: %(default)s)",
    )
    p.add_argument("--loads", type=int, default=4, help="unseen motions (default: %(default)s)")
    p.add_argument("--seed", type=seed, default=1, help="of random numbers (default: %(default)s)")
    add_jobs(p, default=2)


def run_gap(a: argparse.Namespace) -> int:
    """Diagnoses the case, runs the controller in its simulators, prints and writes what the gap costs."""
    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.gap import Options, of_case, rows

    options = Options(a.controller, a.loads, a.seed)
    case = read_case(a.case)
    with progress_bar() as progress:
        found = of_case(options, case, a.out, jobs=a.jobs, progress=progress)
    for name, value in rows(found):
        print(f"{name:42s} {value}")
    return 0
