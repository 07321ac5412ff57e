"""The command `mrdamp inverse`: from wanted force to command, trained and evaluated in MuJoCo."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import (
    OutFolder,
    Picture,
    add_command,
    add_jobs,
    add_json,
    progress_bar,
    refuse_unused,
    save_picture,
    seed,
)
from mrdamp.errors import InputError
from mrdamp.sets import named_model

if TYPE_CHECKING:
    from mrdamp.inverse.rig import Trial


def add_to(commands: Any) -> None:
    p = add_command(
        commands,
        "inverse",
        run_inverse,
        "wanted force -> command: train inverse models of a damper and evaluate their force tracking in MuJoCo",
        "mrdamp inverse model.json --records records/ -o out/inverse",
    )
    p.add_argument(
        "model", help="the model of the damper: a model file, or the name of a parameter set"
    )
    p.add_argument("--plant", help="the controlled damper (default: MODEL with the effects of a rig)")
    p.add_argument(
        "--records",
        nargs="+",
        type=Path,
        help="files or one folder, to train on (default: made of the plant)",
    )
    p.add_argument("--law", help="identify and invert this law in place of MODEL")
    p.add_argument("--network", type=Path, help="a trained inverse (network.json of another run)")
    p.add_argument("--no-network", action="store_true", help="leave the network out")
    p.add_argument(
        "--exact", action="store_true", help="also the plant's own inverse, as a limit (slow)"
    )
    p.add_argument("--commands", nargs=2, type=float, metavar=("LOW", "HIGH"), help="range of the command")
    p.add_argument("--stroke", type=float, help="RMS of the random displacement, m (default: the records')")
    p.add_argument("--band", nargs=2, type=float, default=(0.5, 5.0), metavar=("LOW", "HIGH"),
                   help="its frequencies with --stroke, Hz (default: 0.5 5)")  # fmt: skip
    p.add_argument("--seconds", type=float, default=20.0, help="of each run (default: %(default)s)")
    p.add_argument("--seed", type=seed, default=0, help="of random numbers (default: %(default)s)")
    add_jobs(p, "--workers")
    p.add_argument("--command-unit", choices=("A", "V"),
                   help="of the command (default: that of a parameter set, else A)")  # fmt: skip
    p.add_argument("--picture", type=Picture, help="wanted and true force (.svg, .png or .pdf)")
    add_json(p)
    p.add_argument("-o", "--out", type=OutFolder, required=True, help="folder to write")


def run_inverse(a: argparse.Namespace) -> int:
    """Trains, tracks, prints the table and writes page, picture and network."""
    from mrdamp import sets
    from mrdamp.files import together
    from mrdamp.inverse.network import NetworkInverse
    from mrdamp.inverse.rig import draw, trial, write_page
    from mrdamp.inverse.tracking import RandomMotion
    from mrdamp.records import read_records

    if not 2.0 <= a.seconds <= 3600.0:
        raise InputError(f"--seconds is {a.seconds:g}; allowed: 2 to 3600")
    if a.network and a.no_network:
        raise InputError("--network and --no-network exclude each other")
    if a.stroke is None:
        refuse_unused(a, "is for --stroke", band=(0.5, 5.0))
    if a.json and a.picture:
        raise InputError("--json and --picture exclude each other")
    records = None
    if a.records:
        records = read_records(a.records[0] if len(a.records) == 1 else a.records)
    network = NetworkInverse.read(a.network) if a.network else not a.no_network
    motion = RandomMotion(a.stroke, a.band[0], a.band[1], a.seed) if a.stroke is not None else None
    with progress_bar() as progress:
        result = trial(
            named_model(a.model), plant=named_model(a.plant) if a.plant else None, records=records, law=a.law,
            network=network, exact=a.exact, commands=tuple(a.commands) if a.commands else None, motion=motion,
            seconds=a.seconds, seed=a.seed, workers=a.jobs, progress=progress,
        )  # fmt: skip
    of_set = not Path(a.model).exists() and a.model in sets.names()
    unit = a.command_unit or (sets.load(a.model).command.unit if of_set else "A")
    with together():
        page = write_page(result, a.out, unit)
        if a.picture:
            save_picture(draw(result, "between", unit), a.picture)
    print(_json(result) if a.json else _text(result, page))
    return 0


def _json(result: Trial) -> str:
    keys = ("inverse", "rms_error_N", "relative_error_percent", "switching_per_s", "mean_command")
    tables = {
        kind: [dict(zip(keys, row, strict=True)) for row in result.rows(kind)] for kind in result.tracks
    }
    return json.dumps({"wanted": tables}, indent=1)


def _text(result: Trial, page: Path) -> str:
    lines = []
    if result.fit:
        lines.append(f"{result.fit.model.law}: held-out free-run error {result.fit.held_out_nrmse:.3f}")
    if result.network:
        lines.append(f"network {result.network.about}")
    for kind in result.tracks:
        lines.append(f"wanted force: {kind}, from {result.tracks[kind][0].start:g} s on")
        lines.append(f"  {'inverse':24s} {'RMS error':>11s} {'of wanted':>10s} {'ranges/s':>9s} {'mean':>7s}")
        for name, error, share, way, mean in result.rows(kind):
            lines.append(f"  {name:24s} {error:9.1f} N {share:8.1f} % {way:9.1f} {mean:7.3f}")
    return "\n".join([*lines, f"page: {page}"])
