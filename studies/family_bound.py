"""How often would noise alone name a cause? `python studies/family_bound.py CASE`.

The family-wise bound of the catalogue by a parametric bootstrap: on a case without a cause (or with wrong numbers
only) the recalibrated simulator is taken for the truth, noise is drawn anew with the spectrum that two runs of one
test differ by, and every effect of the catalogue is fitted to the draw by its signature, alone. What counts is the
best of them all. The verdict's own rule then decides whether it would have been named.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.case.folder import Case, read_case
from mrdamp.diagnosis.constants import REDUCIBLE
from mrdamp.diagnosis.evidence.verdict import Scored, decide, idle_penalty
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.make import make_rig
from mrdamp.diagnosis.problem.noise import channel_noise, floors, repeatable, trust
from mrdamp.diagnosis.problem.residuals import Problem, compared
from mrdamp.errors import InputError
from mrdamp.model.core import Array

_SAMPLES, _DRAWS = 20_000, 1000
#: Signatures are stretched by no more than in a search.
_STRETCH = 4.0


@dataclass(frozen=True)
class Signature:
    """What an effect changes on top of a fit, less what the fit's own numbers can make of it (samples,)."""

    cause: str
    numbers: int
    two_sided: bool
    change: Array

    def fall(self, residual: Array) -> float:
        """Of the cost, at the best size."""
        size = float(self.change @ self.change)
        if size < 1e-12:
            return 0.0
        at = float(self.change @ residual)
        by = min(max(-at / size, -_STRETCH if self.two_sided else 0.0), _STRETCH)
        return -by * (2 * at + by * size)


def signatures(search: Search, found: Fit) -> list[Signature]:
    """Of all terms of the catalogue at all their starts."""
    basis = np.linalg.qr(found.jacobian)[0]
    out = []
    for term in search.problem.rig.terms:
        for k in range(len(term.starts)):
            hypothesis, point = search.start_from(found, term, k)
            d = search.problem.residuals(hypothesis, point)[0] - found.residual
            own = np.asarray(d - basis @ (basis.T @ d))
            if own @ own > 1e-6 * float(d @ d):
                out.append(Signature(term.cause, len(term.coordinates), term.two_sided, own))
    return out


def noise_draw(problem: Problem, case: Case, levels: Array, rng: np.random.Generator) -> Array:
    """Weighted noise (samples,): white noise with the spectrum of what two runs of one test differ by."""
    out = np.empty(problem.samples)
    for b in problem.blocks:
        record = problem.rig.records[b.record]
        white = rng.standard_normal(record.n)
        coloured = np.fft.irfft(np.fft.rfft(white) * _shape(case, problem, b.channel, record.n), record.n)
        coloured = coloured[problem.taken(b.record)] * levels[b.channel] / float(np.std(coloured))
        out[b.span] = coloured * problem.weights[b.span]
    return out


def _shape(case: Case, problem: Problem, channel: int, n: int) -> Array:
    """Amplitude spectrum (n // 2 + 1,) of the noise of a channel, smoothed."""
    name = problem.rig.channels[channel]
    pairs = [(case.records[k], r) for r, k in case.repeats if k is not None]
    if not pairs:
        return np.ones(n // 2 + 1)
    apart = [(a.channel(name) - b.channel(name))[compared(a.n, a.sample_time)] for a, b in pairs]
    power = np.abs(np.fft.rfft(apart[0])) ** 2
    wide = max(1, len(power) // 100)
    smooth = np.convolve(np.pad(power, wide, mode="edge"), np.full(2 * wide + 1, 1 / (2 * wide + 1)), "valid")
    grid, own = np.linspace(0, 1, n // 2 + 1), np.linspace(0, 1, len(smooth))
    return np.sqrt(np.interp(grid, own, smooth))


def bound(case: Case, draws: int, seed: int) -> tuple[Array, list[str], str]:
    """Largest relative fall of the cost over the catalogue in each draw (draws,), the verdict's answer to each, and
    the effect that comes out best most often. Raises InputError for a case that no noise explains."""
    rig = make_rig(case)
    stride = max(1, round(sum(r.n for r in case.records) * len(rig.channels) / _SAMPLES))
    noise, _ = repeatable(channel_noise(case, rig), case, rig)
    plain = Problem(rig, stride=stride, coarse=True)
    floor = floors(plain, noise, {})
    problem = Problem(rig, stride=stride, coarse=True, trust=trust(plain, floor))
    search = Search(problem, problem.cost(floor), Limits())
    base, held = search.base, search.fits[False, frozenset()]
    if search.unexplained(base) > 0.5 and base.cost > 2 * search.floor:
        raise InputError(f"{case.name}: the recalibrated simulator leaves more than noise; there is a cause")
    basis = np.linalg.qr(base.jacobian)[0]
    found = signatures(search, base)
    rng = np.random.default_rng(seed)
    bias = held.residual - base.residual  # of the nominal numbers: none where they are right
    idle = idle_penalty(base.move)  # of a cause that explains nothing beyond the free parameters, as in a search
    falls, answers, best = [], [], []
    for _ in range(draws):
        e = noise_draw(problem, case, noise.levels, rng)
        left = e - basis @ (basis.T @ e)
        cost = float(left @ left)
        gained = [s.fall(left) for s in found]
        nominal = float(np.sum((e + bias) ** 2))
        scored = [Scored((), False, nominal, 0, 0), Scored((), True, cost, 0, 1, move=base.move)]
        scored += [
            Scored((s.cause,), True, cost - g, s.numbers, k, idle if g < REDUCIBLE * cost else 0.0, base.move)
            for k, (s, g) in enumerate(zip(found, gained, strict=True), 2)
        ]
        answers.append(decide(scored, search.floor).verdict)
        falls.append(max(gained) / cost)
        best.append(found[int(np.argmax(gained))].cause)
    return np.array(falls), answers, max(set(best), key=best.count)


def main(arguments: Sequence[str] | None = None) -> int:
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("cases", nargs="+", help="folders of cases without a cause")
    p.add_argument("--draws", type=int, default=_DRAWS)
    p.add_argument("--seed", type=int, default=1)
    a = p.parse_args(arguments)
    for folder in a.cases:
        case = read_case(folder)
        falls, answers, best = bound(case, a.draws, a.seed)
        middle, most, rare = np.percentile(falls, [50, 95, 99.9])
        named = sum(v in ("effect", "unknown") for v in answers)
        print(
            f"{case.name}: the best of the catalogue takes {100 * middle:.2f} % off the cost of noise in the median, "
            f"{100 * most:.2f} % in one draw of 20, {100 * rare:.2f} % in one of 1000 (named from "
            f"{100 * REDUCIBLE:.0f} % on); a cause in {named} of {a.draws} draws, most often best: {best}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
