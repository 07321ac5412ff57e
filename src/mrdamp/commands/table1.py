"""The command `mrdamp table1`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from mrdamp.commands import (
    Picture,
    add_command,
    add_json,
    add_records,
    add_signals,
    progress_bar,
    read,
    save_picture,
    show_progress,
)
from mrdamp.commands.identify_json import of_table, reporting
from mrdamp.errors import InputError


def add_to(commands: Any) -> None:
    """Adds `table1`."""
    p = add_command(
        commands,
        "table1",
        reporting(run_table1),
        "Bingham, Bouc-Wen, hyperbolic tangent and a network on one record set: the foam-damper paper's Table 1",
        "mrdamp table1 foam --condition sine_4.0Hz_8.0mm_3.0V --follows paper --zero-mean --cutoff 80 --cutoff-force",
    )
    add_records(p)
    p.add_argument("--dependence", help="how coefficients follow the command (default: linear)")
    p.add_argument(
        "--network", type=Path, help="model file of a network (default: the paper's 10-4-1 is trained)"
    )
    p.add_argument("--no-network", action="store_true", help="leave the network out")
    p.add_argument("--jobs", "--workers", dest="workers", type=int, default=1, metavar="N",
                   help="processes; the answer is the same (default: %(default)s)")  # fmt: skip
    p.add_argument("--starts", type=int, default=4, help="local fits (default: %(default)s)")
    p.add_argument("--picture", type=Picture, help="loops of all models (.svg, .png or .pdf)")
    p.add_argument(
        "--condition", metavar="RECORD", help="one held-out record, of which one cycle is used, as in the paper"
    )
    add_json(p)
    add_signals(p)


def run_table1(a: argparse.Namespace) -> dict[str, Any]:
    """Prints the table and writes the picture; returns what `--json` prints."""
    from mrdamp.identify.comparison import judged_records, network_forces, paper_network, table_1
    from mrdamp.model import Model

    if a.starts < 1 or a.workers < 1:
        raise InputError("--starts and --jobs must be at least 1")
    if a.follows not in (None, ["paper"]):
        raise InputError("--follows takes names of one law's coefficients; of a table: paper")
    records = read(a)
    judged = judged_records(records, a.condition)
    others = {}
    if a.network:
        network = Model.read(a.network)
        if network.law != "narx" or a.no_network:
            raise InputError(f"{a.network}: law {network.law}; --network takes a network (narx), without --no-network")
        others = network_forces(network, judged)
    elif not a.no_network:
        with progress_bar() as progress:
            network = paper_network(records, seed=a.seed, workers=a.workers, progress=progress).model
        others = network_forces(network, judged)
    table = table_1(
        records,
        others=others,
        condition=a.condition,
        extras=a.extras,
        dependence=a.dependence,
        paper_follows=a.follows is not None,
        starts=a.starts,
        seed=a.seed,
        progress=show_progress,
    )
    where = f"one cycle of {a.condition}" if a.condition else f"{len(judged)} held-out records"
    print(f"{records.name}: free run on {where}; E_x and E_v in the paper's cm")
    print(f"{'model':24s} {'E_t':>8s} {'E_x':>8s} {'E_v':>8s} {'NRMSE':>8s}   {'paper':>9s}")
    for row in table.rows:
        n, p = row.norms, row.paper
        paper = f"{p.e_t:9.4f} {p.e_x:8.4f} {p.e_v:8.4f}" if p else ""
        print(f"{row.model:24s} {n.e_t:8.4f} {n.e_x:8.4f} {n.e_v:8.4f} {row.nrmse:8.4f}   {paper}")
    if a.picture:
        save_picture(table.picture(), a.picture)
    return of_table(table)
