"""Identification: time of a fit over the time of its records, and against SciPy around a law in Python."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, clock, interleave, ratio
from mrdamp.identify import Problem, descend, identify
from mrdamp.identify.excerpts import excerpts
from mrdamp.identify.laws import Scales, parametric, space
from mrdamp.model import core
from mrdamp.model.core import Array
from mrdamp.narx import lagged, train_narx
from mrdamp.narx.splits import varying_command
from mrdamp.records import Record, embedded

RECORD = "sine_5.0Hz_2.5mm_random_current"
#: Bouc-Wen law: damping and its slope, hysteretic force and its slope, rate of the loop; the scale of each and where
#: the fits against each other start, in scales.
NAMES = ("c0a", "c0b", "alpha_a", "alpha_b", "A")
SCALE = np.array([1e3, 1e3, 1e3, 1e3, 1e3])
START = np.array([0.5, 0.5, 0.3, 0.3, 1.0])
_STEPS = 12  # of the fits against each other


def in_python(record: Record) -> Callable[[Array], Array]:
    """Force (n,) N of the Bouc-Wen law in plain floats, explicit midpoint rule, two steps in a sample."""
    v, u = record.velocity().tolist(), record.command.tolist()
    h = record.sample_time / 2

    def force(p: Array) -> Array:
        c0a, c0b, alpha_a, alpha_b, slope = (float(x) for x in p * SCALE)
        half = 0.5 * slope
        z, out = 0.0, [c0a * v[0] + c0b * u[0] * v[0]]
        for k in range(1, len(v)):
            a, b = v[k - 1], v[k]
            middle = 0.5 * (a + b)
            for begin, end in ((a, middle), (middle, b)):
                mid = 0.5 * (begin + end)
                z_mid = z + 0.5 * h * (slope * begin - half * (abs(begin) * abs(z) + begin * z) * z)
                z += h * (slope * mid - half * (abs(mid) * abs(z_mid) + mid * z_mid) * z_mid)
            out.append((c0a + c0b * u[k]) * b + (alpha_a + alpha_b * u[k]) * z)
        return np.array(out)

    return force


def in_c(record: Record) -> Callable[[Array], Array]:
    """The same through the C entry."""
    v = record.velocity()

    def force(p: Array) -> Array:
        numbers = dict(zip(NAMES, (p * SCALE).tolist(), strict=True))
        half = 0.5 * numbers["A"]
        fixed = {"n": 2.0, "k0": 0.0, "x0": 0.0, "gamma": half, "beta": half}
        vector = core.vector("bouc_wen", numbers | fixed)
        out = core.run_many(
            "bouc_wen", vector, record.sample_time, record.displacement, record.command, v=v, substep=1e-3
        )
        return np.asarray(out[0, 0])

    return force


def fitted(force: Callable[[Array], Array], measured: Array) -> Array:
    """SciPy's least squares with its own differences."""
    found = least_squares(
        lambda p: (force(p) - measured) / measured.std(), START, diff_step=1e-5, max_nfev=_STEPS
    )
    return np.asarray(found.x)


def measure(effort: Effort) -> list[Section]:
    """The tables; few steps mean a part of the records and one start."""
    with threadpool_limits(limits=1):
        over = _over_records(effort)
    return [over, _against(effort)]


def _over_records(effort: Effort) -> Section:
    whole = effort.steps >= 1000
    train: Sequence[Record] = embedded().train
    train = train if whole else [r.part(r.time[0], r.time[0] + 1.0) for r in train[:3]]
    seconds = sum(r.duration for r in train)
    figures = []
    for law in parametric():
        begin = clock()
        fit = identify(law, train, starts=4 if whole else 1, threads=1)
        cost = 1e-6 * (clock() - begin)
        name = law.replace("_", " ")
        detail = f"{cost:.1f} s for {seconds:.0f} s of records, {fit.evaluations} runs of the law"
        figures.append(Figure(f"{name}, from {fit.starts} starts", cost / seconds, "x", "<= 0.2", detail))
    splits = varying_command(embedded(), RECORD)
    (part,) = splits.train if whole else [splits.train[0].part(0, 800)]
    begin = clock()
    train_narx([part], inputs=lagged("viF", 4), hidden=(20,), initialisations=1, horizons=(),
               one_step_iterations=150 if whole else 5)  # fmt: skip
    cost = 1e-6 * (clock() - begin)
    figures.append(
        Figure("network 15-20-1, one initialisation", cost, "s", "<= 60", f"{part.n} samples, one step ahead")
    )
    text = "CPU time of a fit, one thread, over the duration of its records (embedded, at 500 Hz)."
    return Section("Identification", text, tuple(figures))


def _against(effort: Effort) -> Section:
    rounds = min(effort.rounds, 7)
    record = embedded()[RECORD].part(0.0, 4.0 if effort.steps >= 1000 else 0.5)
    measured = record.channel("force_N")
    tasks = {
        "python": partial(fitted, in_python(record), measured),
        "c": partial(fitted, in_c(record), measured),
    }
    gap = float(np.abs(tasks["python"]() - tasks["c"]()).max())
    costs = interleave({name: _timed(task) for name, task in tasks.items()}, rounds)
    law = of_ratio(
        "least squares around the law in Python over the C entry", ratio(costs["python"], costs["c"]),
        note=f"{record.n} samples; parameters differ by {gap:.1g} of their scale",
    )  # fmt: skip
    train = excerpts(embedded().train, 24_000 if effort.steps >= 1000 else 2_000)
    problem = Problem(space("bouc_wen", Scales.of(train), ("offset",)), train, 1)
    costs = interleave(
        {
            "scipy": _timed(partial(_by_scipy, problem), time.process_time_ns),
            "ours": _timed(partial(descend, problem, problem.space.start, _STEPS), time.process_time_ns),
        },
        rounds,
    )
    plain = of_ratio(
        "SciPy as it is over ours, CPU time of all threads", ratio(costs["scipy"], costs["ours"]),
        note=f"Bouc-Wen law, {sum(r.n for r in train)} samples, the same steps",
    )  # fmt: skip
    text = (
        "First row: SciPy's least_squares on five parameters of a Bouc-Wen law, with the law in Python and with the C "
        "entry and its whole chain. Second row: one local fit with the C entry, by SciPy with as many BLAS threads as "
        "it uses, and by `mrdamp.identify.least_squares` with one. At most 7 rounds."
    )
    return Section("Identification against SciPy", text, (law, plain))


def _by_scipy(problem: Problem) -> None:
    def jacobian(p: Array) -> Array:
        return problem.jacobian(p, problem.residuals(p[None])[0])

    least_squares(
        lambda p: problem.residuals(p[None])[0], np.clip(problem.space.start, 1e-6, 1 - 1e-6), jacobian,
        bounds=(0, 1), ftol=1e-6, xtol=1e-6, gtol=1e-9, max_nfev=_STEPS,
    )  # fmt: skip


def _timed(task: Callable[[], object], clock: Callable[[], int] = time.thread_time_ns) -> Callable[[], float]:
    """The task's CPU time, us."""

    def timed() -> float:
        begin = clock()
        task()
        return 1e-3 * (clock() - begin)

    return timed
