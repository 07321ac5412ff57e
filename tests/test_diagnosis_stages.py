"""Where the gap is put: what causes change against what a free law could take, and what an error's size goes with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mrdamp import core
from mrdamp.core import Array
from mrdamp.diagnosis.damper import DamperRig
from mrdamp.diagnosis.fit import fit
from mrdamp.diagnosis.problem import Problem
from mrdamp.diagnosis.search import Search
from mrdamp.diagnosis.size import ErrorSizes
from mrdamp.diagnosis.terms import Hypothesis
from mrdamp.diagnosis.where import Changes, stage_shares
from mrdamp.model import Model
from mrdamp.records import Record
from toy_rig import toy

LAW = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
DT, NOISE = 4e-3, 3.0
TIME = DT * np.arange(1500)
X, U = 0.01 * np.sin(7 * TIME) + 0.004 * np.sin(17 * TIME), 0.5 + 0.5 * np.sign(np.sin(2.1 * TIME))


def test_a_free_law_gets_what_it_changed_and_not_what_it_could_take() -> None:
    """Alone the gain takes up nearly all of a cubic part; beside the cause it moves little, and that is its share."""
    rig = toy({"cubic": 0.5, "gain": 2.02}, 0.005)
    problem = Problem(rig)
    search = Search(problem, sum((0.005 / b.size) ** 2 for b in problem.blocks))
    hypothesis = Hypothesis(rig.nominal, tuple(t for t in rig.terms if t.effect == "cubic"))
    chosen = fit(problem, hypothesis, hypothesis.start(), tolerance=1e-8)
    assert search.base.cost < 0.3 * search.nominal_cost  # alone, the law does most of it
    shares = stage_shares(search, chosen, "effect")
    cubic, gain = 0.5 * X3, 0.02 * X1
    whole = cubic + gain
    assert shares["fluid"] == pytest.approx(1.0)  # the toy's cubic part and the law are of one stage
    found = Changes.of(search, chosen).table.sum(axis=0)
    expected = np.array([cubic @ whole, gain @ whole])
    assert found / found.sum() == pytest.approx(expected / expected.sum(), abs=0.02)
    assert found[0] > 10 * found[1]


def _toy_parts() -> tuple[Array, Array]:
    """The toy's displacements, cubed and as they are, weighted as its residuals."""
    rig = toy({"cubic": 0.5, "gain": 2.02}, 0.005)
    problem = Problem(rig)
    x = np.concatenate([np.asarray(rig.records[k].displacement)[problem.taken(k)] for k in problem.records])
    return x**3 * problem.weights, x * problem.weights


X3, X1 = _toy_parts()


def answer(x: Array, u: Array) -> Array:
    return np.asarray(core.run("bingham", LAW, DT, x, u=u, columns=("force",))["force"])


def hum(force: Array, still: Array) -> Array:
    return np.asarray(40 * np.sin(80 * TIME))


def chatter(force: Array, still: Array) -> Array:
    return np.asarray(0.12 * np.sin(60 * TIME) * force)


def dropouts(force: Array, still: Array) -> Array:
    return np.asarray(np.where((TIME % 1.7) < 0.2, still - force, 0.0))


@pytest.mark.parametrize(("error", "stage"), [(hum, "sensor"), (chatter, "fluid"), (dropouts, "driver")])
def test_the_size_of_an_error_tells_its_stage(error: Callable[[Array, Array], Array], stage: str) -> None:
    rng = np.random.default_rng(3)
    records = []
    for k, scale in enumerate((1.0, 0.6, 0.3)):
        force = answer(scale * X, U)
        read = force + error(force, answer(scale * X, 0 * U)) + NOISE * rng.standard_normal(len(force))
        records.append(Record(f"{k}", None, DT, {"displacement_m": scale * X, "command": U, "force_N": read}))
    problem = Problem(DamperRig(Model("bingham", LAW), tuple(records)))
    plain = fit(problem, Hypothesis(()), np.zeros(0), most=0)
    sizes = ErrorSizes.of(problem, plain, NOISE)
    assert sizes is not None
    shares = sizes.at()
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=lambda s: shares[s]) == stage
    assert shares[stage] > 0.6
    drawn = np.mean([max(sizes.at(k), key=lambda s: sizes.at(k)[s]) == stage for k in range(50)])
    assert drawn > 0.9


def test_a_lesser_cause_of_a_pair_is_exchanged_for_a_better_one() -> None:
    problem = Problem(toy({"sign": 0.6, "offset": 0.3}, 0.005))
    search = Search(problem, sum((0.005 / b.size) ** 2 for b in problem.blocks))
    terms = {t.effect: t for t in problem.rig.terms}
    pair = Hypothesis((), (terms["sign"], terms["late"]))
    search.keep(fit(problem, pair, pair.start()))
    search.exchange()
    best = search.best(False)
    assert best is not None
    assert set(best.hypothesis.causes) == {"sign", "offset"}
    assert search.solved(best)


def test_another_rig_has_no_such_sizes() -> None:
    problem = Problem(replace(toy({}), rivals=()))
    assert ErrorSizes.of(problem, fit(problem, Hypothesis(()), np.zeros(0), most=0), 1.0) is None
