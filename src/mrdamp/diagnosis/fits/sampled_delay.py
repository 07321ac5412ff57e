"""Sampling clock of a controller as part of a command delay: period and phase from the residual of a constant
delay.

A command that is sampled and held has a delay that varies as a sawtooth about its mean. The product of the
residual of a constant delay and of the delay's signature then has a spectral line at the clock's frequency.
The line is as narrow as the inverse of the record's length, so that a fit from another period does not
converge to it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.table import FitTable
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Term, positive
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

#: Number of spectral lines tried, each the highest outside the others' widths; points of the spectrum per
#: line width.
_LINES, _FINE = 3, 8
#: Least period as a share of the mean delay; least relative reduction of the cost at the start.
_SHORTEST, _WORTH = 0.05, 0.02


def try_sampled_delay(table: FitTable, found: Fit | None) -> None:
    """Fits a sampled delay in place of the constant delay of a fit, if the records show a clock, and keeps
    it."""
    if (
        found is None
        or table.solved(found)
        or "command_delay" not in (t.name for t in found.hypothesis.terms)
    ):
        return
    starts = list(sampled_delays(table.problem, found))
    costs = [float(np.sum(table.problem.residuals(h, q) ** 2)) for h, q in starts]
    if costs and min(costs) < (1 - _WORTH) * found.cost:
        hypothesis, start = starts[int(np.argmin(costs))]
        table.keep(table.fitted(hypothesis, start, most=8, stage=" clocked"))


def sampled_delays(problem: Problem, found: Fit) -> Iterator[tuple[Hypothesis, Array]]:
    """Hypotheses with points in which the constant delay of a fit is a sampled one, the highest spectral line
    first."""
    terms = found.hypothesis.terms
    column = [c.name for c in found.hypothesis.coordinates].index("command_delay_d")
    mean = found.settings["command_delay_d"]
    for frequency, value in lines(problem, found, column, mean):
        period = 1 / frequency
        delay = max(mean - period / 2, 1e-4)
        # The residual varies as +sin(2 pi (f (t - d) - phase)) if the delay is a rising sawtooth.
        phase = float((-(np.angle(value) + np.pi / 2) / (2 * np.pi) - frequency * delay) % 1)
        term = sampled_delay_term(delay, period, phase if phase > 0.25 else phase + 1)
        hypothesis = Hypothesis(
            found.hypothesis.nominal, tuple(term if t.name == "command_delay" else t for t in terms)
        )
        yield hypothesis, np.concatenate([found.point[:column], np.zeros(3), found.point[column + 1 :]])


def sampled_delay_term(delay: float, period: float, phase: float) -> Term:
    """A delay (s) with a sampling clock: period (s) and time of a tick (in periods), in ranges about these
    values."""
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
    """Frequencies (Hz) and complex values of the highest spectral lines that a clock with a delay of `mean`
    (s) can cause."""
    # All samples are used: with decimation a fast clock would be aliased.
    whole = problem.like(stride=1)
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
