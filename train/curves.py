"""The validation score over the training, each seed and their mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mrdamp.model.core import Array
from mrdamp.pictures import style
from mrdamp.train.run import Result


@style.styled
def curve(result: Result) -> Figure:
    """Of one training."""
    return curves([result])


def _axes(height: float) -> tuple[Figure, Axes]:
    fig = style.figure(height * style.WIDTH)
    axes = fig.add_subplot()
    axes.set_xlabel("control periods (millions)")
    axes.set_ylabel("validation score")
    return fig, axes


def _shared(results: Sequence[Result]) -> tuple[Array, Array]:
    """Mean millions of control periods (n,) and scores (seeds, n) at the evaluations that all have."""
    rows = [r.curve[: min(len(result.curve) for result in results)] for r in results]
    at, scores = (np.array([[row[name] for row in curve] for curve in rows]) for name in ("timesteps", "score"))
    return (at / 1e6).mean(axis=0), scores


def curves(results: Sequence[Result]) -> Figure:
    """One thin line a seed, a thick one their mean at the evaluations that all have."""
    fig, axes = _axes(0.55)
    for result in results:
        at, scores = _shared([result])
        axes.plot(at, scores[0], color=style.COLOURS[0], linewidth=0.7, alpha=0.6)
    at, scores = _shared(results)
    axes.plot(at, scores.mean(axis=0), color=style.COLOURS[1], linewidth=1.8)
    return fig


@style.styled
def compared(named: Mapping[str, Sequence[Result]]) -> Figure:
    """One line a setting: the mean over its seeds at the evaluations that all have, and the seeds' range around it."""
    fig, axes = _axes(0.6)
    for k, (name, results) in enumerate(named.items()):
        colour = style.COLOURS[k % len(style.COLOURS)]
        at, scores = _shared(results)
        axes.plot(at, scores.mean(axis=0), color=colour, linewidth=1.6, label=name)
        if len(results) > 1:
            axes.fill_between(at, scores.min(axis=0), scores.max(axis=0), color=colour, alpha=0.15, linewidth=0)
    axes.legend()
    return fig
