"""Every effect of the chain, from driver to sensor, against its differential equation solved by SciPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from dampers import attributes, grid, rms, sample
from excitation import Array, Command, Motion, multisine, random_steps, wave
from mrdamp.model import core
from mrdamp.model.attributes import effects
from twins import NEUTRAL, simulate

END = 1.2  # s
COARSE = 5e-4  # s, grid of the reference


@dataclass(frozen=True)
class Base:
    """A damper that effects are added to, with its sizes."""

    law: str
    parameters: Mapping[str, float]
    force: float  # N, RMS on the motion below
    stroke: float  # m, RMS of the motion
    command: float  # largest one


BASES: Mapping[str, Base] = {
    "bingham": Base(
        "bingham", {"c0a": 900.0, "c0b": 500.0, "fya": 60.0, "fyb": 400.0, "v_ref": 0.004}, 400.0, 0.003, 1.0
    ),
    "bouc_wen": Base(
        "bouc_wen",
        {
            "c0a": 900.0, "c0b": 900.0, "alpha_a": 3e4, "alpha_b": 1e5, "gamma": 9e5, "beta": 4e5, "A": 110.0,
            "n": 2.0, "k0": 3000.0, "x0": 0.02,
        },
        700.0, 0.003, 1.0,
    ),
    "modified_bouc_wen": Base(
        "modified_bouc_wen", {**attributes("dyke1996_3kN"), "driver_lag_tau": 0.0}, 600.0, 0.003, 2.25
    ),
    "hyperbolic_tangent": Base("hyperbolic_tangent", attributes("zapateiro_foam_tanh"), 12.0, 0.003, 4.0),
}  # fmt: skip
SPEED, ACCELERATION = 0.034, 1.05  # m/s, m/s2: RMS of the motion


def motion() -> Motion:
    return multisine(0.003, 0.5, 7.0, seed=4)


def command(base: Base, kind: str) -> Command:
    low = 0.15 * base.command
    if kind == "steps":
        return random_steps(low, base.command, 0.15, 20, seed=9)
    return wave(low, base.command, 1.1)


def forms(base: Base) -> dict[str, dict[str, float]]:
    """Effects with the ends of their attributes' names, strong enough to be seen on this damper."""
    f, s, u = base.force, base.stroke, base.command
    heat = {"capacity": f * SPEED * 2.0 / 20.0, "loss": f * SPEED / 60.0}
    return {
        "driver_lag": {"tau": 0.02},
        "driver_lag two poles": {"tau": 0.015, "tau2": 0.008},
        "command_delay": {"d": 0.0337},
        "command_delay steps": {"d": 0.0337},
        "saturation": {"i_s": 0.5 * u},
        "saturation Froehlich": {"i_s": 0.6 * u, "shape": 1.0},
        "saturation square": {"i_s": 0.5 * u, "shape": 2.0},
        "saturation full": {"i_s": 0.4 * u, "shape": 2.0, "full": 0.8 * u},
        "remanence": {"b": 0.12 * u, "d": 0.15 * u},
        "heating": {**heat, "kappa": 0.02, "kappa_yield": 0.01},
        "heating warm start": {**heat, "kappa": 0.02, "kappa_yield": 0.004, "start": 12.0},
        "asymmetry": {"a": 0.2},
        "asymmetry wide": {"a": -0.3, "width": 0.03},
        "shear_thinning": {"m": 0.2, "v_s": 0.01},
        "shear_thinning Cross": {"m": 0.2, "v_s": 0.01, "shape": 0.8},
        "shear_thinning of both dashpots": {"m": 0.0, "v_s": 0.015, "shape": 3.0, "series": 1.0},
        "trapped_gas": {"d": 0.6, "s_g": 0.5 * s},
        "trapped_gas compression": {"d": 0.6, "s_g": 0.5 * s, "direction": -1.0},
        "trapped_gas both": {"d": 0.5, "s_g": 0.5 * s, "direction": 0.0},
        "gas_spring": {"k": 0.5 * f / s, "k2": 0.3 / s, "f0": 0.2 * f},
        "seal_friction": {"coulomb": 0.3 * f},
        "seal_friction Stribeck": {"coulomb": 0.2 * f, "breakaway": 2.5, "v_s": 0.03, "presliding": 1e-4},
        "moving_mass": {"m": 0.3 * f / ACCELERATION},
        "mount_compliance": {"k": f / (0.25 * s)},
        "backlash": {"gap": 0.4 * s, "k": 30.0 * f / s},
        "sensor_gain": {"g": -1.3},
        "sensor_offset": {"f": 0.3 * f},
        "sensor_leakage": {"tau": 0.25},
        "sensor_lag": {"tau": 0.01},
        "sensor_lag two poles": {"tau": 0.006, "tau2": 0.004},
        "channel_shift": {"d": 0.012},
        "channel_shift early": {"d": -0.0083},
    }


def with_effects(base: Base, *names: str) -> dict[str, float]:
    attributes, table = dict(base.parameters), forms(base)
    for name in names:
        attributes |= {f"{name.split()[0]}_{parameter}": number for parameter, number in table[name].items()}
    return attributes


ALONE = tuple(forms(BASES["bingham"]))
#: Effects inside the law, tried alone with every law; the others and their forms with one law alone, as each is tried
#: with every law together with others.
INSIDE = ("heating", "asymmetry", "shear_thinning", "shear_thinning of both dashpots", "trapped_gas")
TOGETHER = (
    ("driver_lag", "saturation", "remanence", "sensor_gain"),
    ("driver_lag two poles", "command_delay", "sensor_offset", "sensor_lag"),
    ("heating", "asymmetry", "shear_thinning", "trapped_gas"),
    ("gas_spring", "seal_friction Stribeck", "moving_mass", "sensor_leakage"),
    ("mount_compliance", "driver_lag", "seal_friction", "gas_spring"),
    ("mount_compliance", "backlash", "heating", "sensor_lag two poles"),
    ("mount_compliance", "moving_mass", "gas_spring", "sensor_leakage"),
    ("sensor_gain", "sensor_leakage", "sensor_lag", "sensor_offset"),
    ("command_delay", "saturation Froehlich", "trapped_gas both", "moving_mass", "channel_shift"),
)


@cache
def twin(base: str, names: tuple[str, ...], kind: str) -> dict[str, Array]:
    b = BASES[base]
    return simulate(b.law, with_effects(b, *names), motion(), grid(COARSE, END), command(b, kind), rtol=1e-6)


def run(
    base: str, names: tuple[str, ...], kind: str, dt: float, columns: tuple[str, ...]
) -> dict[str, Array]:
    b = BASES[base]
    return sample(motion(), command(b, kind), dt, END).run(b.law, with_effects(b, *names), columns)


def compare(base: str, names: tuple[str, ...], kind: str, dt: float, limit: float) -> None:
    """Force, and every inner column that the effects touch, within limit of its own RMS."""
    columns = ("force", "reference", "true", "current", "field", "temperature", "piston")
    found, expected = run(base, names, kind, dt, columns), twin(base, names, kind)
    stride = round(dt / COARSE)
    # a displacement channel that is late: the end of the record lacks the motion that caused the last forces
    known = slice(None, -round(0.013 / dt)) if "channel_shift" in names else slice(None)
    for name in columns:
        there = expected[name][::stride][known]
        if name == "temperature" and not any(n.startswith("heating") for n in names):
            continue
        error = rms(found[name][known] - there) / rms(there)
        assert error < limit, f"{name}: {error:.4f}"


@pytest.mark.parametrize(
    ("base", "name"),
    [(b, name) for b in BASES for name in (ALONE if b == "bouc_wen" else INSIDE)],
)
def test_effect_alone(base: str, name: str) -> None:
    kind = "steps" if name.startswith("driver_lag") or name.endswith("steps") else "wave"
    expected = twin(base, (name,), kind)["force"]
    plain = twin(base, (), kind)["force"]
    seen = rms(expected - plain) / rms(plain)
    assert seen > 0.03, f"the effect is too weak here for the test to mean anything: {seen:.4f}"
    for dt in (5e-4, 2e-3):
        compare(base, (name,), kind, dt, 0.01)


#: SciPy takes long over what is stiff in a stiff law; the simpler laws meet the same effects.
LONG = {("hyperbolic_tangent", TOGETHER[4]), ("hyperbolic_tangent", TOGETHER[5]), ("modified_bouc_wen", TOGETHER[5])}


@pytest.mark.parametrize(
    ("base", "names"),
    [
        pytest.param(b, n, marks=pytest.mark.slow if (b, n) in LONG else (), id=f"{b}-{'+'.join(n)}")
        for n in TOGETHER
        for b in BASES
    ],
)
def test_effects_together(base: str, names: tuple[str, ...]) -> None:
    compare(base, names, "wave", 2e-3, 0.01)


#: Attributes that act by themselves, and one of two that act together; what is left is of an effect that is off.
ACTING = """
driver_lag_tau driver_lag_tau2 driver_lag_fall driver_lag_rate driver_lag_gain command_delay_d command_delay_period
saturation_i_s remanence_b heating_kappa heating_kappa_yield asymmetry_a asymmetry_yield asymmetry_viscous
trapped_gas_d trapped_gas_force gas_spring_k gas_spring_f0 seal_friction_coulomb moving_mass_m mount_compliance_k
backlash_gap sensor_gain_g sensor_offset_f sensor_offset_settle sensor_leakage_tau sensor_leakage_share sensor_lag_tau
sensor_lag_tau2 channel_shift_d motion_lag_tau motion_lag_width
""".split()


@pytest.mark.parametrize("base", BASES)
def test_neutral_values_change_nothing(base: str) -> None:
    """Bit for bit, also where the secondary parameters of an effect that is off are set to something else."""
    b = BASES[base]
    record = sample(motion(), command(b, "steps"), 1e-3, 0.5)
    neutral = {name: number for name, number in NEUTRAL.items() if np.isfinite(number)}
    off = {
        row.name: min(max((row.default or 0.0) + 0.3, row.minimum), row.maximum)
        for row in core.attributes()
        if row.group in effects() and row.name not in ACTING
    }
    columns = ("force", "reference", "true", "current", "field", "piston", "state")
    plain = record.run(b.law, b.parameters, columns)
    for extra in (neutral, off):
        again = record.run(b.law, {**extra, **b.parameters}, columns)
        for name in columns:
            np.testing.assert_array_equal(again[name], plain[name], err_msg=name)


@pytest.mark.parametrize("name", ["asymmetry", "asymmetry wide", "trapped_gas", "shear_thinning", "heating"])
def test_fluid_effects_leave_bingham_passive(name: str) -> None:
    """They multiply the fluid's force with something positive: F v >= 0 at every instant."""
    columns = run("bingham", (name,), "wave", 1e-3, ("true",))
    assert np.all(columns["true"] * motion().sample(grid(1e-3, END))[1] >= 0.0)
