"""A fit that starts 40 % off arrives; the records are SciPy's."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from excitation import from_rest, multisine, wave
from mrdamp.identify import identify
from mrdamp.records import Record
from twins import simulate

# z ends at 1 (A = beta + gamma), as the search has it.
TRUE: Mapping[str, Mapping[str, float]] = {
    "bingham": {"c0a": 400.0, "c0b": 250.0, "fya": 40.0, "fyb": 300.0, "v_ref": 0.01},
    "bouc_wen": {"c0a": 500.0, "c0b": 400.0, "alpha_a": 60.0, "alpha_b": 500.0, "gamma": 900.0, "beta": 600.0}
    | {"A": 1500.0, "n": 1.5, "k0": 4000.0, "x0": 0.0},
    "modified_bouc_wen": {"c0a": 400.0, "c0b": 500.0, "c1a": 5e3, "c1b": 2e4, "alpha_a": 60.0, "alpha_b": 500.0}
    | {"gamma": 900.0, "beta": 600.0, "A": 1500.0, "n": 1.5, "k0": 1500.0, "k1": 2000.0, "x0": 0.0},
    "hyperbolic_tangent": {"k1a": 1.5e5, "k1b": 1e5, "k0a": 4000.0, "k0b": 0.0, "c0a": 400.0, "c0b": 300.0}
    | {"c1a": 400.0, "c1b": 200.0, "m0": 0.5, "f0a": 60.0, "f0b": 500.0, "v_ref": 0.006},
}
#: What the records determine well: the rest is weak in them, or trades against it.
SURE: Mapping[str, tuple[str, ...]] = {
    "bingham": ("c0a", "c0b", "fya", "fyb", "v_ref"),
    "bouc_wen": ("c0a", "c0b", "alpha_a", "alpha_b", "A", "k0"),
    "modified_bouc_wen": ("c0a", "c0b", "alpha_a", "alpha_b", "k1"),
    "hyperbolic_tangent": ("c0a", "c0b", "f0a", "f0b", "k1a", "k0a", "v_ref"),
}


@cache
def records(law: str) -> tuple[Record, ...]:
    """Three records of 2 s at 500 Hz, noise of 0.5 %, of a motion from rest."""
    out = []
    for seed in range(3):
        t = 0.002 * np.arange(1000, dtype=np.float64)
        motion, command = from_rest(multisine(0.004, 0.5, 5.0, seed=seed), 0.3), wave(0.0, 1.0, 0.7 + 0.2 * seed)
        force = simulate(law, TRUE[law], motion, t, command, rtol=1e-6)["force"]
        force = force + np.random.default_rng(seed).normal(0.0, 0.005 * float(force.std()), len(t))
        x, v, _ = motion.sample(t)
        channels = {"displacement_m": x, "velocity_m_s": v, "command": command.sample(t), "force_N": force}
        out.append(Record(f"{law}_{seed}", None, 0.002, channels))
    return tuple(out)


@pytest.mark.parametrize("factor", [0.6, 1.4])
@pytest.mark.parametrize("law", TRUE)
def test_a_start_forty_percent_off_arrives(law: str, factor: float) -> None:
    true = TRUE[law]
    start = {name: value if name in ("n", "x0") else factor * value for name, value in true.items()}
    if "n" in true:
        start["n"] = 1.0 + factor * (true["n"] - 1.0)
    train, held = records(law)[:2], records(law)[2:]
    fit = identify(law, train, held, extras=(), start=start, starts=1)
    assert fit.held_out_nrmse < 0.01
    for name in SURE[law]:
        assert fit.model.parameters[name] == pytest.approx(true[name], rel=0.1), name
