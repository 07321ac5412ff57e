"""The command `mrdamp calibrate`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import OutFolder, Picture, add_command, add_json, check_written, save_picture
from mrdamp.commands.identify_json import reporting
from mrdamp.errors import InputError
from mrdamp.files import together

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mrdamp.identify.calibration import Calibration, SensingRow
    from mrdamp.records import Record

#: Ratio of amplitudes, N, that a picture shows as one.
_ALIKE = 1.1


def add_to(commands: Any) -> None:
    p = add_command(
        commands,
        "calibrate",
        reporting(run_calibrate),
        "the piezoelectric force sensor: sensitivity, phase and leakage, and the force of records from their charge",
        "mrdamp calibrate tests/ --records records/ -o out/sensor",
    )
    p.add_argument(
        "tests", nargs="*", type=Path,
        help="CSV files or a folder of sine tests, with time_s, reference_force_N and charge_pC (default: the embedded"
        " sixteen)",
    )  # fmt: skip
    p.add_argument(
        "--records",
        type=Path,
        help="damper records, whose force_N is made of charge_pC and compared with reference_force_N (default:"
        " self_sensing, for the embedded tests)",
    )
    p.add_argument(
        "--cutoff",
        type=float,
        help="Hz, low-pass; 0: none (default: 20, at least four times a test's frequency)",
    )
    p.add_argument("--picture", type=Picture, help="sensitivities by frequency (.svg, .png or .pdf)")
    p.add_argument("--put-back", action="store_true", help="correct the records' force for the leaked charge")
    p.add_argument(
        "-o", "--out", type=OutFolder, help="folder to write: index.html, and the records"
    )
    add_json(p)


def run_calibrate(a: argparse.Namespace) -> dict[str, Any]:
    """Prints sensitivity, deviation and phase by test, the sensor's response, and delta_2 per current; returns what
    `--json` prints."""
    from mrdamp.identify import calibration
    from mrdamp.records import read_records
    from mrdamp.records.checks import warnings_of

    if a.tests:
        tests = calibration.read_tests(a.tests[0] if len(a.tests) == 1 else a.tests)
    else:
        tests = calibration.embedded_tests()
    source = a.records or (None if a.tests else "self_sensing")
    given = read_records(source).whole if source else ()
    warnings = [*warnings_of(tests), *warnings_of(given)]
    for warning in warnings:
        print(f"check: {warning}", flush=True)
    found = calibration.calibrate(tests, a.cutoff)
    ordered = sorted(found.tests, key=lambda t: (round(t.frequency, 2), t.amplitude))
    found = replace(found, tests=tuple(ordered))
    _sensor(found)
    records = [
        calibration.with_force(r, found, a.put_back) if "charge_pC" in r.channels else r for r in given
    ]
    # Without a load cell there is a force all the same; with neither cell nor charge there is nothing to do.
    cell = any("reference_force_N" in r.channels for r in records)
    charged = any("charge_pC" in r.channels for r in records)
    rows = calibration.sensing_by_command(records) if records and (cell or not charged) else []
    if rows:
        print("own force against the load cell, delta_2 of Eq. (4), as recorded and with both low-passed at 20 Hz:")
    for row in rows:
        paper = calibration.PAPER_DELTA_2.get(-1.0 if row.command is None else row.command)
        said = f"  the paper's damper {100 * paper:.2f} %" if paper else ""
        print(f"  command {_name(row):>8s}  {100 * row.delta_2:6.2f} % {100 * row.filtered:6.2f} %"
              f"  {row.records} records{said}")  # fmt: skip
    if a.out:
        _write(a.out, tests, found, records, rows)
        print(f"page: {a.out / 'index.html'}")
    if a.picture:
        save_picture(_sensitivities(found), a.picture)
    report = asdict(found) | {"warnings": warnings, "sensing": [asdict(row) for row in rows]}
    for test in report["tests"]:
        del test["gain"]  # a complex number; amplitude and phase are beside it
    return report


def _sensor(found: Calibration) -> None:
    import numpy as np

    from mrdamp.identify.calibration import PAPER_DELTA_1, PAPER_SENSITIVITY

    print(f"{'frequency':>12s} {'amplitude':>10s} {'k, Eq. (1)':>14s} {'delta_1':>8s} {'phase':>8s}")
    for t in found.tests:
        print(
            f"{t.frequency:9.2f} Hz {t.amplitude:8.0f} N {t.sensitivity:9.2f} pC/N"
            f" {100 * t.delta_1:6.2f} % {t.phase:6.2f} deg"
        )
    print(f"mean sensitivity {found.sensitivity:.2f} pC/N, delta_1 with it {100 * found.delta_1:.2f} %"
          f" (the paper's sensor: {PAPER_SENSITIVITY} pC/N, {100 * PAPER_DELTA_1:.2f} %)")  # fmt: skip
    if found.leakage_tau and found.delay and found.loss_angle and found.dynamic_sensitivity:
        print("sensitivity above the leakage, by amplitudes: {:.2f} pC/N, 95 % {:.2f} to {:.2f}".format(
            *found.dynamic_sensitivity))  # fmt: skip
        tau, low, high = found.leakage_tau
        said = (
            f"{tau:.4g} s, 95 % {low:.4g} to {high:.4g} s"
            if np.isfinite(high)
            else f"not shown; above {low:.4g} s"
        )
        print(f"charge leakage: time constant {said}")
        print(
            "delay of the charge: {:.3f} ms, 95 % {:.3f} to {:.3f} ms".format(*(1e3 * d for d in found.delay))
        )
        print("lag at every frequency: {:.3f} degree, 95 % {:.3f} to {:.3f}".format(*found.loss_angle))
    else:
        print("phase, leakage and delay cannot be told apart: tests at three frequencies are needed")


def _sensitivities(found: Calibration) -> Figure:
    """Tests whose amplitudes differ by less than _ALIKE have one colour: a machine does not repeat them exactly."""
    import numpy as np

    from mrdamp.pictures.identification import sensitivities

    rows, group = [], 0.0
    for t in sorted(found.tests, key=lambda t: t.amplitude):
        group = group if group and t.amplitude < _ALIKE * group else float(f"{t.amplitude:.2g}")
        rows.append((t.frequency, group, t.sensitivity, t.delta_1))
    frequency, amplitude, sensitivity, deviation = np.array(rows).T
    return sensitivities(frequency, amplitude, sensitivity, deviation, found.sensitivity)


def _name(row: SensingRow) -> str:
    return "varying" if row.command is None else f"{row.command:g}"


def _write(
    folder: Path, tests: Sequence[Record], found: Calibration, records: Sequence[Record],
    rows: Sequence[SensingRow],
) -> None:  # fmt: skip
    """The page, with Figs. 3 to 5 of the self-sensing paper, and the records with their force from the charge."""
    import numpy as np

    from mrdamp.identify.calibration import COLUMNS, PAPER_DELTA_2
    from mrdamp.pictures import identification as pictures
    from mrdamp.report import Page

    page = Page(
        "The damper's own force sensor",
        f"{found.sensitivity:.2f} pC/N from {len(tests)} tests, delta_1 with it {100 * found.delta_1:.2f} %.",
    )
    head = ("test", "frequency (Hz)", "amplitude (N)", "k (pC/N)", "delta_1 (%)", "phase (deg)")
    page.table("Calibration", head, [
        (t.name, t.frequency, t.amplitude, t.sensitivity, 100 * t.delta_1, t.phase) for t in found.tests
    ], "Sensitivity by Eq. (1) and its deviation by Eq. (2). The amplitude is the mean after the first period, less"
       " than the test's where the run-up is longer. The phase is that of the charge against the force, its"
       " sign taken off; a charge that lags by an angle has the sine of it as delta_1.")  # fmt: skip
    page.figure("", _sensitivities(found), "Sensitivity and deviation of each test.",
                "Sensitivities over the frequency.")  # fmt: skip
    test = tests[len(tests) // 2]
    page.figure("", pictures.calibration_signals(test.time, *(test.channel(n) for n in COLUMNS[1:])),
                f"Force and charge of the test {test.name}.", "Force and charge over time.")  # fmt: skip
    if rows:
        page.table("Force from the charge", ("command", "delta_2 (%)", "at 20 Hz (%)", "records", "paper (%)"), [
            (_name(r), 100 * r.delta_2, 100 * r.filtered, r.records,
             100 * PAPER_DELTA_2[r.command] if r.command in PAPER_DELTA_2 else None) for r in rows
        ], "Against the load cell, Eq. (4): as recorded, and with both forces low-passed at 20 Hz.")  # fmt: skip
    both = [r for r in records if {"force_N", "reference_force_N"} <= set(r.channels)]
    strongest: dict[float, Record] = {}
    for r in sorted(both, key=lambda r: float(np.std(r.channel("force_N")))):
        strongest[float(np.round(np.median(r.command), 3))] = r
    if strongest:
        late = {f"{u:g}, {r.name}": r.part(r.time[r.n // 2], r.time[-1]) for u, r in sorted(strongest.items())}
        page.figure("", pictures.force_histories({
            name: (r.time, r.channel("reference_force_N"), r.channel("force_N")) for name, r in late.items()
        }), "The load cell and the damper's own sensor, the strongest record of each command.", "Forces over time.")
        page.figure("", pictures.loops_by_command({
            name: (r.displacement, r.velocity(), r.channel("force_N")) for name, r in late.items()
        }), "The damper's own force, the same records.", "Force over displacement and over velocity.")
    made = {folder / "records" / f"{r.name}.csv": r for r in records if "charge_pC" in r.channels}
    if len(made) < sum("charge_pC" in r.channels for r in records):
        raise InputError(f"{folder / 'records'}: two records have one name; rename one")
    inputs = [r.path for r in records if r.path]
    check_written([*made, folder / "records"], [*inputs, *(path.parent for path in inputs)])
    (folder / "records" if made else folder).mkdir(parents=True, exist_ok=True)
    with together():
        for path, r in made.items():
            r.save(path)
        page.write(folder / "index.html")
