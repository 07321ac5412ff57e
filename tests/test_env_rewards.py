"""What rewards are measured by, in closed form: oscillators without damping under a load that sets in at once."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.cables import StayCable
from mrdamp.envs.cable_reward import free_run
from mrdamp.envs.reward import reference_run
from mrdamp.model import Model
from mrdamp.structures import ShearFrame

NOTHING = {"c0a": 0.0, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}


def test_a_storey_swings_to_twice_its_static_drift() -> None:
    """x = (m a / k)(1 - cos w t): drift 2 m a / k, absolute acceleration 2 a, strain energy 2 (m a)^2 / k."""
    mass, stiffness, ground = 100.0, 1e5, 1.5
    frame = ShearFrame(np.array([mass]), np.array([stiffness]), np.array([1e-6]))
    found = reference_run(Model("bingham", NOTHING, (), "frame", frame), np.full(2000, ground), 5e-4)
    assert found.drift == pytest.approx(2 * mass * ground / stiffness, rel=1e-3)
    assert found.acceleration == pytest.approx(2 * ground, rel=1e-3)
    assert found.strain_energy == pytest.approx(2 * (mass * ground) ** 2 / stiffness, rel=2e-3)


def test_a_free_cable_holds_the_work_of_its_load() -> None:
    """q = (F / w^2)(1 - cos w t) in one coordinate: mean squares over whole periods, and the energy 2 F^2 / w^2."""
    cable, push = StayCable(ratio=1e-9), 0.3
    w = float(cable.natural[0])
    dt = 2 * np.pi / w / 500
    pushes = np.zeros((5000, len(cable.natural)))
    pushes[:, 0] = push
    motion, acceleration, energy = free_run(cable, pushes, dt)
    of = cable.mass * cable.length
    assert motion * of == pytest.approx(1.5 * (push / w**2) ** 2, rel=1e-3)
    assert acceleration * of == pytest.approx(0.5 * push**2, rel=1e-3)
    assert energy == pytest.approx(2 * push**2 / w**2, rel=1e-3)
