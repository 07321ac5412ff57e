"""The page of `mrdamp identify --law narx --page`: what the command prints, with its pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrdamp.model import Model
from mrdamp.narx import Choice, FitNarx, Network, Pruned, draw_choice, draw_pruning, evaluate
from mrdamp.narx.error_bars import Sufficiency
from mrdamp.narx.evaluation import free_run_force
from mrdamp.narx.splits import DataSplit
from mrdamp.pictures.identification import model_loops
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
    "loops": ("Free run over the measured force.", "Force over displacement and over velocity."),
}


def figures(
    choice: Choice | None, pruned: Pruned | None, model: Model, splits: DataSplit
) -> dict[str, Figure]:
    """The courses of the choice and of the pruning where there are any, and the network's loops."""
    out = {}
    if choice:
        out["choice"] = draw_choice(choice)
    if pruned:
        out["pruning"] = draw_pruning(pruned)
    assert model.weights is not None
    s = max(splits.test or splits.validation or splits.train, key=lambda s: float(np.std(s.force)))
    time = np.arange(s.n, dtype=float) * s.sample_time
    force = free_run_force(Network.from_text(model.weights), s)
    out["loops"] = model_loops(time, s.x, s.v, s.force, {f"{s.name}, free run": force})
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
        page.figure(key.capitalize(), figure, *CAPTIONS[key])
    page.write(path)
