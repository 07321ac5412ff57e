"""The evolution strategy and the networks that it searches, without a plant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mrdamp.train.evolution import Cma, Shape, actions


def test_the_search_finds_the_minimum_of_an_ill_scaled_ellipsoid() -> None:
    scales = np.logspace(0, 3, 6)
    aim = np.linspace(-1, 1, 6)

    def cost(x: np.ndarray) -> np.ndarray:
        return np.asarray((scales * (x - aim) ** 2).sum(axis=-1))

    cma = Cma(np.zeros(6), 0.3, 10, np.random.default_rng(1))
    start = cost(cma.mean)
    for _ in range(150):
        cma.tell(cost(cma.ask()))
    assert cost(cma.mean) < 1e-7 * start
    assert cma.mean == pytest.approx(aim, abs=1e-3)


def test_the_search_goes_on_from_a_file_as_if_it_had_not_stopped(tmp_path: Path) -> None:
    def run(cma: Cma, generations: int) -> np.ndarray:
        for _ in range(generations):
            cma.tell((cma.ask() ** 4).sum(axis=1))
        return cma.mean

    whole = run(Cma(np.ones(4), 0.5, 8, np.random.default_rng(2)), 9)
    first = Cma(np.ones(4), 0.5, 8, np.random.default_rng(2))
    run(first, 5)
    first.save(tmp_path / "c.npz")
    second = Cma(np.zeros(4), 0.1, 8, np.random.default_rng(0))
    second.load(tmp_path / "c.npz")
    assert (run(second, 4) == whole).all()
    assert np.abs(second.average - whole).max() > 0
    once = Cma(np.zeros(4), 0.1, 8, np.random.default_rng(0))
    once.tell((once.ask() ** 4).sum(axis=1))
    np.testing.assert_allclose(once.average, 0.15 * once.mean)


def test_candidates_at_once_act_as_their_networks() -> None:
    shape = Shape(5, [4])
    rng = np.random.default_rng(0)
    candidates, seen = rng.standard_normal((3, shape.size)), rng.standard_normal((3, 2, 5))
    each = [[shape.network(c)(seen[k, j])[0] for j in range(2)] for k, c in enumerate(candidates)]
    assert actions(shape.layers(candidates), seen) == pytest.approx(np.array(each))
    assert (actions(shape.layers(shape.start(rng)[None]), seen[:1]) == 0).all()


@pytest.mark.parametrize("hidden", [[], [3], [4, 2]])
def test_a_network_begins_at_given_weights(hidden: list[int]) -> None:
    shape, rng = Shape(5, hidden), np.random.default_rng(1)
    weights, seen = 0.1 * rng.standard_normal(5), rng.standard_normal((20, 5))
    numbers = shape.linear(shape.start(rng), weights)
    assert numbers.shape == (shape.size,)
    assert shape.network(numbers)(seen)[:, 0] == pytest.approx(np.clip(seen @ weights, -1, 1), abs=1e-3)
