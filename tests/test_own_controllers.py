"""Controllers from outside the package in a comparison, and what all controllers are told of the damper."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from scipy.signal import lfilter

from env_arguments import OWN as ISOLATED
from knowing import Watching, steady
from mrdamp.compare.benches import bench_of
from mrdamp.compare.comparison import compare
from mrdamp.compare.contenders import contenders
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.control import registry
from mrdamp.control.policy import Policy
from mrdamp.control.told import told
from mrdamp.envs import FrameEnv
from mrdamp.model import Effect
from mrdamp.motions import kanai_tajimi
from refusals import refuses

OWN = '''
class Steady:
    """Half of the largest command."""
    name, period = "steady", 0.005

    def __init__(self, site):
        self.value = site.command_max / 2

    def reset(self):
        pass

    def command(self, t, y):
        return self.value


class Broken(Steady):
    def command(self, t, y):
        return {body}


class Bare:
    name, period = "bare", 0.01
    reset = command = print


class Lazy:
    name = "lazy"

    def __init__(self, site):
        pass
'''
BENCH = FrameBench(frame_model())
LOAD = kanai_tajimi(5, duration=5.0)


def write(folder: Path, body: str = "None") -> Path:
    file = folder / "own_law.py"
    file.write_text(OWN.replace("{body}", body))
    return file


def test_a_class_of_ones_own_is_the_controller_that_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By file and by module: a constant of its own against the package's."""
    monkeypatch.chdir(tmp_path)
    file = write(tmp_path)
    rows = contenders(BENCH, [f"mine={file}:Steady", "other=own_law:Steady"], {})
    assert [row.name for row in rows] == ["mine", "other"]
    wanted = BENCH.run("constant:value=1.125", LOAD, 1.0)["criteria"]
    for row in rows:
        found = BENCH.run(row.specs[0], LOAD, 1.0)["criteria"]
        np.testing.assert_allclose(found["peak_drift"], wanted["peak_drift"], rtol=1e-3)
    keys = [BENCH.key(rows[0].specs[0], LOAD, 1.0)]
    file.write_text(file.read_text() + "\n")
    assert BENCH.key(rows[0].specs[0], LOAD, 1.0) not in keys  # a kept run belongs to the file as it was


def test_modules_of_two_folders_are_not_mixed_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python keeps one module of a name: the second folder's controller would get the first one's numbers."""
    monkeypatch.setattr(sys, "path", sys.path.copy())
    names = []
    for k in (1, 2):
        (tmp_path / str(k)).mkdir()
        (tmp_path / str(k) / "gain_of_two.py").write_text(f"GAIN = {k}\n")
        file = write(tmp_path / str(k), "gain_of_two.GAIN")
        file.write_text("import gain_of_two\n" + file.read_text())
        names.append(f"c{k}={file}:Broken")
    refuses(lambda: contenders(BENCH, names, {}), "its gain_of_two.py is hidden by .*1/gain_of_two.py")
    contenders(BENCH, names[:1], {})


def test_runs_of_code_from_outside_are_not_kept(tmp_path: Path) -> None:
    """A controller and a structure that read a number from a file beside them: a later comparison has the new one."""
    number = tmp_path / "number.txt"
    reads = f"float(__import__('pathlib').Path({str(number)!r}).read_text())"
    file = write(tmp_path, reads)
    largest = f"parameters=default_damper().parameters | {{'command_max': {reads}}}"
    damper = f"__import__('dataclasses').replace(default_damper(), {largest})"
    text = (
        Path(ISOLATED.rpartition(":")[0]).read_text().replace("return default_damper()", f"return {damper}")
    )
    (tmp_path / "isolated.py").write_text(text)
    for what, spec in (
        ("frame", f"mine={file}:Broken"),
        (f"{tmp_path / 'isolated.py'}:Isolated", "passive-on"),
    ):
        for value in (0.5, 1.5):
            number.write_text(str(value))
            bench = bench_of(what, engine="chain")
            (row,) = contenders(bench, [spec], {})
            assert bench.continues is (what == "frame")
            found = compare(bench, [row], bench.unseen_loads()[:1], (0.1,), keep=tmp_path / "kept.jsonl")
            assert found.values[row.name]["mean_command"].item() == pytest.approx(value)


@pytest.mark.slow
def test_the_pages_examples_are_what_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Less than the best constant command in the mean of drift and acceleration; with two dampers in acceleration."""
    monkeypatch.setattr(sys, "path", sys.path.copy())
    page = (Path(__file__).parents[1] / "docs" / "how-to" / "own_controller.md").read_text()
    one, two = (next(b for b in re.findall(r"```py\w*\n(.*?)```", page, re.S) if f"class {n}" in b)
                for n in ("Gentle", "Both"))  # fmt: skip
    (tmp_path / "gentle.py").write_text(one)
    (tmp_path / "both.py").write_text(two)
    found = []
    for dampers, best, mine in (((), "constant:value=1.71883", "gentle.py:Gentle"),
                                (((0, 1), (1, 2)), "passive-on", "both.py:Both")):  # fmt: skip
        bench = bench_of("frame", engine="chain", dampers=dampers)
        rows = contenders(bench, [f"base={best}", f"mine={tmp_path / mine}"], {})
        result = compare(bench, rows, bench.unseen_loads(), (0.4, 1.0, 1.6))
        found.append({k: result.against("mine", "base", k).mean for k in ("J1", "J2", "mean_command")})
    assert found[0]["J1"] + found[0]["J2"] < -0.02
    assert found[1]["J2"] < -0.005
    assert max(each["mean_command"] for each in found) < -0.2


STRUCTURES = {
    "frame": "mrdamp/Frame-v0",
    "cable": "mrdamp/Cable-v0",
    "car": "mrdamp/QuarterCar-v0",
    ISOLATED: ISOLATED,
}


@pytest.mark.parametrize("structure", STRUCTURES)
def test_a_policy_of_another_structure_is_refused(tmp_path: Path, structure: str) -> None:
    """By what its file says that it was trained in, though its signals are everywhere: in a comparison and one's own
    loop."""
    bench, file = bench_of(structure), tmp_path / "policy.json"
    for trained in ("", *STRUCTURES.values(), "elsewhere/another_file.py:Isolated", "file.py:Other"):
        steady(file, 0.0, about={"options": {"environment": trained}} if trained else {})
        fits = not trained or trained.rpartition(":")[2] == STRUCTURES[structure].rpartition(":")[2]
        for load in (
            partial(contenders, bench, [f"mine=policy:{file}"], {}),
            partial(told, lambda site: Policy.read(file), bench.site),
        ):
            if fits:
                load()
            else:
                refuses(load, f"policy.json: it was trained in {trained}; allowed here: ")


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
@pytest.mark.parametrize(
    ("body", "period", "acts"),
    [
        # Dyke's takes 0 to 2.25 V: any other command is the nearest of these.
        ("1e12", "0.005", 2.25),
        ("-2.25", "0.005", 0.0),
        # What is written to the measurements is nowhere; there are three accelerations and displacements, stroke, its
        # velocity and the force.
        ("[y.update({k: 0.0}) for k in y] and 2.25", "0.005", 2.25),
        ("y.clear() or 2.25", "0.005", 2.25),
        ("2.25 * (len(y) == 9)", "0.005", 2.25),
        *(("2.25 * (t % 0.0078125 == 0)", f"np.{number}(0.0078125)", 2.25) for number in ("float64", "float32")),
    ],
)
def test_a_command_acts_as_the_constant_that_it_is(
    tmp_path: Path, engine: str, body: str, period: str, acts: float
) -> None:
    bench, file = replace(BENCH, engine=engine), write(tmp_path, body)
    file.write_text("import numpy as np\n" + file.read_text().replace("0.005", period))
    ((spec,),) = (row.specs for row in contenders(bench, [f"mine={file}:Broken"], {}))
    found, wanted = (bench.history(s, LOAD, 1.0) for s in (spec, f"constant:value={acts}"))
    np.testing.assert_array_equal(found.command, acts)
    # A period of 5 ms is stepped as the constant's 1 ms; another one nearly so.
    np.testing.assert_allclose(np.abs(found.drift).max(0), np.abs(wanted.drift).max(0), rtol=5e-4)


@pytest.mark.parametrize(
    ("given", "body", "message"),
    [
        ("mine={}:Broken", "None", "its command at 0 s is None"),
        ("mine={}:Broken", "'2.25'", "own_law.py:Broken: its command at 0 s is '2.25'"),
        ("mine={}:Broken", "exit(3)", "own_law.py:Broken: SystemExit: 3"),
        ("mine={}:Bare", "0", "Bare: too many positional arguments; allowed: a class or function of the site"),
        ("mine={}:Broken", ")", "cannot be imported: SyntaxError"),
        ("policy:{}", "0", "no JSON"),
    ],
)
def test_faults_of_ones_own_are_found_before_a_run(
    tmp_path: Path, given: str, body: str, message: str
) -> None:
    file = write(tmp_path, body)
    refuses(lambda: contenders(BENCH, [given.format(file)], {}), message)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["PPO", "SAC", "TD3"])
def test_a_saved_model_does_what_it_does_in_its_environment(tmp_path: Path, name: str) -> None:
    """Peaks of the comparison are those that the library's own loop, with its VecNormalize, has in the environment."""
    library = pytest.importorskip("stable_baselines3", reason="needs the extra train")
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    def make() -> gymnasium.Env[Any, Any]:
        return FrameEnv(history=2)

    venv = VecNormalize(DummyVecEnv([make]))
    options: dict[str, Any] = {"n_steps": 64} if name == "PPO" else {"learning_starts": 8}
    model = getattr(library, name)("MlpPolicy", venv, seed=1, device="cpu", **options)
    model.learn(64)
    model.save(tmp_path / "model.zip")
    venv.save(str(tmp_path / "stats.pkl"))
    (tmp_path / "env.json").write_text('{"history": 2}')
    names = ",".join(str(tmp_path / part) for part in ("model.zip", "stats.pkl", "env.json"))
    refuses(lambda: contenders(BENCH, [f"mine={tmp_path / 'model.zip'}"], {}), "its observations are")
    (mine,) = contenders(BENCH, [f"mine={names}"], {})
    found = replace(BENCH, timestep=5e-4).history(mine.specs[0], LOAD, 1.0)

    venv.training = False
    env, over, commands = make(), False, []
    seen, _ = env.reset(options={"motion": BENCH.played(LOAD, 1.0)})
    info: dict[str, Any] = {}
    while not over:
        action, _ = model.predict(venv.normalize_obs(seen), deterministic=True)
        commands.append(2.25 * 0.5 * (float(action[0]) + 1))
        seen, _, _, over, info = env.step(action)
    assert np.ptp(commands) > 1e-3  # not a constant
    assert np.abs(found.drift).max() == pytest.approx(info["peak_drift"], rel=0.02)
    held = found.command[:: round(0.005 / found.time[1])]  # of the runs' samples, one a control period
    assert np.abs(held - np.array(commands[: len(held)])).max() < 0.05


def test_every_controller_gets_the_force_before_the_sensors_lag() -> None:
    """A force that is held over each period, through SciPy's first-order lag, comes out as it was."""
    lag, period = 3e-3, 1e-3
    model = frame_model()
    site = registry.Site.of(
        replace(model, effects=(*model.effects, Effect("sensor_lag", {"tau": lag}))), period
    )
    recorder, given = Watching(lambda t: 0.0), []

    def build(made: registry.Site) -> Watching:
        given.append(made.damper.sensor_lag)
        return recorder

    controller = told(build, site)
    force = np.concatenate([[0.0], np.random.default_rng(0).normal(0, 100, 60)])
    kept = math.exp(-period / lag)
    read = lfilter([1 - kept], [1, -kept], force)
    controller.reset()
    for k, value in enumerate(read):
        controller.command(k * period, {"force": float(value)})
    np.testing.assert_allclose([y["force"] for y in recorder.seen], force, atol=1e-9)
    assert given == [0.0]
