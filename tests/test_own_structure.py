"""A structure that no module knows: the building on bearings of the examples, by hand; what a controller of one's own,
and a policy in a loop of one's own, can and cannot reach."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest

import mrdamp
from env_arguments import OWN, dashpot
from knowing import Watching
from mrdamp.compare.benches import bench_of
from mrdamp.compare.comparison import Comparison, compare
from mrdamp.compare.contenders import Contender, contenders
from mrdamp.compare.tables import means, runs_csv
from mrdamp.control.policy import Policy
from mrdamp.envs import Goal, LinearStructure, Mechanics
from mrdamp.envs.linear import own_kind
from mrdamp.envs.plant_env import RowPlant
from mrdamp.model import Effect, Model
from mrdamp.motions import GroundMotion
from refusals import refuses
from test_own_controllers import BENCH, LOAD, write
from test_own_controllers import OWN as OWN_LAW

Isolated: Any = own_kind(OWN)
DASHPOT = 900.0
#: kg; storey by storey N/m, N s/m.
MASS, STIFFNESS, DAMPING = [150.0, 100.0, 100.0, 100.0], [9e4, 9e5, 9e5, 9e5], [250.0, 300.0, 300.0, 300.0]


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_a_sine_passes_as_the_transfer_function_says(engine: str) -> None:
    """Storey by storey in complex numbers, with a dashpot for the damper: places' amplitudes at two frequencies."""
    for w in (9.0, 25.0):
        z = [k + 1j * w * c for k, c in zip(STIFFNESS, [DAMPING[0] + DASHPOT, *DAMPING[1:]], strict=True)]
        dynamic = np.diag([-(w**2) * m for m in MASS]).astype(complex)
        for j, each in enumerate(z):
            dynamic[j, j] += each
            if j > 0:
                dynamic[j - 1, j - 1] += each
                dynamic[j, j - 1] -= each
                dynamic[j - 1, j] -= each
        x = np.linalg.solve(dynamic, -np.array(MASS, complex))  # per m/s2 of the ground
        motion = GroundMotion("sine", 1e-3, np.sin(w * 1e-3 * np.arange(9_000)))
        plant = RowPlant(Isolated(dashpot(DASHPOT)), engine=engine, timestep=2.5e-4)
        plant.reset(motion)
        seen = []
        while not plant.finished:
            y = plant.step(0.0)
            names = ("displacement_base", "acceleration_top", "velocity_top", "force")
            seen.append([plant.time, *(y[name] for name in names)])
        time, *signals = np.array(seen)[1000:-2].T
        waves = np.stack([np.sin(w * time), np.cos(w * time)], axis=1)
        wanted = x[0], 1 - w**2 * x[3], 1j * w * x[3], 1j * w * DASHPOT * x[0]
        for signal, complex_size in zip(signals, wanted, strict=True):
            sine, cosine = np.linalg.lstsq(waves, signal, rcond=None)[0]
            assert abs(sine + 1j * cosine - complex_size) < 0.01 * abs(complex_size)


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
@pytest.mark.parametrize(("period", "instants"), [(5e-3, 5), (8e-3, 3), (20e-3, 2), (30e-3, 1)])
def test_an_episode_has_a_period_for_every_instant_up_to_the_last_sample(
    engine: str, period: float, instants: int
) -> None:
    """Five samples every 5 ms, commands at 0, period, .. 20 ms at most. Of a mass that nearly nothing holds the last
    sample, 1 m/s2, makes 2.5 mm/s on its way up until 20 ms, and 1 mm/s in every ms after it until the end."""

    @dataclass(frozen=True)
    class Loose(Isolated):  # type: ignore[misc]
        places: ClassVar[Any] = {"base": (1.0,), "top": (1.0,)}

        def mechanics(self) -> Mechanics:
            return Mechanics([[1.0]], [[0.0]], [[1e-3]], [1.0], [[-1.0]], absolute=True)  # type: ignore[arg-type]

    nothing = dashpot(1e-6)
    plant, seen = RowPlant(Loose(nothing), engine=engine, period=period, timestep=1e-4), []
    plant.reset(GroundMotion("late", 5e-3, np.array([0.0, 0.0, 0.0, 0.0, 1.0])))
    while not plant.finished:
        seen.append(plant.step(0.0)["velocity_base"])
    assert len(seen) == instants
    assert plant.time == pytest.approx(period * instants)
    assert seen[-1] == pytest.approx(-(2.5e-3 + (period * instants - 20e-3)), rel=0.03)


class Single(LinearStructure):
    """2 kg on 200 N/m, 10 rad/s, on a ground that moves."""

    name, places = "single", {"mass": (1.0,)}
    goals = {"drift": Goal("mass", "displacement", "peak"), "shaking": Goal("mass", "acceleration")}  # noqa: RUF012

    def mechanics(self) -> Mechanics:
        return Mechanics([[2.0]], [[0.0]], [[200.0]], [1.0], [[-2.0]], absolute=True)  # type: ignore[arg-type]

    def damper(self) -> Model:
        return dashpot(DASHPOT)

    def loads(self) -> Any:
        return None


class Still:
    """No motion is drawn."""

    def draw(self, rng: Any) -> GroundMotion:
        raise AssertionError


class Pushed(Single):
    """The same with a force on the mass, half of the ground's acceleration in size."""

    def mechanics(self) -> Mechanics:
        return replace(super().mechanics(), load=np.array([[-2.0, 1.0]]))

    def forces(self, load: GroundMotion) -> Any:
        return load.acceleration[:, None] * [1.0, 0.5]


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_an_accelerometer_feels_a_force_and_not_the_frame_of_reference(engine: str) -> None:
    """Steps of the ground's acceleration a and of a force F: a + (F / m - a) cos w t to inertial space."""
    ground, force = 1.5, 0.75 / 2
    motion = GroundMotion("step", 1e-3, np.full(2 * 628 + 1, ground))
    plant, seen = RowPlant(Pushed(dashpot(1e-6)), engine=engine, timestep=1e-4), []
    plant.reset(motion)
    while not plant.finished:
        seen.append((plant.time, plant.step(0.0)["acceleration_mass"]))
    time, found = np.array(seen[1:-1]).T  # a reading is that of the end of its period
    wanted = ground + (force - ground) * np.cos(10 * (time + plant.period))
    assert np.abs(found - wanted).max() < 0.01
    assert Pushed().uncontrolled(motion)[1] == pytest.approx((force - ground) ** 2 / 2 + ground**2, rel=2e-3)


def test_a_load_of_the_same_numbers_at_another_pace_has_its_own_reference() -> None:
    """Of a step of .1 or .2 s and one control period."""
    env: Any = gymnasium.make("mrdamp:mrdamp/Structure-v0", structure=Single, engine="chain", motions=Still())
    for pace in (1e-3, 2e-3, 1e-3):
        motion = GroundMotion("step", pace, np.full(101, 1.5))
        info = env.reset(options={"motion": motion, "compression": 1})[1]
        assert info["reference_drift"] == pytest.approx(1.5 / 100 * (1 - np.cos(10 * (100 * pace + 5e-3))), rel=1e-3)


def test_a_single_mass_swings_to_twice_its_static_drift() -> None:
    """Without a damper under a ground acceleration a that sets in: displacement 2 m a / k, acceleration 2 a, RMS by
    a^2 (1 - cos w t)^2, 3/2 a^2 over whole periods."""
    many = round(10 * 2 * np.pi / 10 / 1e-3)
    drift, shaking = Single().uncontrolled(GroundMotion("step", 1e-3, np.full(many + 1, 1.5)))
    assert drift == pytest.approx(2 * 1.5 / 100.0, rel=1e-3)
    assert shaking == pytest.approx(1.5 * 1.5**2, rel=2e-3)
    # A load of .1 s and control periods of .03 s: the run has four of them, the last of which holds the load.
    w, until = 10.0, 0.12
    mean = 1.5**2 * (1.5 - 2 * np.sin(w * until) / (w * until) + np.sin(2 * w * until) / (4 * w * until))
    drift, shaking = Single().uncontrolled(GroundMotion("short", 1e-3, np.full(101, 1.5)), 0.03)
    assert drift == pytest.approx(1.5 / 100 * (1 - np.cos(w * until)), rel=1e-3)
    assert shaking == pytest.approx(mean, rel=0.02)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("mass", -np.eye(2), "mass is not positive definite: its eigenvalues are from -1 to -1"),
        ("stiffness", np.eye(3), r"stiffness has the shape \(3, 3\); allowed with 2 coordinates .* \(2, 2\)"),
        ("damping", np.array([[1.0, 2.0], [0.0, 1.0]]), "damping is not symmetric"),
        # Poles of q'' - .2 q' + q = 0: .1 +- i (1 - .01)^.5.
        ("damping", np.diag([-0.2, 1.0]), r"damping is negative: .* unstable, a motion grows with 0.1 1/s"),
    ],
)
def test_matrices_that_are_none_get_one_line(name: str, value: Any, message: str) -> None:
    sound: dict[str, Any] = dict.fromkeys(("mass", "damping", "stiffness"), np.eye(2))
    sound |= {"stroke": np.ones(2), "load": np.ones(2)}
    assert Mechanics(**sound).load.shape == (2, 1)
    # Without damping, and with a negative one that another outweighs: x = 1, -1 has 2, x = 1, 1 none.
    for damping in (np.zeros((2, 2)), np.array([[1.0, -1.0], [-1.0, 1.0]])):
        Mechanics(**{**sound, "damping": damping})
    refuses(lambda: Mechanics(**{**sound, name: value}), f"mechanics: {message}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"rms", 0.5', '"mean", 0.5', "goal: how is 'mean'; allowed: rms, peak"),
        ('Goal("top"', 'Goal("roof"', "Isolated: no place 'roof'; there are base, top"),
        ("(0, 0, 0, 1)", "(0, 0, 1)", r"Isolated: place top has shape \(1, 3\); allowed: \(4,\)"),
        ("def mechanics", "mechanics = list\n    def other", r"mechanics\(\) gives a list; allowed: a Mechanics"),
        ("9e4, 9e5", "0.0, 9e5", "mechanics: stiffness is not positive definite"),
    ],
)
def test_structures_that_are_none_get_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = Path(OWN.rpartition(":")[0]).read_text()
    assert old in text
    file = tmp_path / "broken.py"
    file.write_text(text.replace(old, new))
    refuses(lambda: own_kind(f"{file}:Isolated")(), message)


def test_a_load_that_is_none_gets_one_line() -> None:
    class Seat(Single):
        option = "push"

        def forces(self, load: Any) -> Any:
            raise AssertionError

    env: Any = gymnasium.make("mrdamp:mrdamp/Structure-v0", structure=Seat, engine="chain", motions=Still())
    refuses(lambda: env.reset(options={"push": 1}), "push is a int without name; allowed: a load with name, duration")


@pytest.mark.parametrize(
    ("forces", "message"),
    [
        (np.zeros(100), r"forces have .*; allowed: finite \(samples, 1\)"),
        ([[0.0], [1.0], [np.nan], [np.inf]], r"forces\[2, 0\] is nan; allowed: finite \(samples, 1\)"),
        (np.ones((101, 1)), r"duration is 0.099 s; allowed: 0.1 s, of its 101 forces every 0.001 s"),
    ],
)
def test_forces_that_are_none_get_one_line(forces: Any, message: str) -> None:
    class Pushed(Isolated):  # type: ignore[misc]
        def forces(self, load: Any) -> Any:
            return forces

    load = GroundMotion("odd", 1e-3, np.ones(100))
    refuses(lambda: Pushed().uncontrolled(load), f"odd: {message}")
    refuses(lambda: RowPlant(Pushed()).reset(load), f"odd: {message}")


ONE = np.ones((1, 1, 1))
SHIPPED = next((Path(mrdamp.__file__).parent / "data/policies/frame/learned").glob("*.json"))


@pytest.mark.parametrize("structure", ["frame", "cable", "car", OWN])
def test_no_table_has_a_column_twice(structure: str) -> None:
    bench = bench_of(structure, engine="chain")
    row = Contender("passive-off", ("passive-off",))
    result = Comparison((row,), bench.measures, ("a",), (1.0,), {row.name: {m.key: ONE for m in bench.measures}})
    assert set(bench.objective) <= {m.key for m in bench.measures}
    for heads in (means(result, bench).heads, runs_csv(result).splitlines()[0].split(",")):
        assert len(set(heads)) == len(heads)


def test_a_goal_of_a_columns_name_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "named.py"
    file.write_text(Path(OWN.rpartition(":")[0]).read_text().replace('"shaking"', '"load"'))
    refuses(lambda: bench_of(f"{file}:Isolated", engine="chain"), "goal 'load': another column of a comparison has")


@pytest.mark.parametrize("structure", ["cable", "car", "own"])
def test_no_controller_sees_behind_the_sensor(tmp_path: Path, structure: str) -> None:
    bench = bench_of(OWN if structure == "own" else structure, engine="chain")
    assert {"force", "stroke"} <= set(bench.measured)
    mine = f"mine={write(tmp_path, 'y[{!r}]'.format('true_force'))}:Broken"
    refuses(lambda: contenders(bench, [mine], {}), "KeyError: 'true_force'")


def test_what_a_controller_changes_in_its_site_is_not_the_plants(tmp_path: Path) -> None:
    """Passive-on beside one that weakens the damper's parameters and the matrices that it is given."""
    file = tmp_path / "weaken.py"
    file.write_text(
        OWN_LAW.replace("{body}", "0.0").replace(
            "self.value = site.command_max / 2",
            "self.value = 0.0\n        own = site.damper.parameters\n        own.update({k: 0.2 * own[k] for k in own})"
            "\n        if hasattr(site, 'structure'):\n            site.structure.at[:] = 0.0",
        )
    )
    for bench in (replace(BENCH, engine="chain"), bench_of(OWN, engine="chain")):
        load = bench.unseen_loads()[0]
        ((spec,),) = (row.specs for row in contenders(bench, [f"mine={file}:Steady"], {}))
        alone = bench.run("passive-on", load, 1.0)
        bench.run(spec, load, 1.0)
        assert bench.run("passive-on", load, 1.0) == alone


def test_a_policy_says_so_where_a_measurement_is_no_number() -> None:
    policy = Policy.read(SHIPPED)
    y = dict.fromkeys(policy.observer.signals, 0.0) | {"force": 0.0}
    before = policy.command(0.0, y)
    refuses(
        lambda: policy.command(0.005, y | {policy.observer.signals[0]: np.nan}),
        "is nan; allowed: finite numbers",
    )
    policy.reset()
    assert policy.command(0.0, y) == before


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
    watching = [Watching(lambda t: 1.0) for _ in range(2)]
    one, other = (b.driven(w, LOAD, 1.0) for b, w in zip((bench, faulty), watching, strict=True))
    np.testing.assert_allclose(other.acceleration, one.acceleration, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(other.force, one.force, rtol=1e-9, atol=1e-9)
    for name, gain, offset in (("acceleration_3", 1.3, 0.0), ("acceleration_1", 1.0, 0.2), ("force", 1.25, 0.0)):
        true, read = (np.array([y[name] for y in w.seen]) for w in watching)
        np.testing.assert_allclose(read, gain * true + offset, rtol=1e-9, atol=1e-9, err_msg=name)
    first, second = (vars(b.criteria("constant", run)) for b, run in ((bench, one), (faulty, other)))
    for key in ("peak_force", "dissipated_energy", "peak_acceleration"):
        np.testing.assert_allclose(second[key], first[key], rtol=1e-9, err_msg=key)
