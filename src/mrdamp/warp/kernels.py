# mypy: ignore-errors
# Kernels are in the language of Warp.
"""Sums over the worlds of MuJoCo Warp: forces, moments of actuators, and what stands along them."""

from __future__ import annotations

import warp as wp


@wp.kernel
def forces_on_joints(
    passive: wp.array2d[float],
    bias: wp.array2d[float],
    applied: wp.array2d[float],
    constraint: wp.array2d[float],
    rownnz: wp.array2d[int],
    rowadr: wp.array2d[int],
    colind: wp.array2d[int],
    moment: wp.array2d[float],
    force: wp.array2d[float],
    out: wp.array2d[float],
) -> None:
    """Generalised forces without the dampers', whose actuator forces are 0 so far.

    Those of the constraints are the last step's.
    """
    world = wp.tid()
    for i in range(out.shape[1]):
        out[world, i] = passive[world, i] - bias[world, i] + applied[world, i] + constraint[world, i]
    for a in range(force.shape[1]):
        for k in range(rownnz[world, a]):
            at = rowadr[world, a] + k
            out[world, colind[world, at]] += moment[world, at] * force[world, a]


@wp.kernel
def moment_of(
    actuator: int,
    rownnz: wp.array2d[int],
    rowadr: wp.array2d[int],
    colind: wp.array2d[int],
    moment: wp.array2d[float],
    out: wp.array2d[float],
) -> None:
    """The moment of an actuator as a vector (worlds, joints)."""
    world = wp.tid()
    for i in range(out.shape[1]):
        out[world, i] = 0.0
    for k in range(rownnz[world, actuator]):
        at = rowadr[world, actuator] + k
        out[world, colind[world, at]] = moment[world, at]


@wp.kernel
def along(
    actuator: wp.array[int],
    rownnz: wp.array2d[int],
    rowadr: wp.array2d[int],
    colind: wp.array2d[int],
    moment: wp.array2d[float],
    x: wp.array2d[float],
    first: int,
    step: int,
    out: wp.array2d[float],
) -> None:
    """Products of the dampers' moments with a vector x (worlds, joints), to the columns first, first + step ..."""
    world, k = wp.tid()
    total = float(0.0)  # noqa: UP018  (a literal is a constant to Warp)
    for i in range(rownnz[world, actuator[k]]):
        at = rowadr[world, actuator[k]] + i
        total += moment[world, at] * x[world, colind[world, at]]
    out[world, first + step * k] = total


@wp.kernel
def add_damping(
    rownnz: wp.array[int],
    rowadr: wp.array[int],
    damping: wp.array2d[float],
    timestep: float,
    out: wp.array2d[float],
) -> None:
    """The step times the joints' damping, on the diagonal of the mass matrix."""
    world, i = wp.tid()
    out[world, rowadr[i] + rownnz[i] - 1] += timestep * damping[world % damping.shape[0], i]
