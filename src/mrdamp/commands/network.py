"""`mrdamp identify --law narx`: training, choice and pruning of a network, both errors side by side, and its page."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mrdamp.commands import save_picture
from mrdamp.commands.identify_json import of_network
from mrdamp.commands.narx import counts_of, protocol_records
from mrdamp.errors import InputError
from mrdamp.files import together
from mrdamp.identify import RecordError
from mrdamp.identify.provenance import write_identified
from mrdamp.model import Model
from mrdamp.narx import evaluation
from mrdamp.narx.data import PROTOCOL_TIME, lagged
from mrdamp.narx.error_bars import Sufficiency, sufficiency
from mrdamp.narx.evaluation import Evaluation, evaluate
from mrdamp.narx.network import Network
from mrdamp.narx.prune import Pruned, draw_pruning, prune
from mrdamp.narx.select import Candidate, Choice, as_good, draw_choice, name_of, select
from mrdamp.narx.splits import DataSplit, of_records, varying_command
from mrdamp.narx.train import HORIZONS, FitNarx, train_narx
from mrdamp.parallel import Progress
from mrdamp.pictures.damper import LoopData, overview
from mrdamp.records import RecordSet
from mrdamp.report import Page

#: Force at rest over the largest deviation of a training force, above which it is more than a preload's error.
_REST = 0.05
_HALVES, _SAID = ("train", "validation", "test"), {"train": "trained"}
_CAPTIONS: Mapping[str, tuple[str, str]] = {
    "choice": (
        "Inputs, lags and hidden units, each chosen on the validation records with the others held.",
        "Error over input sets, lag space and number of hidden units.",
    ),
    "pruning": (
        "Error while weights are removed; the line is 10 % above the best free-run error.",
        "Error over the number of weights left.",
    ),
    "one_step": ("One step ahead of measured forces, over the measured force.", "Predicted and measured force."),
    "free_run": ("Free run, over the measured force.", "Simulated and measured force."),
}


def identify_narx(a: argparse.Namespace, records: RecordSet, progress: Progress) -> dict[str, Any]:
    """Trains, prints both errors, and writes the model and its pictures; returns what `--json` prints."""
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
    found = _print_fit(fit, splits, a.protocol)
    pruned = _prune(a, fit, splits, progress) if a.prune else None
    network, one, free = fit.network, fit.one_step, fit.free_run
    if pruned:
        network = pruned.smallest
        one, free = evaluate(network, splits.train, splits.validation, splits.test)
        _print_errors(network, one, free, splits)
    with together():
        write_identified(_described(fit, network), protocol_records(a, records).train, a.out)
        if a.picture or a.page:
            drawn = _figures(choice, pruned, network, splits, a.command_unit)
            if a.page:
                _page(records.name, fit, found, network, _side_by_side(one, free), drawn).write(a.page)
            # The courses, or both predictions of the test parts where there is none.
            shown = {key: fig for key, fig in drawn.items() if key in ("choice", "pruning")} or drawn
            for key, fig in shown.items() if a.picture else ():
                save_picture(fig, a.picture if len(shown) == 1 else a.picture.with_stem(f"{a.picture.stem}-{key}"))
    cache.unlink(missing_ok=True)
    if a.page:
        print(f"page: {a.page}")
    print(f"model: {a.out}")
    return of_network(fit, found, choice, pruned)


def _splits(a: argparse.Namespace, records: RecordSet) -> DataSplit:
    if a.protocol == "varying":
        return varying_command(records, a.record, counts_of(a.counts), a.sample_time or PROTOCOL_TIME)
    usual = PROTOCOL_TIME if a.protocol == "constant" else None
    return of_records(protocol_records(a, records), a.sample_time or usual)


def _select(a: argparse.Namespace, splits: DataSplit, cache: Path, progress: Progress) -> Choice:
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
    return pruned


def _print_fit(fit: FitNarx, splits: DataSplit, protocol: str) -> Sufficiency:
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
    how = "as well as" if found.suffice else "worse than"
    print(f"other records are predicted {how} the training records: {found.why}")
    for lost in (e for e in (*fit.free_run.train, *new) if not e.nrmse < 1):
        print(f"check: {lost.record}: a free run {lost.nrmse:.3g} standard deviations off is no prediction")
    return found


def _print_errors(net: Network, one: Evaluation, free: Evaluation, splits: DataSplit) -> None:
    """Free run first, then one step ahead, and the noise of the force; then what it does at rest."""
    parts = (*splits.train, *splits.validation, *splits.test)
    noise = {s.name: s.noise / float(np.std(s.force)) for s in parts}
    print("RMS error in N and over the force's standard deviation; noise: of the force as measured, at most, likewise")
    print(f"  {'':44s} {'':10s} {'free run':>19s} {'one step ahead':>19s} {'noise':>7s}")
    for half, f, o in _side_by_side(one, free):
        print(f"  {f.record:44.44s} {_SAID.get(half, half):10s} {f.rmse:9.1f} N {_number(f.nrmse, 7)} {o.rmse:9.1f} N"
              f" {_number(o.nrmse, 7)} {noise[f.record]:7.4f}")  # fmt: skip
    for half, all_free, all_one in zip(_HALVES, free.pooled, one.pooled, strict=True):
        if getattr(free, half):
            print(f"  {'all':44s} {_SAID.get(half, half):10s} {'':11s} {_number(all_free, 7)} {'':11s}"
                  f" {_number(all_one, 7)}")  # fmt: skip
    if any(record.sample_time > 1.001 * splits.sample_time for record in splits.whole):
        print(f"validation in free run, slower records at their own rate: {_number(splits.score(net), 1)}")
    found = evaluation.force_at_rest(net, splits.train)
    said = ", ".join(f"{force:.3g} N at {u:g}" for u, force in found)
    print(f"it pushes a rod at rest with {said}")
    if max(abs(force) for _, force in found) > _REST * max(float(np.std(s.force)) for s in splits.train):
        print("  check: a damper at rest holds its preload alone; train with records that hold a rest too")


def _side_by_side(one: Evaluation, free: Evaluation) -> Iterator[tuple[str, RecordError, RecordError]]:
    """Half, error in free run and error one step ahead of every record."""
    for half in _HALVES:
        yield from ((half, *both) for both in zip(getattr(free, half), getattr(one, half), strict=True))


def _described(fit: FitNarx, net: Network) -> Model:
    """The model of a network, pruned or as fitted, with what the fit reached, for who reads the file."""
    reached = {
        f"{name}_{kind}": round(value, 6)
        for kind, judged in (("free_run", fit.free_run), ("one_step", fit.one_step))
        for name, value in zip(("training", "validation", "test"), judged.pooled, strict=True)
        if value == value and value != float("inf")
    }
    facts = {"topology": net.topology, "weights": net.nonzero, "gamma": round(fit.posterior.gamma, 1)}
    extra = {"network": {**facts, "nrmse_as_trained": reached}}
    return replace(fit.model, weights=net.to_text(), name=f"narx {net.topology}", extra=extra)


def _hidden(text: str | None) -> tuple[int, ...]:
    if not text:
        return ()
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--hidden {text}: whole numbers are needed, such as 20 or 10,4") from None


def _number(value: float, width: int = 9) -> str:
    return f"{value:{width}.4f}" if value < 100 else f"{'run away':>{width}s}"


def _figures(
    choice: Choice | None, pruned: Pruned | None, net: Network, splits: DataSplit, command_unit: str
) -> dict[str, Figure]:
    """The courses of the choice and of the pruning where there are any, and both predictions of the test parts."""
    out = {}
    if choice:
        out["choice"] = draw_choice(choice)
    if pruned:
        out["pruning"] = draw_pruning(pruned)
    judged = splits.test or splits.validation or splits.train
    for key, said, force, error, first in (
        ("one_step", "one step", evaluation.one_step_force, evaluation.one_step_error, net.max_lag),
        ("free_run", "free run", evaluation.free_run_force, evaluation.free_run_error, 0),
    ):
        out[key] = overview([
            LoopData(s.name, s.start + s.sample_time * np.arange(s.n, dtype=float), s.x, s.v, s.i, s.force,
                     force(net, whole), command_unit, f"{said}: {error(net, whole).rmse:.1f} N")
            for whole in judged
            for s in [whole.part(first, whole.n)]
        ])  # fmt: skip
    return out


def _page(
    name: str, fit: FitNarx, found: Sufficiency, network: Network,
    errors: Iterable[tuple[str, RecordError, RecordError]], pictures: Mapping[str, Figure],
) -> Page:  # fmt: skip
    """One self-contained HTML file. errors: as of `_side_by_side`."""
    page = Page(
        f"Network {network.topology} of {name}",
        f"{network.nonzero} weights, sample time {1e3 * network.sample_time:g} ms; free run first, as a simulator"
        " meets it, and one step ahead of measured forces beside it.",
    )
    rows = [(f.record, half, f.rmse, 100 * f.nrmse, o.rmse, 100 * o.nrmse) for half, f, o in errors]
    page.table(
        "Errors",
        ("record", "", "free run (N)", "of std (%)", "one step (N)", "of std (%)"),
        rows,
        "RMS errors, and over the force's standard deviation. Validation records chose the stage of training.",
    )
    verdict = "as well as" if found.suffice else "worse than"
    page.text("Other records", f"They are predicted {verdict} the training records: {found.why}.")
    page.table(
        "Training",
        ("stage", "effective weights", "free run, validation (%)", "one step (%)"),
        [(s.name, s.gamma, 100 * s.free_run, 100 * s.one_step) for s in fit.stages],
    )
    for key, figure in pictures.items():
        page.figure(key.replace("_", " ").capitalize(), figure, *_CAPTIONS[key])
    return page
