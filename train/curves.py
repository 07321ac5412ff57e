"""The validation score over the training, each seed and their mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from mrdamp.pictures import style
from mrdamp.train.run import Result


@style.styled
def curve(result: Result) -> Figure:
    """Of one training."""
    return curves([result])


def curves(results: Sequence[Result]) -> Figure:
    """One thin line a seed, a thick one their mean at the evaluations that all have."""
    fig = style.figure(0.55 * style.WIDTH)
    axes = fig.add_subplot()
    for result in results:
        at = [row["timesteps"] / 1e6 for row in result.curve]
        axes.plot(
            at, [row["score"] for row in result.curve], color=style.COLOURS[0], linewidth=0.7, alpha=0.6
        )
    shared = min(len(result.curve) for result in results)
    at = np.mean([[row["timesteps"] / 1e6 for row in r.curve[:shared]] for r in results], axis=0)
    mean = np.mean([[row["score"] for row in r.curve[:shared]] for r in results], axis=0)
    axes.plot(at, mean, color=style.COLOURS[1], linewidth=1.8)
    axes.set_xlabel("control periods (millions)")
    axes.set_ylabel("validation score")
    return fig


@style.styled
def compared(named: Mapping[str, Sequence[Result]]) -> Figure:
    """One line a setting: the mean over its seeds at the evaluations that all have, and the seeds' range around it."""
    fig = style.figure(0.6 * style.WIDTH)
    axes = fig.add_subplot()
    for k, (name, results) in enumerate(named.items()):
        colour = style.COLOURS[k % len(style.COLOURS)]
        shared = min(len(result.curve) for result in results)
        at = np.mean([[row["timesteps"] / 1e6 for row in r.curve[:shared]] for r in results], axis=0)
        scores = np.array([[row["score"] for row in r.curve[:shared]] for r in results])
        axes.plot(at, scores.mean(axis=0), color=colour, linewidth=1.6, label=name)
        if len(results) > 1:
            axes.fill_between(
                at, scores.min(axis=0), scores.max(axis=0), color=colour, alpha=0.15, linewidth=0
            )
    axes.set_xlabel("control periods (millions)")
    axes.set_ylabel("validation score")
    axes.legend()
    return fig
