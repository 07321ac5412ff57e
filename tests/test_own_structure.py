"""A structure that no module knows: the building on bearings of the examples, by the engine's matrices and by hand."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh

from env_arguments import OWN, dashpot
from mrdamp import cli
from mrdamp.envs import Goal, LinearStructure, Mechanics
from mrdamp.envs.linear import own_kind
from mrdamp.envs.plant_env import RowPlant
from mrdamp.model import Model
from mrdamp.motions import GroundMotion
from refusals import refuses

Isolated: Any = own_kind(OWN)
DASHPOT = 900.0
#: kg; storey by storey N/m, N s/m.
MASS, STIFFNESS, DAMPING = [150.0, 100.0, 100.0, 100.0], [9e4, 9e5, 9e5, 9e5], [250.0, 300.0, 300.0, 300.0]


def test_the_engines_own_matrices_are_the_buildings() -> None:
    """Masses from `mj_fullM`; frequencies from accelerations that the engine gives for a unit of each coordinate."""
    model = mujoco.MjModel.from_xml_string(Isolated().mjcf(1e-4))
    data, mass, stiffness = mujoco.MjData(model), np.zeros((4, 4)), np.zeros((4, 4))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    np.testing.assert_allclose(mass, np.diag(MASS))
    for k in range(4):
        mujoco.mj_resetData(model, data)
        data.qpos[k] = 1e-3
        mujoco.mj_forward(model, data)
        stiffness[:, k] = -data.qfrc_passive / 1e-3
    found = np.sqrt(eigh(stiffness, mass, eigvals_only=True))
    np.testing.assert_allclose(found, Isolated().system.frequencies, rtol=1e-9)
    # Rayleigh's quotient of a rigid building on its bearings is an upper bound, and near.
    assert 0.9 < found[0] / np.sqrt(STIFFNESS[0] / sum(MASS)) < 1.0


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
        motion = GroundMotion("sine", 1e-3, np.sin(w * 1e-3 * np.arange(12_000)))
        plant = RowPlant(Isolated(dashpot(DASHPOT)), engine=engine, timestep=2.5e-4)
        plant.reset(motion)
        seen = []
        while not plant.finished:
            y = plant.step(0.0)
            seen.append(
                [plant.time, y["displacement_base"], y["acceleration_top"], y["velocity_top"], y["force"]]
            )
        time, *signals = np.array(seen)[1400:-2].T
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


def test_a_single_mass_swings_to_twice_its_static_drift() -> None:
    """Without a damper under a ground acceleration a that sets in: displacement 2 m a / k, acceleration 2 a, RMS by
    a^2 (1 - cos w t)^2, 3/2 a^2 over whole periods."""

    class Single(LinearStructure):
        name, places = "single", {"mass": (1.0,)}
        goals = {"drift": Goal("mass", "displacement", "peak"), "shaking": Goal("mass", "acceleration")}  # noqa: RUF012

        def mechanics(self) -> Mechanics:
            return Mechanics([[2.0]], [[0.0]], [[200.0]], [1.0], [[-2.0]], absolute=True)  # type: ignore[arg-type]

        def damper(self) -> Model:
            return dashpot(DASHPOT)

        def loads(self) -> Any:
            return None

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


@pytest.mark.slow
def test_the_ordinary_commands_compare_and_train_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--controllers", "passive-off", "passive-on", "clipped-optimal", "skyhook", "--engine", "chain"]
    assert cli.main(["compare", OWN, *given, "--jobs", "2", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["controllers"]
    means = {name: {key: m["mean"] for key, m in row["measures"].items()} for name, row in rows.items()}
    # What isolation is about: no command leaves the building calm, the largest one saves the bearings.
    assert means["passive-off"]["shaking"] < 1.0
    assert means["passive-on"]["bearings"] < means["passive-off"]["bearings"] < 1.0
    assert all(0 < means[name]["mean_command"] < 2.25 for name in ("clipped-optimal", "skyhook"))
    out = tmp_path / "out"
    quick = ["--set", "population=4", "loads=2", "--evaluations", "1"]
    assert cli.main(["train", OWN, *quick, "--timesteps", "10000", "-o", str(out)]) == 0
    assert "shaking_ratio" in capsys.readouterr().out
    (policy,) = out.glob("**/policy.json")
    mine = ["--controllers", f"mine=policy:{policy}", "--engine", "chain", "--jobs", "1"]
    assert cli.main(["compare", OWN, *mine]) == 0
    assert "another version" not in capsys.readouterr().err
    softer = tmp_path / "softer.py"
    softer.write_text(Path(OWN.rpartition(":")[0]).read_text().replace("9e4,", "8.1e4,"))
    assert cli.main(["compare", f"{softer}:Isolated", *mine]) == 0
    assert "mrdamp: mine was trained on another version of isolated" in capsys.readouterr().err


def test_what_is_no_structure_gets_one_line(tmp_path: Path) -> None:
    file = tmp_path / "other.py"
    file.write_text("class Other:\n    pass\n")
    refuses(lambda: own_kind(f"{file}:Other"), "no subclass of mrdamp.envs.LinearStructure")
    refuses(lambda: own_kind(f"{file}:None_"), "there is no None_")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("mass", -np.eye(2), "mass is not positive definite: its eigenvalues are from -1 to -1"),
        ("mass", np.ones((2, 2)), "mass is not positive definite: its eigenvalues are from .* to 2"),
        ("stiffness", np.array([[1.0, -1.0], [-1.0, 1.0]]), "stiffness is not positive definite"),
        ("stiffness", np.eye(3), r"stiffness has the shape \(3, 3\); allowed with 2 coordinates .* \(2, 2\)"),
        ("stiffness", np.ones(4), r"stiffness has the shape \(4,\)"),
        ("damping", np.array([[1.0, 2.0], [0.0, 1.0]]), "damping is not symmetric"),
        ("damping", np.full((2, 2), np.nan), "damping holds NaN"),
        ("damping", [[1.0], [1.0, 2.0]], "damping is no array of real numbers"),
        ("stiffness", np.eye(2) * (1 + 0.02j), "stiffness is no array of real numbers"),
        # Poles of q'' - .2 q' + q = 0: .1 +- i (1 - .01)^.5.
        ("damping", np.diag([-0.2, 1.0]), r"damping is negative: .* unstable, a motion grows with 0.1 1/s"),
        ("stroke", np.zeros(2), "stroke is zero throughout"),
        ("stroke", np.ones((2, 2)), r"stroke has the shape \(2, 2\); allowed: \(n,\), of one damper"),
        ("stroke", [], "mass has the shape"),
        ("load", np.ones((3, 1)), r"load has the shape \(3, 1\); allowed .* \(2, loads\)"),
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
        (
            '"displacement", "peak"',
            '"drift", "peak"',
            "goal: of is 'drift'; allowed: acceleration, displacement",
        ),
        ('"peak", 0.5', '"peak", 0.0', "goal of base: weight is 0.0; allowed"),
        ('Goal("top"', 'Goal("roof"', "Isolated: no place 'roof'; there are base, top"),
        ('2.0, "base"', '2.0, "cellar"', "Isolated: no place 'cellar'"),
        ("2.0, ", "0.0, ", "Isolated: strong is 0.0"),
        ("(0, 0, 0, 1)", "(0, 0, 1)", r"Isolated: place top has shape \(1, 3\); allowed: \(4,\)"),
        ("(0, 0, 0, 1)", '(0, 0, 0, float("nan"))', "Isolated: place top holds NaN"),
        ("(0, 0, 0, 1)", '"last"', "Isolated: place top is"),
        (
            "def mechanics",
            "mechanics = list\n    def other",
            r"mechanics\(\) gives a list; allowed: a Mechanics",
        ),
        ("return default_damper()", "return 3", r"Isolated: damper\(\) gives a int"),
        ('name = "isolated"', "pass", "Isolated: no name; it needs name, places, goals"),
        ("9e4, 9e5", "0.0, 9e5", "mechanics: stiffness is not positive definite"),
    ],
)
def test_structures_that_are_none_get_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    """When it is made, in every command: nothing is tuned or run before."""
    text = Path(OWN.rpartition(":")[0]).read_text()
    assert old in text
    file = tmp_path / "broken.py"
    file.write_text(text.replace(old, new))
    refuses(lambda: own_kind(f"{file}:Isolated")(), message)


@pytest.mark.parametrize(
    ("forces", "message"),
    [
        (np.zeros(100), r"forces have .*; allowed: finite \(samples, 1\)"),
        (np.zeros((100, 2)), r"forces have .*; allowed: finite \(samples, 1\)"),
        (np.zeros((0, 1)), r"forces have .*; allowed: finite \(samples, 1\)"),
        ([[0.0], [1.0], [np.nan], [np.inf]], r"forces\[2, 0\] is nan; allowed: finite \(samples, 1\)"),
        (np.ones((98, 1)), r"duration is 0.099 s; allowed: 0.097 s, of its 98 forces every 0.001 s"),
        (np.ones((101, 1)), r"duration is 0.099 s; allowed: 0.1 s, of its 101 forces every 0.001 s"),
    ],
)
def test_forces_that_are_none_get_one_line(forces: Any, message: str) -> None:
    """Of a load of 99 ms."""

    class Pushed(Isolated):  # type: ignore[misc]
        def forces(self, load: Any) -> Any:
            return forces

    load = GroundMotion("odd", 1e-3, np.ones(100))
    refuses(lambda: Pushed().uncontrolled(load), f"odd: {message}")
    refuses(lambda: RowPlant(Pushed()).reset(load), f"odd: {message}")
