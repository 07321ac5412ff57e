"""Training by gradients through the chain: the adjoint against differences of whole runs, and a training's files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from mrdamp.compare.contenders import shipped_policies  # noqa: E402
from mrdamp.control.policy import Policy  # noqa: E402
from mrdamp.train.adjoint import AdjointRun  # noqa: E402
from mrdamp.train.settings import Options, settings  # noqa: E402

pytestmark = pytest.mark.usefixtures("few_validation_motions")
SHORT = ("loads=2", "policy_kwargs.net_arch=[4]", "env_kwargs.timestep=0.001")


def options(*overrides: str, steps: int = 1) -> Options:
    return Options(algorithm="adjoint", overrides=(*SHORT, *overrides), timesteps=steps, evaluations=1)


def made(folder: Path, *overrides: str) -> AdjointRun:
    chosen = options(*overrides)
    return AdjointRun(chosen, settings(chosen), folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, few_validation_motions: None) -> AdjointRun:
    found = made(tmp_path_factory.mktemp("run"), "least=null", "current=0")
    with torch.no_grad():  # a network that does something
        rng = np.random.default_rng(3)
        found.soft.out.copy_(torch.from_numpy(0.05 * rng.standard_normal((2, 4)).astype(np.float32)))
    return found


def test_the_adjoint_is_the_difference_of_whole_closed_loops(run: AdjointRun) -> None:
    """A command pushed at one period, the loop closed afterwards by a smooth law: the value changes as the sweep
    says. The law feeds back every signal, the leaky peak and every state of the filter."""
    loads = run.world.structure.some(np.random.default_rng(4), 2)
    rng = np.random.default_rng(0)
    gains = 0.02 * rng.standard_normal(run.task.observer.size)

    def law(o: np.ndarray) -> np.ndarray:
        return np.asarray(1.1 + o.astype(np.float64) @ gains)

    base = run.loop.run(loads, law, 0.0, rng)
    assert 0.1 < base.commands.min() < base.commands.max() < 2.1
    value, by_channel = run.value(base)
    assert value > 0
    each = run.loop.adjoint(base, by_channel, np.broadcast_to(gains, base.observations.shape))
    none, blind = np.zeros(base.channels.shape), np.zeros(base.observations.shape)
    np.testing.assert_array_equal(run.loop.adjoint(base, none, blind, 0.3), 0.3)  # the price of the current alone
    largest = np.abs(each).max(axis=0)
    for row in range(2):
        for k in np.argsort(-np.abs(each[:, row]))[[0, 20]]:
            pushed = []
            for push in (1e-3, -1e-3):
                at = iter(range(len(base.commands)))

                def act(
                    o: np.ndarray, at: Iterator[int] = at, push: float = push, k: int = k, row: int = row
                ) -> Any:
                    found = law(o)
                    found[row] += push * (next(at) == k)
                    return found

                pushed.append(run.value(run.loop.run(loads, act, 0.0, rng))[0])
            assert (pushed[0] - pushed[1]) / 2e-3 == pytest.approx(each[k, row], abs=0.02 * largest[row])


def observations(size: int) -> Any:
    return np.random.default_rng(0).normal(0, 0.3, (300, size)).astype(np.float32)


def test_the_slopes_of_a_policy_are_its_differences(run: AdjointRun) -> None:
    """Away from the jump where the force changes its sign, and from the kinks of the inverse."""
    o = observations(run.task.observer.size)
    seen = torch.from_numpy(o).requires_grad_(True)
    commands = run.soft(seen)
    np.testing.assert_allclose(run.soft.commands(o), commands.detach().numpy(), atol=2e-4)
    slopes = torch.autograd.grad(commands.sum(), seen)[0].numpy()
    force = run.task.observer.signals.index("force")
    for column in range(o.shape[1]):
        up, down = o.copy(), o.copy()
        up[:, column] += 1e-3
        down[:, column] -= 1e-3
        found = (run.soft.commands(up) - run.soft.commands(down)) / 2e-3
        smooth = np.abs(o[:, force]) > 2e-3
        close = np.isclose(found, slopes[:, column], rtol=0.02, atol=2e-3 + 0.02 * np.abs(found).max())
        assert close[smooth].mean() > 0.9, column
    assert np.abs(slopes).max() > 0.1


def test_a_motion_and_its_mirror_image_are_commanded_alike(run: AdjointRun) -> None:
    o = observations(run.task.observer.size)
    names = run.task.observer.names
    unsigned = [k for k, name in enumerate(names) if name == "command" or "^" in name]
    mirror = -o
    mirror[:, unsigned] = o[:, unsigned]
    found = run.soft.commands(o)
    np.testing.assert_allclose(run.soft.commands(mirror), found, atol=2e-4)
    assert found.std() > 0.3
    assert np.abs(run.soft.commands(-o) - found).max() > 1e-3  # the unsigned ones are observed


@pytest.mark.parametrize("folder", [False, True])
def test_a_training_begins_at_a_linear_policy(tmp_path: Path, folder: bool) -> None:
    """Of a shipped set or of a training's folder, apart from that one's small offset."""
    file = shipped_policies("frame")["learned"][0]
    shipped = Policy.read(file)
    (tmp_path / "es" / "seed_0").mkdir(parents=True)
    shipped.write(tmp_path / "es" / "seed_0" / "policy.json")
    own = made(tmp_path / "own", *([f"start={tmp_path / 'es'}"] if folder else []))
    names = own.task.observer.names
    o = observations(len(names))
    old = o[:, [names.index(name) for name in shipped.observer.names]]
    theirs = shipped.commands(old, shipped.observer.measured(old, "force"))
    np.testing.assert_allclose(own.soft.commands(o), theirs, atol=0.03)
    assert theirs.std() > 0.3


def test_what_is_exported_is_what_was_trained(run: AdjointRun, tmp_path: Path) -> None:
    policy = run.policy()
    policy.write(tmp_path / "policy.json")
    read = Policy.read(tmp_path / "policy.json")
    o = observations(read.observer.size)
    force = read.observer.measured(o, "force")
    np.testing.assert_allclose(read.commands(o, force), run.soft.commands(o), atol=2e-4)
    assert (run.soft.commands(o) > 0).any()
