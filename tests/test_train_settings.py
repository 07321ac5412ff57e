"""Settings of a training: defaults, overrides, what is refused, and trainings that cannot go on."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from env_arguments import OWN
from mrdamp.cli import main
from mrdamp.train.learn import train
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
