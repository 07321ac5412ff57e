"""What a damper took in, and what it can hold: power balances of the laws, for tests of passivity.

``W`` is the work done on the rod, the integral of ``F v``. With the force laws as written, for a field that
may change at any time (``U`` is the energy of the hysteresis at ``alpha = 1``):

bingham
    ``F v >= 0`` at every instant; nothing is stored.
bouc_wen
    ``U(z) = integral of s / (A + (gamma - beta) s^n) ds`` from 0 to |z|, ``z^2 / (2 A)`` for beta = gamma.
    Along unloading ``z v = dU/dt``, along loading ``z v >= dU/dt``, so
    ``W >= S(t) - S(0) - G``, ``S = alpha U + k0 (x - x0)^2 / 2``, ``G = integral of U d alpha``.
modified_bouc_wen
    The element ``alpha z + c0 (v - y') + k0 (x - y)`` carries the force ``c1 y'`` of the dashpot in series:
    ``S = alpha U + k0 (x - y)^2 / 2 + k1 (x - x0)^2 / 2``, the same G.
hyperbolic_tangent
    ``S = k1 (x - g)^2 / 2 + k0 g^2 / 2 + m0 g'^2 / 2``,
    ``G = integral of (x - g)^2 / 2 d k1 + integral of g^2 / 2 d k0``.

At a constant command G = 0: from rest a damper never gives back more than S(0), the preload of its springs.
With a changing command the term G is real: the field stiffens an element that is already strained, and with
small strokes (below the displacement at which the hysteresis yields) a command in step with the motion pumps
energy out. That is in the equations of the laws, not in their numerics.

Effects: driver, magnetics, heating and shear thinning change coefficients only, and the balance holds with
them. seal_friction stores ``sigma0 zf^2 / 2`` and dissipates the rest; gas_spring stores
``k x^2 / 2 + k k2 x^3 / 3 + f0 x``; moving_mass ``m v^2 / 2``; mount_compliance and backlash ``P^2 / (2 k)``.
asymmetry and trapped_gas keep ``F v >= 0`` of bingham, but with the hysteretic laws they weigh loading and
unloading differently: a small cycle may return more than it took, in proportion to ``a`` or ``d``. Sensor
effects change the reading, not the force: passivity is a matter of the column ``true``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import cumulative_trapezoid

from excitation import Array
from twin_laws import value


def work(force: Array, v: Array, dt: float) -> Array:
    """Work done on the rod since the start, J, (n,)."""
    return np.asarray(cumulative_trapezoid(force * v, dx=dt, initial=0.0))


def _coefficient(p: Mapping[str, float], name: str, columns: Mapping[str, Array]) -> Array:
    """A coefficient along the run, with what heating has left of it."""
    kappa = {"alpha_": "heating_kappa_yield", "c1": "heating_kappa"}.get(name, "")
    rise = columns.get("temperature", np.zeros_like(columns["field"]))
    cold = np.array([max(value(p, name, float(b)), 0.0) for b in columns["field"]])
    return np.asarray(cold * np.exp(-p.get(kappa, 0.0) * rise))


def _supplied(energy_per_unit: Array, coefficient: Array) -> Array:
    """Integral of an energy over the changes of the coefficient it is multiplied with."""
    return np.asarray(cumulative_trapezoid(energy_per_unit, coefficient, initial=0.0))


def hysteretic_energy(p: Mapping[str, float], z: Array) -> Array:
    """``U(z)`` at ``alpha = 1``, in units of z times m, at gamma and beta of zero field.

    With gamma = beta, as in the sets whose gamma follows the field, U does not depend on them.
    """
    size, nodes = np.abs(z), np.polynomial.legendre.leggauss(24)
    s = 0.5 * size[:, None] * (nodes[0] + 1.0)
    inside = s / (p["A"] + (p["gamma"] - p["beta"]) * s ** p["n"])
    return np.asarray(0.5 * size * (inside @ nodes[1]))


def dissipated(
    law: str, p: Mapping[str, float], dt: float, x: Array, v: Array, columns: Mapping[str, Array]
) -> Array:
    """``W - (S - S(0)) + G``, J, (n,): what has turned into heat; it never falls.

    ``columns``: true, field and state of the run, and temperature where it is heated.
    """
    force, state = columns["true"], columns["state"]
    if law == "bingham":
        return work(force, v, dt)
    if law == "hyperbolic_tangent":
        k1, k0 = _coefficient(p, "k1", columns), _coefficient(p, "k0", columns)
        pre, post = (x - state) ** 2 / 2.0, state**2 / 2.0
        rate = np.gradient(state, dt)
        stored = k1 * pre + k0 * post + p["m0"] * rate**2 / 2.0
        supplied = _supplied(pre, k1) + _supplied(post, k0)
    else:
        alpha, energy = _coefficient(p, "alpha_", columns), hysteretic_energy(p, state)
        supplied = _supplied(energy, alpha)
        if law == "bouc_wen":
            stored = alpha * energy + p["k0"] * (x - p["x0"]) ** 2 / 2.0
        else:
            inner = (force - p["k1"] * (x - p["x0"])) / _coefficient(p, "c1", columns)
            y = x[0] + cumulative_trapezoid(inner, dx=dt, initial=0.0)
            stored = alpha * energy + p["k0"] * (x - y) ** 2 / 2.0 + p["k1"] * (x - p["x0"]) ** 2 / 2.0
    return np.asarray(work(force, v, dt) - (stored - stored[0]) + supplied)
