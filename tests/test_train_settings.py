"""Settings of a training: defaults, overrides and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from env_arguments import OWN
from mrdamp.cli import main
from mrdamp.errors import InputError
from mrdamp.train.learn import train
from mrdamp.train.settings import ALGORITHMS, Options, settings
from mrdamp.train.worlds import world

FRAME = "mrdamp/Frame-v0"
PLAIN = Path(__file__).resolve().parents[1] / "examples" / "plain_ppo.yml"


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("environment", [FRAME, "mrdamp/Cable-v0", "mrdamp/QuarterCar-v0"])
def test_every_algorithm_has_hyperparameters_that_its_environment_takes(
    algorithm: str, environment: str
) -> None:
    if algorithm == "adjoint" and environment != FRAME:
        with pytest.raises(InputError, match="no hyperparameters of adjoint"):
            settings(Options(environment, algorithm))
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


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"environment": "CartPole-v1"}, "CartPole"),
        ({"overrides": ("learning_rate",)}, "NAME=VALUE"),
        ({"overrides": ("gamma.x=1",)}, "not a mapping"),
        ({"overrides": ("action=both",)}, "both"),
        ({"overrides": ("n_envs=some",)}, "n_envs"),
        ({"overrides": ("viscous=true", "switch=true")}, "exclude each other"),
        ({"hyperparameters": Path("no/such.yml")}, "no such file"),
        ({"model": Path("a.json"), "others": (Path("b.json"),)}, "ppo: 2 models"),
        ({"algorithm": "es", "others": (Path("b.json"),)}, "es: 2 models"),
    ],
)
def test_wrong_settings_are_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        settings(Options(**options))


def test_wrong_options_are_refused_in_a_line_by_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    for arguments, said in (
        (["--set", "env_kwargs.periods=1"], "periods"),
        (["--algo", "es", "--set", "sigmas=1"], "sigmas"),
        (["--sweep", "gamma"], "NAME=VALUE"),
        (["--seeds", "0"], "--seeds"),
        (["--algo", "es", "--set", "env_kwargs.damper_between=[[0,1],[1,2]]"], "training 2 dampers: allowed"),
    ):
        assert main(["train", FRAME, "-o", out, *arguments]) == 2
        error = capsys.readouterr().err.strip().splitlines()[-1]
        assert error.startswith("mrdamp: ")
        assert said in error
    assert not list(tmp_path.glob("out/*/options.json"))


def test_a_training_of_a_file_that_has_changed_is_refused(tmp_path: Path) -> None:
    """A structure of one's own and its training, after a number in the file is another one."""
    text = Path(OWN.rpartition(":")[0]).read_text()
    file = tmp_path / "mine.py"
    file.write_text(text)
    few = ("population=4", "loads=2", "env_kwargs.timestep=0.005")
    options = Options(f"{file}:Isolated", "es", timesteps=100, overrides=few, evaluations=1)
    train(options, tmp_path / "out")
    assert train(options, tmp_path / "out").curve
    file.write_text(text + "# changed\n")
    with pytest.raises(InputError, match=r"another content of .*mine\.py"):
        train(options, tmp_path / "out")
