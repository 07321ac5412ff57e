"""The command `mrdamp calibrate`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import add_command
from mrdamp.commands.output import Picture, save_picture

if TYPE_CHECKING:
    from mrdamp.records import Record


def add_calibrate(commands: Any) -> None:
    """Adds `calibrate`."""
    p = add_command(
        commands,
        "calibrate",
        run_calibrate,
        "the piezoelectric force sensor: sensitivity, phase and leakage from charge, and its error per current",
        "mrdamp calibrate tests/ --records records/",
    )
    p.add_argument(
        "tests", nargs="*", type=Path, help="CSV files or a folder (default: the 16 embedded tests)"
    )
    p.add_argument(
        "--records",
        type=Path,
        help="damper records with force_N and reference_force_N (default: embedded, for the embedded tests)",
    )
    p.add_argument(
        "--cutoff",
        type=float,
        help="Hz, low-pass; 0 is none (default: 20, or four times a test's frequency where that is more)",
    )
    p.add_argument("--picture", type=Picture, help="sensitivities by frequency (.svg, .png or .pdf)")


def run_calibrate(a: argparse.Namespace) -> int:
    """Prints sensitivity, deviation and phase by test, the sensor's response, and delta_2 per current."""
    import numpy as np

    from mrdamp.identify import calibration
    from mrdamp.pictures.identification import sensitivities
    from mrdamp.records import embedded, read_records

    if a.tests:
        tests = calibration.read_tests(a.tests[0] if len(a.tests) == 1 else a.tests)
    else:
        tests = calibration.embedded_tests()
    found = calibration.calibrate(tests, a.cutoff)
    print(f"{'frequency':>12s} {'amplitude':>10s} {'k, Eq. (1)':>14s} {'delta_1':>8s} {'phase':>8s}")
    for t in found.tests:
        print(
            f"{t.frequency:9.2f} Hz {t.amplitude:8.0f} N {t.sensitivity:9.2f} pC/N"
            f" {100 * t.delta_1:6.2f} % {t.phase:6.2f} deg"
        )
    print(f"mean sensitivity {found.sensitivity:.2f} pC/N, delta_1 with it {100 * found.delta_1:.2f} %"
          " (the paper's sensor: -158.248 pC/N, 2.35 %)")  # fmt: skip
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
    if a.records or not a.tests:
        _sensing((read_records(a.records) if a.records else embedded()).records)
    if a.picture:
        data = np.array([(t.frequency, t.amplitude, t.sensitivity, t.delta_1) for t in found.tests]).T
        nominal = np.round(data[1], -2)
        save_picture(sensitivities(data[0], nominal, data[2], data[3], found.sensitivity), a.picture)
    return 0


def _sensing(records: Sequence[Record]) -> None:
    from mrdamp.identify import calibration

    rows = calibration.sensing_by_command(records)
    print("own force against the load cell, delta_2 of Eq. (4) (the paper: 3.89 % at 0 A to 2.30 % at .5 A):")
    for row in rows:
        name = "varying" if row.command is None else f"{row.command:g}"
        print(f"  command {name:>8s}  {100 * row.delta_2:6.2f} %  {row.records} records")
