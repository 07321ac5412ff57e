"""The page of `mrdamp identify --law narx --page`: what the command prints, with its pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrdamp.model import Model
from mrdamp.narx import Choice, FitNarx, Network, Pruned, draw_choice, draw_pruning, evaluate
from mrdamp.narx.error_bars import Sufficiency
from mrdamp.narx.evaluation import free_run_error, free_run_force, one_step_error, one_step_force
from mrdamp.narx.splits import DataSplit
from mrdamp.pictures.damper import LoopData, overview
from mrdamp.report import Page

CAPTIONS: Mapping[str, tuple[str, str]] = {
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


def figures(
    choice: Choice | None, pruned: Pruned | None, model: Model, splits: DataSplit, command_unit: str
) -> dict[str, Figure]:
    """The courses of the choice and of the pruning where there are any, and both predictions of the test parts."""
    out = {}
    if choice:
        out["choice"] = draw_choice(choice)
    if pruned:
        out["pruning"] = draw_pruning(pruned)
    assert model.weights is not None
    net, judged = Network.from_text(model.weights), splits.test or splits.validation or splits.train
    for key, said, force, error, first in (
        ("one_step", "one step", one_step_force, one_step_error, net.max_lag),
        ("free_run", "free run", free_run_force, free_run_error, 0),
    ):
        out[key] = overview([
            LoopData(s.name, s.start + s.sample_time * np.arange(s.n, dtype=float), s.x, s.v, s.i, s.force,
                     force(net, whole), command_unit, f"{said}: {error(net, whole).rmse:.1f} N")
            for whole in judged
            for s in [whole.part(first, whole.n)]
        ])  # fmt: skip
    return out


def write_page(
    path: Path, name: str, fit: FitNarx, splits: DataSplit, found: Sufficiency, model: Model,
    pictures: Mapping[str, Figure],
) -> None:  # fmt: skip
    """Writes one self-contained HTML file. Raises InputError."""
    assert model.weights is not None
    network = Network.from_text(model.weights)
    one, free = evaluate(network, splits.train, splits.validation, splits.test)
    page = Page(
        f"Network {network.topology} of {name}",
        f"{network.nonzero} weights, sample time {1e3 * network.sample_time:g} ms; free run first, as a simulator"
        " meets it, and one step ahead of measured forces beside it.",
    )
    rows = [
        (f.record, half, f.rmse, 100 * f.nrmse, o.rmse, 100 * o.nrmse)
        for half in ("train", "validation", "test")
        for f, o in zip(getattr(free, half), getattr(one, half), strict=True)
    ]
    page.table(
        "Errors",
        ("record", "", "free run (N)", "of std (%)", "one step (N)", "of std (%)"),
        rows,
        "RMS errors, and over the force's standard deviation. Validation records chose the stage of training.",
    )
    verdict = "suffice" if found.suffice else "do not suffice"
    page.text("Whether the records suffice", f"The training records {verdict}: {found.why}.")
    page.table(
        "Training",
        ("stage", "effective weights", "free run, validation (%)", "one step (%)"),
        [(s.name, s.gamma, 100 * s.free_run, 100 * s.one_step) for s in fit.stages],
    )
    for key, figure in pictures.items():
        page.figure(key.replace("_", " ").capitalize(), figure, *CAPTIONS[key])
    page.write(path)
