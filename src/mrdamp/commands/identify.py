"""The commands `mrdamp identify` and `mrdamp table1`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import (
    HOLD,
    OutFile,
    Picture,
    add_command,
    add_jobs,
    add_json,
    add_records,
    add_signals,
    as_recorded,
    follows,
    prepared,
    progress_bar,
    read,
    refuse_unused,
    save_picture,
    show_progress,
)
from mrdamp.commands.identify_json import of_by_command, of_fit, of_table, reporting
from mrdamp.commands.narx import add_narx_options, add_protocol_options, check_protocol, protocol_records
from mrdamp.errors import InputError
from mrdamp.files import together

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mrdamp.identify import Fit, RecordError
    from mrdamp.identify.by_command import ByCommand
    from mrdamp.identify.intervals import ChannelFinding, Interval
    from mrdamp.records import RecordSet

_UNITS = "A", "V"


def add_to(commands: Any) -> None:
    about = "fit a law, or a network, to records; evaluated in free run on held-out records"
    example = "mrdamp identify records/ --law bouc_wen --intervals -o model.json"
    p = add_command(commands, "identify", reporting(run_identify), about, example)
    add_records(p, "; any effect of a damper; auto: those that left-out records pay for")
    p.add_argument(
        "--law",
        default="modified_bouc_wen",
        help="a law that `mrdamp citation` lists, such as bouc_wen; narx is a network (default: %(default)s)",
    )
    laws = p.add_argument_group("law", "without --law narx")
    laws.add_argument(
        "--dependence",
        help="how coefficients follow the command: constant, linear (default), quadratic, saturating,"
        " quadratic_saturating, or compare for all",
    )
    laws.add_argument(
        "--by-command", action="store_true", help="values at each constant command, then lines through them"
    )
    laws.add_argument(
        "--intervals", action="store_true", help="95 %% intervals by bootstrap, and what is not identifiable"
    )
    p.add_argument(
        "--norms", action="store_true", help="E_t, E_x, E_v and delta_2 of both papers, by held-out record"
    )
    laws.add_argument("--resamples", type=int, default=200, help="of the bootstrap (default: %(default)s)")
    laws.add_argument("--refit", action="store_true", help="fit each resample fully, not by one step")
    laws.add_argument("--starts", type=int, default=4, help="local fits (default: %(default)s)")
    laws.add_argument(
        "--hold",
        choices=HOLD,
        help="hold the command between samples, or interpolate linearly (default: what fits better)",
    )
    add_jobs(p, "--workers")
    p.add_argument(
        "--picture",
        type=Picture,
        help="held-out records, lines of --by-command, a network's choice and pruning (.svg, .png or .pdf)",
    )
    p.add_argument("--command-unit", default="A", choices=_UNITS, help="of the command (default: %(default)s)")
    add_signals(p)
    p.add_argument("-o", "--out", type=OutFile, required=True, help="model file to write")
    add_json(p)
    add_protocol_options(p)
    add_narx_options(p)
    _add_table1(commands)


def _add_table1(commands: Any) -> None:
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
    add_jobs(p, "--workers")
    p.add_argument("--starts", type=int, default=4, help="local fits (default: %(default)s)")
    p.add_argument("--picture", type=Picture, help="loops of all models (.svg, .png or .pdf)")
    p.add_argument(
        "--condition", metavar="RECORD", help="one held-out record, of which one cycle is used, as in the paper"
    )
    add_json(p)
    add_signals(p)


def run_identify(a: argparse.Namespace) -> dict[str, Any]:
    """Fits, prints the errors, intervals and findings, and writes the model; returns what `--json` prints."""
    from mrdamp.identify.laws import parametric
    from mrdamp.records.checks import warnings_of

    if a.law not in (*parametric(), "narx"):
        raise InputError(f"--law is {a.law}; allowed: {', '.join(parametric())}, narx")
    given = [name for name, default in a.of_networks.items() if getattr(a, name) != default]
    if a.law != "narx" and given:
        raise InputError(f"--{given[0].replace('_', '-')} is for a network (--law narx); the law is {a.law}")
    check_protocol(a)
    if not a.intervals:
        refuse_unused(a, "is for --intervals", resamples=200, refit=False)
    if a.by_command:
        refuse_unused(a, "has no effect on --by-command, which fits lines", dependence=None)
    records = read(a)
    warnings = warnings_of(records.records)
    for warning in warnings:
        print(f"check: {warning}", flush=True)
    if a.starts < 1 or a.resamples < 20 or a.jobs < 1:
        raise InputError("--starts and --jobs must be at least 1 and --resamples at least 20")
    report = {"model": str(a.out), "warnings": warnings, **_identified(a, records)}
    if a.norms:
        report["norms"] = _norms(a, protocol_records(a, records))
    return report


def _identified(a: argparse.Namespace, records: RecordSet) -> dict[str, Any]:
    from mrdamp.diagnosis.form import form_with, sorted_extras
    from mrdamp.identify import compare_dependences, error, identify, pooled
    from mrdamp.identify.comparison import overview_of
    from mrdamp.identify.findings import findings
    from mrdamp.identify.intervals import channel_findings
    from mrdamp.records.checks import check_explained, unexplained

    if a.law == "narx":
        for flag, value in (
            ("--by-command", a.by_command),
            ("--extras", a.extras != ["offset"]),
            ("--intervals", a.intervals),
            ("--dependence", a.dependence),
            ("--follows", a.follows),
        ):
            if value:
                raise InputError(f"{flag} is for laws; a network (--law narx) has no parameters of that kind")
        from mrdamp.commands.network import identify_narx

        with progress_bar() as progress:
            return identify_narx(a, records, progress)
    records = protocol_records(a, records)
    if a.by_command:
        return _by_command(a, records)
    plain, more = sorted_extras(a.extras)
    if more and a.intervals:
        raise InputError(f"--intervals is not available with --extras {more[0]}; mrdamp diagnose prints them")
    common: dict[str, Any] = {
        "extras": plain,
        "starts": a.starts,
        "seed": a.seed,
        "hold": HOLD.get(a.hold),
        "follows": follows(a),
        "progress": show_progress,
    }
    fits: dict[str, Fit] = {}
    if a.dependence == "compare":
        fits = compare_dependences(a.law, records.train, records.validation, **common)
        print(f"{a.law}: free-run error over the force's standard deviation, by dependence on the command:")
        for name, fit in fits.items():
            free = len(fit.space.coordinates) if fit.space else 0
            print(
                f"  {name:20s} {free:3d} free numbers  fitted {fit.train_nrmse:.3f}  held out {fit.held_out_nrmse:.3f}"
            )
        chosen = min(fits, key=lambda name: fits[name].held_out_nrmse)
        print(f"  taken: {chosen}")
        fit = fits[chosen]  # test records judge it; they do not choose it
        fit = replace(fit, held_out=tuple(error(fit.model, record) for record in records.held_out))
    else:
        fit = identify(a.law, records.train, records.held_out, dependence=a.dependence, **common)
    check_explained(records.train, fit.train_nrmse)
    if more:
        form = form_with(fit, records.train, more, threads=a.jobs, progress=show_progress)
        print("\n".join(form.lines()))
        fit = form.applied(fit, records)
    print(f"{a.law}: free-run error over the force's standard deviation:")
    if said := unexplained(records.held_out, fit.held_out_nrmse):
        print(f"  fitted records {fit.train_nrmse:.3f}; the held-out records do not judge it:")
        print(f"  {said}")
    else:
        print(f"  fitted records {fit.train_nrmse:.3f}, held-out records {fit.held_out_nrmse:.3f}")
        _errors(fit.train, "fitted")
        _errors(fit.held_out, "held out")
    left = channel_findings(fit, records.train)
    checks = findings(fit, records.train, records.held_out)
    if prepared(a):
        raw = as_recorded(a)
        left_there = pooled([error(fit.model, r) for r in raw.held_out or raw.train])
        checks.append(
            "on the records as they are, without --cutoff and --zero-mean, the error of `mrdamp predict` is"
            f" {left_there:.3f}" + (a.cutoff is not None) * "; what the filter changes is not in the intervals"
        )
    _found(fit, left, checks)
    rows = _intervals(a, fit, records) if a.intervals else ()
    _write(a, fit, records, lambda: overview_of(fit.model, records.held_out or records.train, a.command_unit))
    return of_fit(fit, left, rows, fits) | {"checks": checks}


def _by_command(a: argparse.Namespace, records: RecordSet) -> dict[str, Any]:
    from mrdamp.identify import pooled
    from mrdamp.identify.by_command import identify_by_command

    found = identify_by_command(
        a.law,
        records.train,
        records.held_out,
        extras=a.extras,
        follows=follows(a),
        starts=a.starts,
        seed=a.seed,
        progress=show_progress,
    )
    fit = found.fit
    print(f"{a.law}: values at each constant command, the other parameters the same for all:")
    for command, _, errors in found.at:
        print(f"  command {command:8.4g}  {len(errors):2d} records  error {pooled(errors):.3f}")
    print(f"{'parameter':>20s} {'at command 0':>14s} {'slope':>12s} {'scatter':>12s}")
    for line in found.lines:
        print(f"{line.parameter:>20s} {line.zero:14.5g} {line.slope:12.5g} {line.scatter:12.3g}")
    print(f"law of the lines: fitted records {fit.train_nrmse:.3f}, held-out records {fit.held_out_nrmse:.3f}")
    _errors(fit.held_out, "held out")
    _along(fit)
    _write(a, fit, records, lambda: _lines(a, found))
    return of_by_command(found)


def _write(a: argparse.Namespace, fit: Fit, records: RecordSet, draw: Callable[[], Figure]) -> None:
    from mrdamp.identify.provenance import write_identified

    with together():
        write_identified(fit.model, records.train, a.out)
        if a.picture:
            save_picture(draw(), a.picture)
    print(f"model: {a.out}")


def _lines(a: argparse.Namespace, found: ByCommand) -> Figure:
    import numpy as np

    from mrdamp.model.core import attributes
    from mrdamp.pictures.identification import parameter_lines

    units = {row.name: row.unit for row in attributes()}
    shown = found.lines
    return parameter_lines(
        [line.parameter for line in shown],
        [units[line.parameter] for line in shown],
        np.array(shown[0].commands),
        [np.array(line.values) for line in shown],
        [(line.zero, line.slope) for line in shown],
        a.command_unit,
    )


#: Share of the squared residual from which on an offset or delay that is left is printed: less is chance or form.
_MATERIAL = 0.05


def _found(fit: Fit, left_over: Sequence[ChannelFinding], checks: Sequence[str]) -> None:
    """Offsets and delays that the fit found, what the residuals still hold of them, and what could not be seen."""
    if fit.left_out:
        print(f"  left out, as no record here has a command that varies enough: {', '.join(fit.left_out)}")
    for check in checks:
        print(f"  check: {check}")
    _along(fit, checks)
    late = {c.record: c.delay for c in left_over if c.delay_share > _MATERIAL and abs(c.delay) > 3 * c.delay_error}
    one_way = len({delay > 0 for delay in late.values()}) == 1  # both ways it is the law's form
    for c in left_over:
        left = []
        if c.offset_share > _MATERIAL and abs(c.offset) > 3 * c.offset_error:
            left.append(f"offset {c.offset:.3g} +- {1.96 * c.offset_error:.2g} N")
        if one_way and c.record in late:
            left.append(f"delay of the force {1e3 * c.delay:.3g} +- {1.96e3 * c.delay_error:.2g} ms")
        if left:
            print(f"  remains in {c.record}: {', '.join(left)}")


def _along(fit: Fit, checks: Sequence[str] = ()) -> None:
    """Effects of the law's own fit; a check tells of a parameter at the end of its range."""
    attributes = fit.model.attributes
    for name, unit, scale, what in (
        ("gas_spring_f0", "N", 1.0, "force offset or preload"),
        ("channel_shift_d", "ms", 1e3, "displacement late (+) or early (-) against the force"),
        ("driver_lag_tau", "ms", 1e3, "lag of the driver"),
        ("command_delay_d", "ms", 1e3, "delay of the command"),
        ("saturation_i_s", "A or V", 1.0, "command that saturates the field"),
        ("gas_spring_k", "N/m", 1.0, "stiffness of a gas spring"),
    ):
        ended = any(f"{name} is at the end of its range" in check for check in checks)
        if name in attributes and not ended:
            print(f"  found: {what}: {scale * attributes[name]:.4g} {unit}")


def _norms(a: argparse.Namespace, records: RecordSet) -> list[dict[str, Any]]:
    from mrdamp.identify.comparison import record_errors
    from mrdamp.model import Model

    rows = record_errors(Model.read(a.out), records.held_out)
    print(
        "held out, free run: E_t, E_x, E_v of the foam-damper paper in its cm, delta_2 of the self-sensing paper"
    )
    for row in rows:
        name, e_t, e_x, e_v, delta_2 = row.values()
        print(f"  {name:40s} {e_t:8.4f} {e_x:8.4f} {e_v:8.4f} {100 * delta_2:8.2f} %")
    return rows


def _intervals(a: argparse.Namespace, fit: Fit, records: RecordSet) -> Sequence[Interval]:
    from mrdamp.identify.intervals import intervals

    rows = intervals(fit, records.train, resamples=a.resamples, refit=a.refit, seed=a.seed, workers=a.jobs)
    print(f"{'parameter':>20s} {'value':>12s} {'95 % from':>12s} {'to':>12s}  unit")
    for row in rows:
        word = f"  not identifiable: {row.word}" if row.word else ""
        print(f"{row.name:>20s} {row.value:12.5g} {row.low:12.5g} {row.high:12.5g}  {row.unit}{word}")
    if any(row.name == "A" for row in rows):
        print("  z is scaled to end at 1: 1 / A is the yield displacement (m), alpha the force (N) that z carries")
    return rows


def _errors(errors: Sequence[RecordError], half: str) -> None:
    for error in errors:
        print(f"  {error.record:40s} {half:8s} {error.rmse:9.1f} N  {error.nrmse:6.3f}")


def run_table1(a: argparse.Namespace) -> dict[str, Any]:
    """Prints the table and writes the picture; returns what `--json` prints."""
    from mrdamp.identify.comparison import judged_records, network_forces, paper_network, table_1
    from mrdamp.model import Model

    if a.starts < 1 or a.jobs < 1:
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
            network = paper_network(records, seed=a.seed, workers=a.jobs, progress=progress).model
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
