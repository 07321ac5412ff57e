"""Settings of a training, trainings that cannot go on; gradients through the chain against differences of runs."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from env_arguments import OWN
from mrdamp.cli import main
from mrdamp.compare.contenders import shipped_policies
from mrdamp.control.policy import Policy
from mrdamp.train.learn import points, train
from mrdamp.train.run import Result
from mrdamp.train.settings import ALGORITHMS, Options, settings
from mrdamp.train.worlds import world
from refusals import refuses

FRAME = "mrdamp/Frame-v0"
PLAIN = Path(__file__).resolve().parents[1] / "examples" / "plain_ppo.yml"


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("environment", [FRAME, "mrdamp/Cable-v0", "mrdamp/QuarterCar-v0"])
def test_every_algorithm_has_hyperparameters_that_its_environment_takes(
    algorithm: str, environment: str
) -> None:
    if algorithm == "adjoint" and environment != FRAME:
        refuses(lambda: settings(Options(environment, algorithm)), "no hyperparameters of adjoint")
        return
    for file in (None, PLAIN) if algorithm == "ppo" else (None,):
        chosen = settings(Options(environment, algorithm, hyperparameters=file))
        assert world(environment, chosen.env_kwargs).task(1).rows.period == chosen.env_kwargs["period"]


def test_overrides_reach_into_mappings_and_numbers_are_numbers() -> None:
    options = Options(
        overrides=("learning_rate=1e-4", "env_kwargs.history=7", "n_envs=4", "freeze=7"), timesteps=123
    )
    chosen = settings(options)
    assert (chosen.learner["learning_rate"], chosen.env_kwargs["history"]) == (1e-4, 7)
    assert (chosen.n_envs, chosen.n_timesteps) == (4, 123)
    assert chosen.env_kwargs["period"] == settings(Options()).env_kwargs["period"]


def test_wrong_options_are_refused_in_a_line_by_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    for arguments, said in (
        (["--set", "env_kwargs.periods=1"], "periods"),
        (["--set", "sigmas=1"], "'sigmas' is unknown; allowed: loads, population, "),
        (["--set", "env_kwargs.reward={exponent: abc}"], "exponent is 'abc'; allowed: above 0 to 20"),
        (["--algo", "es", "--set", "env_kwargs.damper_between=[[0,1],[1,2]]"], "training 2 dampers: allowed"),
    ):
        assert main(["train", FRAME, "-o", out, *arguments]) == 2
        error = capsys.readouterr().err.strip().splitlines()[-1]
        assert error.startswith("mrdamp: ")
        assert said in error
    assert not list(tmp_path.glob("out/*/options.json"))


def test_a_training_of_a_file_that_has_changed_is_refused(tmp_path: Path) -> None:
    text = Path(OWN.rpartition(":")[0]).read_text()
    file = tmp_path / "mine.py"
    file.write_text(text)
    few = ("population=4", "loads=2", "env_kwargs.timestep=0.005")
    options = Options(f"{file}:Isolated", "es", timesteps=100, overrides=few, evaluations=1)
    train(options, tmp_path / "out")
    assert train(options, tmp_path / "out").curve
    file.write_text(text + "# changed\n")
    refuses(lambda: train(options, tmp_path / "out"), r"another content of .*mine\.py")


def test_a_folder_holds_seeds_of_one_training_and_its_summary_all_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, out = list[int](), tmp_path / "out"

    def drawing(results: Sequence[Result]) -> Figure:
        drawn.append(len(results))
        return Figure()

    monkeypatch.setattr("mrdamp.train.learn.curves", drawing)

    def train_seed(seed: int, loads: int, *more: str) -> int:
        few = ["population=4", "env_kwargs.timestep=0.005", f"loads={loads}"]
        given = ["--algo", "es", "--timesteps", "100", "--evaluations", "1", "--set", *few, "--seed", str(seed), *more]
        return main(["train", OWN, *given, "-o", str(out)])

    assert train_seed(0, 2) == 0
    for seed, loads, more, said in ((2, 3, (), "loads"), (2, 2, ("--timesteps", "200"), "n_timesteps")):
        assert train_seed(seed, loads, *more) == 2
        assert f"{out}: {said} is another one in seed_0; choose" in capsys.readouterr().err
    assert [f.name for f in out.glob("seed_*")] == ["seed_0"]
    assert train_seed(2, 2) == 0
    (row,) = json.loads((out / "sweep.json").read_text())
    assert [seed["seed"] for seed in row["seeds"]] == [0, 2]
    assert drawn == [1, 2]


def test_values_of_a_sweep_may_hold_commas_in_brackets() -> None:
    found = points(["policy_kwargs.net_arch=[8],[16,16]", "env_kwargs.noise={a: 1, b: 2},null"])
    nets, noises = ("[8]", "[16,16]"), ("{a: 1, b: 2}", "null")
    assert found == [(f"policy_kwargs.net_arch={n}", f"env_kwargs.noise={m}") for n in nets for m in noises]
    refuses(lambda: points(["a=[1,2],[1,2]"]), "a value is given twice")


pytest.importorskip("stable_baselines3", reason="needs the extra train")
SMALL = {
    "es": ("population=4", "loads=2", "env_kwargs.timestep=0.005"),
    "ppo": ("n_envs=2", "n_steps=16", "batch_size=16", "env_kwargs.timestep=0.005"),
    "sac": ("n_envs=2", "train_freq=8", "learning_starts=40", "env_kwargs.timestep=0.005"),
}


def options(algorithm: str, timesteps: int) -> Options:
    return Options(OWN, algorithm, timesteps=timesteps, overrides=SMALL[algorithm], evaluations=1)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    made: dict[str, Path] = {}

    def of(algorithm: str) -> Path:
        if algorithm not in made:
            made[algorithm] = tmp_path_factory.mktemp(algorithm) / "out"
            train(options(algorithm, 32), made[algorithm])
        return made[algorithm]

    return of


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


@pytest.mark.parametrize(
    ("algorithm", "file", "harm", "said"),
    [
        ("es", "checkpoint.npz", cut, "damaged"),
        ("es", "checkpoint.npz", Path.unlink, "missing"),
        ("ppo", "checkpoint.pt", cut, "damaged"),
        ("es", "normalization.npy", lambda file: np.save(file, np.load(file)[:, 1:]), "damaged"),
        ("es", "options.json", lambda file: file.write_text("{}"), "damaged"),
        ("es", "policy.json", cut, "no JSON.*"),
    ],
)
def test_a_damaged_training_is_named(
    trained: Callable[[str], Path], algorithm: str, file: str, harm: Any, said: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    shutil.copytree(trained(algorithm), out)
    harm(out / file)
    before = {f: f.read_bytes() for f in out.rglob("*") if f.is_file()}
    given = [options(algorithm, 100_000), *([options(algorithm, 32)] if file == "policy.json" else [])]
    for each in given:  # finished, it is read too
        refuses(partial(train, each, out), f"{file}: {said}; delete the folder, and the training begins again")
    assert {f: f.read_bytes() for f in out.rglob("*") if f.is_file()} == before


@pytest.mark.parametrize(
    ("algorithm", "more", "least"),
    [
        # Of 32 periods: the actor waits in the rollouts that begin at 0 and 32, and learns from that at 64 on.
        ("ppo", ("freeze=33",), 64),
        # A rate that falls to zero is zero after the only rollout.
        ("ppo", ("freeze=0", "learning_rate=linear_0.001"), 32),
        # Collections of 16 periods: that which ends at 48 is the first behind 40.
        ("sac", (), 32),
    ],
)
def test_what_would_learn_nothing_is_refused_with_the_number_that_is_needed(
    algorithm: str, more: tuple[str, ...], least: int, tmp_path: Path
) -> None:
    few = replace(options(algorithm, least), overrides=(*SMALL[algorithm], *more))
    refuses(lambda: train(few, tmp_path), f"{algorithm}: {least} control periods; allowed: more than {least}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("algorithm", "override", "said"),
    [
        ("td3", "train_freq=0", "train_freq is 0; allowed: a whole number, 1 or more"),
        ("sac", "policy_kwargs.activation_fn=Foo", "activation_fn is 'Foo'; allowed: Tanh, ReLU, ELU"),
        ("sac", "batch_size=0", "batch_size is 0; allowed: a whole number, 1 or more"),
        ("ppo", "batch_size=0", "batch_size is 0; allowed: a whole number, 1 or more"),
        ("td3", "gamma=2", "gamma is 2; allowed: a number above 0, up to 1"),
        ("ppo", "gamma=2", "gamma is 2; allowed: a number above 0, up to 1"),
        ("sac", "gradient_steps=0", "gradient_steps is 0; allowed: a whole number, 1 or more, or -1"),
        ("ppo", "n_epochs=1.5", "n_epochs is 1.5; allowed: a whole number, 1 or more"),
        ("ppo", "learning_rate=linear_0", "learning_rate is 0.0; allowed: a number > 0"),
    ],
)
def test_values_that_a_learner_cannot_use_are_named(
    algorithm: str, override: str, said: str, tmp_path: Path
) -> None:
    few = replace(options("ppo", 32), algorithm=algorithm, overrides=("env_kwargs.timestep=0.005", override))
    refuses(lambda: train(few, tmp_path), re.escape(f"{algorithm}: ") + ".*" + re.escape(said))
    assert not list(tmp_path.iterdir())


torch = pytest.importorskip("torch")

from mrdamp.train.adjoint import AdjointRun  # noqa: E402

pytestmark = pytest.mark.usefixtures("few_validation_motions")


def made(folder: Path, *overrides: str) -> AdjointRun:
    short = ("loads=2", "policy_kwargs.net_arch=[4]", "env_kwargs.timestep=0.001", *overrides)
    chosen = Options(algorithm="adjoint", overrides=short, timesteps=1, evaluations=1)
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
