"""What a controller of one's own, and a policy in a loop of one's own, can and cannot reach."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction

import mrdamp
from env_arguments import OWN as ISOLATED
from mrdamp.compare.benches import bench_of
from mrdamp.compare.comparison import compare
from mrdamp.compare.contenders import contenders
from mrdamp.control.policy import Policy
from mrdamp.envs import FrameEnv
from mrdamp.model import Effect
from refusals import refuses
from test_own_controllers import BENCH, LOAD, OWN, write

SHIPPED = next((Path(mrdamp.__file__).parent / "data/policies/frame/learned").glob("*.json"))


@pytest.mark.parametrize("structure", ["cable", "car", "own"])
def test_no_controller_sees_behind_the_sensor(tmp_path: Path, structure: str) -> None:
    bench = bench_of(ISOLATED if structure == "own" else structure, engine="chain")
    assert {"force", "stroke"} <= set(bench.measured)
    mine = f"mine={write(tmp_path, 'y[{!r}]'.format('true_force'))}:Broken"
    refuses(lambda: contenders(bench, [mine], {}), "KeyError: 'true_force'")


def test_what_a_controller_changes_in_its_site_is_not_the_plants(tmp_path: Path) -> None:
    """Passive-on beside one that weakens the damper's parameters and the matrices that it is given."""
    file = tmp_path / "weaken.py"
    file.write_text(
        OWN.replace("{body}", "0.0").replace(
            "self.value = site.command_max / 2",
            "self.value = 0.0\n        own = site.damper.parameters\n        own.update({k: 0.2 * own[k] for k in own})"
            "\n        if hasattr(site, 'structure'):\n            site.structure.at[:] = 0.0",
        )
    )
    for bench in (replace(BENCH, engine="chain"), bench_of(ISOLATED, engine="chain")):
        load = bench.unseen_loads()[:1]
        spec = spec_of(bench, file)
        alone = bench.run("passive-on", load[0], 1.0)
        bench.run(spec, load[0], 1.0)
        assert bench.run("passive-on", load[0], 1.0) == alone


def spec_of(bench: Any, file: Path) -> str:
    ((spec,),) = (row.specs for row in contenders(bench, [f"mine={file}:Steady"], {}))
    return str(spec)


def test_a_policy_says_so_where_a_measurement_is_no_number_or_missing() -> None:
    policy = Policy.read(SHIPPED)
    y = dict.fromkeys(policy.observer.signals, 0.0) | {"force": 0.0}
    before = policy.command(0.0, y)
    refuses(
        lambda: policy.command(0.005, y | {policy.observer.signals[0]: np.nan}),
        "is nan; allowed: finite numbers",
    )
    policy.reset()
    assert policy.command(0.0, y) == before
    first, *others = policy.observer.signals
    refuses(lambda: policy.command(0.0, dict.fromkeys(others, 0.0)), f"it needs the measurement {first}; there are")


def test_a_saved_model_of_other_actions_or_statistics_is_refused_with_its_file(tmp_path: Path) -> None:
    """Actions from 0 to 1 have the shape of those from -1 to 1, and mean other commands."""
    library = pytest.importorskip("stable_baselines3", reason="needs the extra train")
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    def saved(name: str, make: Any) -> None:
        venv = VecNormalize(DummyVecEnv([make]))
        library.PPO("MlpPolicy", venv, n_steps=8, batch_size=8, device="cpu").save(tmp_path / f"{name}.zip")
        venv.save(str(tmp_path / f"{name}.pkl"))

    saved("own", FrameEnv)
    saved("positive", lambda: RescaleAction(FrameEnv(), np.float32(0), np.float32(1)))
    saved("longer", lambda: FrameEnv(history=3))

    def mine(model: str, statistics: str) -> Any:
        files = f"{tmp_path / model}.zip,{tmp_path / statistics}.pkl"
        return contenders(BENCH, [f"mine={files}"], {})

    assert len(mine("own", "own")) == 1
    refuses(lambda: mine("positive", "own"), r"positive.zip: its actions are Box\(0.0, 1.0.* here: Box\(-1.0, 1.0")
    refuses(lambda: mine("longer", "own"), "longer.zip: its observations are")
    refuses(lambda: mine("own", "longer"), r"longer.pkl: its statistics are of .*\(18,\); allowed here: \(6,\)")


def test_a_controller_that_remembers_earlier_runs_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its list of commands outlives the run, and so its repeated run has none left; one without it passes."""
    monkeypatch.setattr(sys, "path", sys.path.copy())
    (tmp_path / "commands_so_far.py").write_text("N = []\n")

    def call(body: str) -> Any:
        file = write(tmp_path, body)
        file.write_text("import commands_so_far\n" + file.read_text())
        bench = replace(BENCH, engine="chain")
        return compare(bench, contenders(bench, [f"mine={file}:Broken"], {}), [LOAD], [1.0])

    counts = "commands_so_far.N.append(0) or 2.25 * (len(commands_so_far.N) < 300)"
    assert "own_law.py:Broken: its first run, repeated, has another result" in " ".join(call(counts).notes)
    steady = call("2.25")
    assert "repeated" not in " ".join(steady.notes)
    assert steady.values["mine"]["mean_command"].item() == pytest.approx(2.25)


@pytest.mark.parametrize("learned", [True, False])
def test_a_damper_mounted_the_other_way_round_is_driven_alike(learned: bool) -> None:
    """The same frame physically: stroke and force have the other sign, the commands and drifts are the same."""
    frame = BENCH.model.structure
    assert frame is not None
    turned = replace(BENCH, model=replace(BENCH.model, structure=replace(frame, damper_between=(1, 0))))
    spec = f"policy:{SHIPPED}" if learned else "force-tracking"
    one, other = (compare(bench, contenders(bench, [spec], {}), [LOAD], [1.0]) for bench in (BENCH, turned))
    for key in ("mean_command", "J1", "J2"):
        name = one.contenders[0].name
        np.testing.assert_allclose(other.values[name][key], one.values[name][key], rtol=1e-6)


class Watching:
    """No command; remembers what it is given."""

    name, period = "watching", 1e-3

    def reset(self) -> None:
        self.seen: list[Any] = []

    def command(self, t: float, y: Any) -> float:
        self.seen.append(dict(y))
        return 1.0


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_controllers_see_what_sensors_read_and_are_judged_by_what_happens(engine: str) -> None:
    """An accelerometer with a gain of 1.3 on floor 3 and an offset on floor 1, a force sensor with a gain of 1.25."""
    effects = (
        Effect("sensor_gain", {"g": 1.3}, place=3),
        Effect("sensor_offset", {"f": 0.2}, place=1),
        Effect("sensor_gain", {"g": 1.25}),
    )
    bench = replace(BENCH, engine=engine)
    faulty = replace(bench, model=replace(bench.model, effects=(*bench.model.effects, *effects)))
    watching = [Watching(), Watching()]
    one, other = (b.driven(w, LOAD, 1.0) for b, w in zip((bench, faulty), watching, strict=True))
    np.testing.assert_allclose(other.acceleration, one.acceleration, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(other.force, one.force, rtol=1e-9, atol=1e-9)
    for name, gain, offset in (("acceleration_3", 1.3, 0.0), ("acceleration_1", 1.0, 0.2), ("force", 1.25, 0.0)):
        true, read = (np.array([y[name] for y in w.seen]) for w in watching)
        np.testing.assert_allclose(read, gain * true + offset, rtol=1e-9, atol=1e-9, err_msg=name)
    first, second = (vars(b.criteria("constant", run)) for b, run in ((bench, one), (faulty, other)))
    for key in ("peak_force", "dissipated_energy", "peak_acceleration"):
        np.testing.assert_allclose(second[key], first[key], rtol=1e-9, err_msg=key)


def test_what_controllers_are_told_is_said() -> None:
    """And what a passive command is, is not told: it is the damper's."""
    weak = {**BENCH.model.parameters, "command_max": 1.0}
    slow = replace(BENCH.model, name="slow", parameters=weak, effects=(Effect("driver_lag", {"tau": 0.02}),))
    told = replace(BENCH, told=slow, engine="chain")
    assert "driver (20 ms)" in told.about()
    assert "of slow in place of the true model" in told.about()
    assert told.history("passive-on", LOAD, 1.0).command.max() == BENCH.model.parameters["command_max"]
