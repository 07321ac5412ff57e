"""The corrected simulator as MJCF: stepped in MuJoCo it answers what the diagnosis computed, whatever the effect."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from excitation import Array
from frame_case import DT, believed, records
from mrdamp.diagnosis.report.handover import AGREEMENT, agreement, hand_over
from mrdamp.diagnosis.report.result import Diagnosis, Gap, Where
from mrdamp.model import Effect, Model
from mrdamp.records import Record
from mrdamp.simulation.stepping import drive_rig

BOUC_WEN = {
    "c0a": 760.0, "c0b": 890.0, "alpha_a": 21e3, "alpha_b": 119e3, "gamma": 1.1e6, "beta": 1.1e6, "A": 155.0,
    "n": 2.0, "k0": 240.0, "x0": 0.0,
}  # fmt: skip
EFFECTS = (
    Effect("driver_lag", {"tau": 0.02, "tau2": 0.005}),
    Effect("remanence", {"b": 0.1, "d": 0.1}),
    Effect("seal_friction", {"coulomb": 60.0, "breakaway": 1.4, "v_s": 0.01, "presliding": 5e-5}),
    Effect("moving_mass", {"m": 20.0}),
    Effect("mount_compliance", {"k": 4e5}),
    Effect("backlash", {"gap": 5e-4, "k": 2e6}),
    Effect("sensor_lag", {"tau": 0.006}),
    Effect("channel_shift", {"d": 0.004}),
)
PLACED = (
    Effect("storey_stiffness", {"e": -0.25}, 2),
    Effect("storey_damping", {"e": 1.0, "quadratic": 8000.0}, 1),
    Effect("sensor_lag", {"tau": 0.008, "ratio": 0.7}, 2),
    Effect("seal_friction", {"coulomb": 80.0, "breakaway": 1.3, "v_s": 0.01, "presliding": 5e-5}),
)


def damper_record() -> Record:
    """A random motion and a stepped command; the force is none of the simulator's."""
    t: Array = np.linspace(0, 1499 * DT, 1500)
    rng = np.random.default_rng(2)
    rows = zip((0.7, 1.9, 4.1), rng.uniform(0, 6, 3), strict=True)
    x = np.sum([0.004 / f * np.sin(2 * np.pi * f * t + p) for f, p in rows], axis=0)
    command = np.where(np.floor(t / 0.35) % 2 < 1, 0.1, 0.9)
    force = 24000 * np.gradient(x, DT) * (0.3 + command)
    return Record(
        "random", None, DT, {"time_s": t, "displacement_m": x, "command": command, "force_N": force}
    )


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)
def test_a_damper_with_an_effect(effect: Effect) -> None:
    model, record = Model("bouc_wen", BOUC_WEN, (effect,)), damper_record()
    found = agreement(model, record)
    assert found.within
    assert found.difference < 2 * AGREEMENT
    # The gap is that of the inputs and the effect at hand, and not of another simulator.
    inputs = {n: np.asarray(record.channel(n)) for n in ("displacement_m", "command")}
    force = record.channel("force_N")
    error = (drive_rig(model, DT, inputs)["force_N"] - force)[50:-8]
    assert found.mujoco == pytest.approx(np.sqrt(np.mean(error**2) / np.mean(force[50:-8] ** 2)), rel=0.03)


@pytest.fixture(scope="module")
def shaken() -> Record:
    return records()["steps"]


@pytest.mark.parametrize("effect", PLACED, ids=lambda e: e.name)
def test_a_frame_with_an_effect(effect: Effect, shaken: Record) -> None:
    plain = believed(lag=False)
    found = agreement(plain.with_effects((effect,)), shaken)
    assert found.within
    assert found.difference < AGREEMENT
    assert abs(found.offline - agreement(plain, shaken).offline) > 0.01  # the effect is in it


def diagnosis(model: Model) -> Diagnosis:
    gap = Gap(0.2, 0.1, 0.01, 0.005, (0.009, 0.011))
    return Diagnosis("x", model.rig, "either", "parameters", (), (), (), Where({}), gap, (), {}, model)


def test_what_is_handed_over_is_a_model_that_loads(tmp_path: Path) -> None:
    model = Model("bouc_wen", BOUC_WEN, (Effect("driver_lag", {"tau": 0.02}),))
    still = Record("still", None, DT, {**damper_record().channels, "command": np.zeros(1500)})
    found = hand_over(diagnosis(model), [still, damper_record()], tmp_path / "mjcf")
    assert [row["record"] for row in found.stepped] == ["random", "still"]  # the changing command first
    assert all(abs(row["mujoco_gap"] - row["offline_gap"]) < AGREEMENT for row in found.stepped)
    assert found.to_dict()["mujoco"] == list(found.stepped)
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "mjcf" / "scene.xml"))
    data = mujoco.MjData(m)
    mujoco.mj_step(m, data, 10)
    assert np.isfinite(data.sensordata).all()
    assert "driver_lag_tau" in (tmp_path / "mjcf" / "model.xml").read_text()
    assert Model.read(tmp_path / "mjcf" / "model.json").effects == model.effects
