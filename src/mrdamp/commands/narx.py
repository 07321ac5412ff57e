"""`mrdamp identify --law narx`: training, choice and pruning of a network, with both errors side by side."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import OutFile, refuse_unused, save_picture
from mrdamp.commands.identify_json import of_network
from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.model import Model
    from mrdamp.narx import Choice, Evaluation, FitNarx, Network, Pruned
    from mrdamp.narx.error_bars import Sufficiency
    from mrdamp.narx.splits import DataSplit
    from mrdamp.parallel import Progress
    from mrdamp.records import RecordSet

#: Force at rest over the largest deviation of a training force, above which it is more than a preload's error.
_REST = 0.05
_COUNTS = "4000:2000:1500"


def add_narx_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `--law narx`."""
    p = parser.add_argument_group("network", "with --law narx")
    p.add_argument("--page", type=OutFile, help="page to write, HTML: errors, training and pictures")
    p.add_argument("--inputs", help="channels x, v, i, F (default: vF, and viF where the command varies)")
    p.add_argument("--lags", type=int, help="lag space in samples (default: about 8 ms)")
    p.add_argument(
        "--hidden",
        help="tanh units of one or two layers, such as 20 or 10,4"
        " (default: 9, and 20 where the command varies within a record)",
    )
    p.add_argument(
        "--sample-time", type=float, help="s (default: the slowest training record's, at least 0.002)"
    )
    p.add_argument("--initialisations", type=int, default=3, help="random starts (default: %(default)s)")
    p.add_argument(
        "--refined",
        type=int,
        default=1,
        help="how many of them are trained in free run (default: %(default)s)",
    )
    p.add_argument("--one-step-only", action="store_true", help="no training in free run")
    p.add_argument(
        "--select",
        action="store_true",
        help="choose inputs, lags and units on the validation records, with curves",
    )
    p.add_argument(
        "--by", default="free_run", choices=("free_run", "one_step"), help="error that --select goes by"
    )
    p.add_argument(
        "--seeds",
        type=int,
        default=1,
        help="of --select: trainings per candidate, of which the median counts (default: %(default)s)",
    )
    p.add_argument("--max-lags", type=int, default=8, help="of --select (default: %(default)s)")
    p.add_argument("--max-units", type=int, default=25, help="of --select (default: %(default)s)")
    p.add_argument(
        "--prune",
        nargs="?",
        const="surgeon",
        choices=("surgeon", "magnitude", "structure"),
        help="remove weights, or neurons and lags; the smallest network within 10 %% of the best is kept",
    )
    # What only a network takes; the sample time is one of the protocols' too.
    parser.set_defaults(of_networks={o.dest: o.default for o in p._group_actions if o.dest != "sample_time"})


def add_protocol_options(p: argparse.ArgumentParser) -> None:
    """Adds which records are for fitting and which for evaluation, for laws and networks alike."""
    p.add_argument(
        "--protocol",
        default="records",
        choices=("records", "constant", "varying"),
        help="whole records (default), those of one constant command, or one record of varying command cut into"
        " training, validation and test",
    )
    p.add_argument(
        "--command", type=float, help="the constant command (default: the one with the most records)"
    )
    p.add_argument("--record", help="the record of varying command (default: the first long enough)")
    p.add_argument("--counts", default=_COUNTS, help="samples of it, by part (default: %(default)s)")


def protocol_records(a: argparse.Namespace, records: RecordSet) -> RecordSet:
    """The records that a law is fitted to and evaluated by under the given protocol."""
    from mrdamp.narx.data import PROTOCOL_TIME
    from mrdamp.narx.splits import at_constant_command, cut_varying

    if a.protocol == "records":
        return records
    if a.protocol == "constant":
        return at_constant_command(records, a.command)
    return cut_varying(records, a.record, _counts(a.counts), a.sample_time or PROTOCOL_TIME)


def check_protocol(a: argparse.Namespace) -> None:
    """Raises InputError for an option of another protocol."""
    if a.protocol != "constant":
        refuse_unused(a, "is for --protocol constant", command=None)
    if a.protocol != "varying":
        refuse_unused(a, "is for --protocol varying", record=None, counts=_COUNTS)


def identify_narx(a: argparse.Namespace, records: RecordSet, progress: Progress) -> dict[str, Any]:
    """Trains, prints both errors, and writes the model and its pictures; returns what `--json` prints."""
    from mrdamp.identify.provenance import write_identified
    from mrdamp.narx import lagged, train_narx
    from mrdamp.narx.train import HORIZONS

    splits = _splits(a, records)
    # Intermediate results are stored next to the model until it is written: the same command continues from there.
    cache = Path(f"{a.out}.unfinished")
    channels, lags, hidden = a.inputs or splits.channels, a.lags, _hidden(a.hidden) or splits.units
    lags = splits.lags if lags is None else lags
    choice = None
    if a.select:
        choice = _select(a, splits, cache, progress)
        channels, lags, hidden = choice.candidate.channels, choice.candidate.lags, choice.candidate.hidden
    fit = train_narx(
        splits.train,
        splits.validation,
        splits.test,
        inputs=lagged(channels, lags),
        hidden=hidden,
        initialisations=a.initialisations,
        refined=a.refined,
        horizons=() if a.one_step_only else HORIZONS,
        seed=a.seed,
        score=splits.score if splits.whole else None,
        workers=a.jobs,
        cache=cache,
        progress=progress,
    )
    model = _described(fit.model, fit.network, fit)
    found = _print_fit(fit, splits, a.protocol)
    pruned = _prune(a, fit, splits, progress) if a.prune else None
    if pruned:
        text = pruned.smallest.to_text()
        model = _described(
            replace(model, weights=text, name=f"narx {pruned.smallest.topology}"), pruned.smallest, fit
        )
    write_identified(model, protocol_records(a, records).train, a.out)
    cache.unlink(missing_ok=True)
    _pictures(a, records.name, fit, splits, found, choice, pruned, model)
    print(f"model: {a.out}")
    return of_network(fit, found, choice, pruned)


def _splits(a: argparse.Namespace, records: RecordSet) -> DataSplit:
    from mrdamp.narx.data import PROTOCOL_TIME
    from mrdamp.narx.splits import at_constant_command, of_records, varying_command

    if a.protocol == "records":
        return of_records(records, a.sample_time)
    step = a.sample_time or PROTOCOL_TIME
    if a.protocol == "constant":
        return of_records(at_constant_command(records, a.command), step)
    return varying_command(records, a.record, _counts(a.counts), step)


def _select(a: argparse.Namespace, splits: DataSplit, cache: Path, progress: Progress) -> Choice:
    from mrdamp.narx import Candidate, select
    from mrdamp.narx.select import as_good, name_of

    if min(a.max_lags, a.max_units, a.seeds) < 1:
        raise InputError("--max-lags, --max-units and --seeds must be at least 1")
    start = Candidate("", 4 if a.lags is None else a.lags, _hidden(a.hidden) or (10,))
    units = sorted({*range(1, min(a.max_units, 10) + 1), *range(10, a.max_units + 1, 5), a.max_units})
    choice = select(
        splits.train,
        splits.validation,
        sets=a.inputs.split(",") if a.inputs else None,
        lags=range(1, a.max_lags + 1),
        units=units,
        start=start,
        by=a.by,
        seed=a.seed,
        seeds=a.seeds,
        workers=a.jobs,
        cache=cache,
        progress=lambda what, share: progress(f"choice of {what}", share),
    )
    for what, trials in (("inputs", choice.inputs), ("lags", choice.lags), ("hidden units", choice.units)):
        names = {t: name_of(what, t.candidate) for t in trials}
        print(f"{what}: error over the force's standard deviation on validation")
        print(f"  {'':>8s} {'free run':>9s} {'one step':>9s}" + (f"   {a.by} over the seeds" if a.seeds > 1 else ""))
        for t in trials:
            low, high = t.span(a.by)
            span = f"   {_number(low)} to {_number(high)}" if a.seeds > 1 else ""
            print(f"  {names[t]:>8s} {_number(t.validation_free)} {_number(t.validation_one)}{span}")
        if a.seeds > 1:
            print(f"  not told apart by the seeds: {', '.join(names[t] for t in as_good(trials, a.by))}")
    c = choice.candidate
    print(f"chosen: inputs {c.channels}, lag space {c.lags}, hidden units {'-'.join(map(str, c.hidden))}")
    return choice


def _prune(a: argparse.Namespace, fit: FitNarx, splits: DataSplit, progress: Progress) -> Pruned:
    from mrdamp.narx import evaluate, prune

    pruned = prune(
        fit.network,
        splits.train,
        splits.validation,
        method=a.prune,
        progress=lambda what, share: progress(f"pruning: {what}", share),
    )
    print(f"pruning by {a.prune}: error over the force's standard deviation on validation")
    print(f"  {'weights':>8s} {'inputs':>7s} {'units':>7s} {'free run':>9s} {'one step':>9s}")
    for step in pruned.steps:
        units = "-".join(map(str, step.units))
        print(
            f"  {step.weights:8d} {step.inputs:7d} {units:>7s} {_number(step.free_run)} {_number(step.one_step)}"
        )
    small = pruned.smallest
    print(
        f"smallest within {100 * pruned.tolerance:.0f} % of the best: {small.topology}, {small.nonzero} weights"
    )
    one, free = evaluate(small, splits.train, splits.validation, splits.test)
    _print_errors(small, one, free, splits)
    return pruned


def _print_fit(fit: FitNarx, splits: DataSplit, protocol: str) -> Sufficiency:
    import numpy as np

    from mrdamp.narx.error_bars import sufficiency

    net, p = fit.network, fit.posterior
    print(
        f"narx {net.topology}: {len(net.theta)} weights, {p.gamma:.0f} of them effective,"
        f" sample time {1e3 * net.sample_time:g} ms"
    )
    for stage in fit.stages:
        print(f"  trained {stage.name:24s} validation: free run {_number(stage.free_run)}, one step"
              f" {_number(stage.one_step)}")  # fmt: skip
    _print_errors(net, fit.one_step, fit.free_run, splits)
    if protocol == "varying":
        one, free = fit.one_step.test[0], fit.free_run.test[0]
        percent = 100 / float(np.sqrt(np.mean(splits.test[0].force ** 2)))
        print(
            f"test part over its RMS force: free run {free.rmse:.1f} N, {percent * free.rmse:.2f} %;"
            f" one step {one.rmse:.1f} N, {percent * one.rmse:.2f} % (the paper, one step: 38 N, 3.5 %)"
        )
    others = (*splits.validation, *splits.test)
    new = (*fit.free_run.validation, *fit.free_run.test)
    found = sufficiency(net, p, splits.train, others, fit.free_run.train, new)
    print(f"the training records {'suffice' if found.suffice else 'do not suffice'}: {found.why}")
    return found


def _print_errors(net: Network, one: Evaluation, free: Evaluation, splits: DataSplit) -> None:
    """Free run first, then one step ahead, and the noise of the force; then what it does at rest."""
    import numpy as np

    from mrdamp.narx.evaluation import force_at_rest

    parts = (*splits.train, *splits.validation, *splits.test)
    noise = {s.name: s.noise / float(np.std(s.force)) for s in parts}
    print("RMS error in N and over the force's standard deviation; noise: of the force as measured, at most, likewise")
    print(f"  {'':44s} {'':10s} {'free run':>19s} {'one step ahead':>19s} {'noise':>7s}")
    halves = (("trained", 0, free.train, one.train), ("validation", 1, free.validation, one.validation),
              ("test", 2, free.test, one.test))  # fmt: skip
    for half, _, frees, ones in halves:
        for f, o in zip(frees, ones, strict=True):
            print(f"  {f.record:44.44s} {half:10s} {f.rmse:9.1f} N {_number(f.nrmse, 7)} {o.rmse:9.1f} N"
                  f" {_number(o.nrmse, 7)} {noise[f.record]:7.4f}")  # fmt: skip
    for half, k, frees, _ in halves:
        if frees:
            print(f"  {'all':44s} {half:10s} {'':11s} {_number(free.pooled[k], 7)} {'':11s}"
                  f" {_number(one.pooled[k], 7)}")  # fmt: skip
    if any(record.sample_time > 1.001 * splits.sample_time for record in splits.whole):
        print(f"validation in free run, slower records at their own rate: {_number(splits.score(net), 1)}")
    found = force_at_rest(net, splits.train)
    said = ", ".join(f"{force:.3g} N at {u:g}" for u, force in found)
    print(f"it pushes a rod at rest with {said}")
    if max(abs(force) for _, force in found) > _REST * max(float(np.std(s.force)) for s in splits.train):
        print("  check: a damper at rest holds its preload alone; train with records that hold a rest too")


def _described(model: Model, net: Network, fit: FitNarx) -> Model:
    """The model with what it reached, for who reads the file."""
    names = ("training", "validation", "test")
    reached = {
        f"{name}_{kind}": round(value, 6)
        for kind, judged in (("free_run", fit.free_run), ("one_step", fit.one_step))
        for name, value in zip(names, judged.pooled, strict=True)
        if value == value and value != float("inf")
    }
    facts: dict[str, Any] = {
        "topology": net.topology,
        "weights": net.nonzero,
        "gamma": round(fit.posterior.gamma, 1),
    }
    return replace(model, extra={**model.extra, "network": facts | {"nrmse_as_trained": reached}})


def _pictures(
    a: argparse.Namespace, name: str, fit: FitNarx, splits: DataSplit, found: Sufficiency, choice: Choice | None,
    pruned: Pruned | None, model: Model,
) -> None:  # fmt: skip
    """The page, and the pictures as files: the courses, or both predictions of the test parts where there is none."""
    if not a.picture and not a.page:
        return
    from mrdamp.commands.narx_page import figures, write_page

    drawn = figures(choice, pruned, model, splits, a.command_unit)
    if a.page:
        write_page(a.page, name, fit, splits, found, model, drawn)
        print(f"page: {a.page}")
    courses = {key: fig for key, fig in drawn.items() if key in ("choice", "pruning")}
    shown = courses or drawn
    for key, fig in shown.items() if a.picture else ():
        save_picture(fig, a.picture if len(shown) == 1 else a.picture.with_stem(f"{a.picture.stem}-{key}"))


def _hidden(text: str | None) -> tuple[int, ...]:
    if not text:
        return ()
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--hidden {text}: whole numbers are needed, such as 20 or 10,4") from None


def _counts(text: str) -> tuple[int, int, int]:
    try:
        first, second, third = (int(part) for part in text.split(":"))
    except ValueError:
        first = second = third = 0
    if min(first, second, third) < 10:
        raise InputError(
            f"--counts {text}: three whole numbers of 10 or more are needed, such as 4000:2000:1500"
        )
    return first, second, third


def _number(value: float, width: int = 9) -> str:
    return f"{value:{width}.4f}" if value < 100 else f"{'run away':>{width}s}"
