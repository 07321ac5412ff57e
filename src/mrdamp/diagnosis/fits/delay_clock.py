"""A controller's clock in the command's delay: its period and phase are read off what a plain delay leaves.

A command that is held between ticks is late by a sawtooth about the mean delay. The product of what a plain delay
leaves and of the delay's signature has a spectral line at the clock's frequency then, as narrow as the records are
long: a fit from any other period would not find it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.table import FitTable
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Term, positive
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

#: Lines tried, each the highest away from the others; points of the spectrum in the width of a line.
_LINES, _FINE = 3, 8
#: A period is no shorter than this share of the mean delay, and its start has to show this fall of the cost.
_SHORTEST, _WORTH = 0.05, 0.02


def try_clock(table: FitTable, found: Fit | None) -> None:
    """Fits a clock in the plain delay of a fit, where the records show one, and keeps it."""
    if (
        found is None
        or table.solved(found)
        or "command_delay" not in (t.name for t in found.hypothesis.terms)
    ):
        return
    starts = list(clocked(table.problem, found))
    costs = [float(np.sum(table.problem.residuals(h, q) ** 2)) for h, q in starts]
    if costs and min(costs) < (1 - _WORTH) * found.cost:
        hypothesis, start = starts[int(np.argmin(costs))]
        table.keep(table.fitted(hypothesis, start, most=8, stage=" clocked"))


def clocked(problem: Problem, found: Fit) -> Iterator[tuple[Hypothesis, Array]]:
    """Hypotheses with points where the plain delay of a fit is one with a clock, the highest line first."""
    terms = found.hypothesis.terms
    column = [c.name for c in found.hypothesis.coordinates].index("command_delay_d")
    mean = found.settings["command_delay_d"]
    for frequency, value in lines(problem, found, column, mean):
        period = 1 / frequency
        delay = max(mean - period / 2, 1e-4)
        # What is left goes as +sin(2 pi (f (t - d) - phase)) where a tick is late by a sawtooth that rises.
        phase = float((-(np.angle(value) + np.pi / 2) / (2 * np.pi) - frequency * delay) % 1)
        term = clock_term(delay, period, phase if phase > 0.25 else phase + 1)
        hypothesis = Hypothesis(
            found.hypothesis.nominal, tuple(term if t.name == "command_delay" else t for t in terms)
        )
        yield hypothesis, np.concatenate([found.point[:column], np.zeros(3), found.point[column + 1 :]])


def clock_term(delay: float, period: float, phase: float) -> Term:
    """A delay (s) behind the ticks of a clock: period (s), and time of a tick (in periods) near these."""
    return Term(
        "command_delay",
        "driver",
        (
            positive("command_delay_d", delay, 5e-5, 0.3, 0.1),
            positive("command_delay_period", period, 0.99 * period, 1.01 * period, 2e-3),
            Coordinate("command_delay_phase", phase, 0.0, 2.0, 0.2),
        ),
        ((delay, period, phase),),
        form="on a clock",
    )


def lines(problem: Problem, found: Fit, column: int, mean: float) -> Iterator[tuple[float, complex]]:
    """Frequencies (Hz) and values of the highest lines that a clock in a delay of `mean` (s) could have made."""
    # Every sample counts here: on fewer, a fast clock would look like a slow one.
    whole = Problem(problem.rig, problem.records, stride=1, coarse=problem.coarse, trust=problem.trust)
    residual = whole.residuals(found.hypothesis, found.point)[0]
    signature = whole.jacobian(found.hypothesis, found.point, residual, [column])[:, 0]
    records = problem.rig.records
    step = min(records[k].sample_time for k in problem.records)
    count = _FINE * round(max(records[k].n * records[k].sample_time for k in problem.records) / step)
    frequency = np.fft.rfftfreq(count, step)
    spectrum = np.zeros(len(frequency), dtype=complex)
    for b in whole.blocks:
        if records[b.record].sample_time != step:
            continue
        product = residual[b.span] * signature[b.span]
        start = (whole.taken(b.record).start or 0) * step
        spectrum += np.fft.rfft(product - product.mean(), count) * np.exp(-2j * np.pi * frequency * start)
    height = np.abs(spectrum) * ((frequency > 0.5 / mean) & (frequency < 1 / (_SHORTEST * mean)))
    for _ in range(_LINES):
        k = int(np.argmax(height))
        if height[k] == 0:
            return
        yield float(frequency[k]), complex(spectrum[k])
        height[max(k - 2 * _FINE, 0) : k + 2 * _FINE + 1] = 0
