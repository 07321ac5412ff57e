"""Dampers in worlds without an engine: imposed motion gives the forces of the chain, also by a GPU's sources."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from excitation import Array
from mrdamp.model import core
from mrdamp.model.attributes import law_number, vector
from mrdamp.warp.native import Worlds, fields, free_attributes, sizes, sources
from test_laws_and_effects import DT, TERMS, damper, sampled, settings_of

LAWS = [law for law in core.laws() if law != "narx"]
SPECIALISED = {"bingham": "Bingham", "bouc_wen": "BoucWen", "hyperbolic_tangent": "HyperbolicTangent",
               "modified_bouc_wen": "ModifiedBoucWen"}  # fmt: skip
GPU = """
#define __global__
struct Index { int x; };
static Index blockIdx, blockDim{1}, threadIdx;
#include "device/worlds.cu"
extern "C" void in_all(const mrdamp::Worlds* a) {
  for (blockIdx.x = 0; blockIdx.x < a->worlds; blockIdx.x++) act(*a);
}
"""


def forces(law: str, params: Array, entry: Callable[[Worlds], object], taken: Array | None = None) -> tuple[Array, ...]:
    """Of two worlds with imposed motion and command, (n,) N; of a record through the chain; and the current there."""
    size, infinite = sizes(), np.array([-np.inf, np.inf])
    x, v, _, u = (np.asarray(c, dtype=np.float32).astype(float) for c in sampled(DT, 0.8))
    u = np.repeat(u[::40], 40)[: len(x)]
    u[:40] = 0.0  # an engine's damper has no current before its first command
    arrays: dict[str, np.ndarray[Any, Any]] = {
        "law": np.array([law_number(law)], np.int32),
        "params": params if taken is None else taken,
        "actuator": np.zeros(1, np.int32),
        "control": np.zeros(1, np.int32),
        "control_range": infinite,
        "force_range": infinite,
        "store": np.zeros((2, size["WorldDamper"]), np.uint8),
        "lines": np.zeros(2 * size["WorldLine"], np.uint8),
        **{name: np.zeros(2, np.float32) for name in ("time", "length", "velocity", "ctrl", "force")},
        **{name: np.zeros(2, np.float32) for name in ("free", "weight", "bare", "acceleration")},
    }
    worlds = Worlds(2, 1, 1, 1, 0, 0, 1, DT, **{name: a.ctypes.data for name, a in arrays.items()})
    found = np.empty((len(x), 2))

    def computed(k: int) -> Array:
        for name, value in (("time", k * DT), ("length", x[k]), ("velocity", v[k]), ("ctrl", u[k])):
            arrays[name][:] = value
        entry(worlds)
        return np.asarray(arrays["store"][:, -8:].copy().view(np.float64)[:, 0])

    for k in range(len(x)):
        found[k] = computed(k)
        if k % 7 == 0:
            assert np.array_equal(found[k], computed(k))  # the same instant again is no step
    assert np.array_equal(found[:, 0], found[:, 1])
    assert np.array_equal(found[0], computed(0))  # a clock that goes back begins anew
    sets = core.Sets(params[None], DT, x, u, v, np.zeros_like(x), hold=True)
    (chain,) = core.run_records(law, [sets], columns=("reference", "current"))
    return found[:, 0], *chain[0]


def off(law: str, settings: dict[str, float], entry: Callable[[Worlds], object], free: bool = False) -> float:
    """Largest difference over the largest force. Where a command arrives the force is still that before it."""
    params = vector(law, damper(law) | settings)
    taken = params[list(free_attributes(params))].copy() if free else None
    found, chain, current = forces(law, params, entry, taken)
    held = np.diff(current, prepend=current[0]) == 0
    same = held | (settings.keys() >= {"driver_lag_tau"})
    same[::40] = False
    return float(np.abs(found - chain)[same].max() / np.abs(chain).max())


def by_library(worlds: Worlds) -> None:
    core.library().mrdamp_worlds_act(ctypes.byref(worlds), 1)


@pytest.mark.parametrize("law", LAWS)
def test_forces_are_the_chains(law: str) -> None:
    terms = {term.name: settings_of(term, term.starts[0]) for term in TERMS if term.stage != "sensor"}
    wrong = {name: off(law, settings, by_library) for name, settings in {"": {}, **terms}.items()}
    # The store of a delay's commands is shared by those closer together than a hundredth of it.
    most = {name: 1e-5 if name.startswith("command_delay") else 1e-12 for name in wrong}
    assert {name: x for name, x in wrong.items() if not x < most[name]} == {}


def compiled(folder: Path, law: str, settings: dict[str, float]) -> ctypes.CDLL:
    """The sources of a GPU's kernel, compiled for the processor: a loop over threads."""
    params, root = vector(law, damper(law) | settings), sources()
    (folder / "core").mkdir(exist_ok=True)
    (folder / "core" / "fields.h").write_text(fields(free_attributes(params)))
    (folder / "in_all.cc").write_text(GPU)
    options = ["-std=c++17", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-w", f"-I{folder}", f"-I{root}"]
    options += ["-DMRDAMP_FIELDS", "-DMRDAMP_DAMPERS=1", f"-DMRDAMP_PACK_LAW=k{SPECIALISED[law]}"]
    library = folder / f"{law}.so"
    subprocess.run(["g++", *options, str(folder / "in_all.cc"), "-o", str(library)], check=True)
    return ctypes.CDLL(str(library))


CASES = [
    ("modified_bouc_wen", {"driver_lag_tau": 0.008}),
    pytest.param("bouc_wen", {"mount_compliance_k": 8e5}, marks=pytest.mark.slow),
    pytest.param("hyperbolic_tangent", {"shear_thinning_m": 0.6}, marks=pytest.mark.slow),
    pytest.param("bingham", {"seal_friction_coulomb": 60.0}, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("law", "settings"), CASES)
def test_the_sources_of_the_kernel_give_the_chains_forces(tmp_path: Path, law: str, settings: dict[str, float]) -> None:
    library = compiled(tmp_path, law, settings)
    assert off(law, settings, lambda worlds: library.in_all(ctypes.byref(worlds)), free=True) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("law", "arch"), [*((law, 80) for law in LAWS), (LAWS[0], 90)])
def test_the_kernel_compiles_for_a_gpu(law: str, arch: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cuda.bindings", reason="the extra `cuda` is not installed")
    from mrdamp.warp.cuda import compiled as for_gpu

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    params = vector(law, damper(law) | {"driver_lag_tau": 0.008})
    code = for_gpu(SPECIALISED[law], free_attributes(params), 1, arch)
    assert code[:4] == b"\x7fELF"
    assert all(name in code for name in (b"act", b"read"))
    assert for_gpu(SPECIALISED[law], free_attributes(params), 1, arch) == code  # from the cache
