"""A kernel's forces against the chain's, and the MuJoCo Warp models against the plugin's own forces."""

from __future__ import annotations

import ctypes
import re
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from excitation import Array
from mrdamp import gpu, models_xml
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.envs.frame import default_damper
from mrdamp.envs.frame_xml import frame_models, frame_xml
from mrdamp.gpu import fields, free_attributes, sources
from mrdamp.model import core
from mrdamp.model.attributes import law_number, vector
from mrdamp.structures import ShearFrame
from mrdamp.warp.convert import Worlds, convert, sizes
from refusals import refuses
from test_laws import DT, TERMS, damper, sampled, settings_of

FRAME = models_xml.path("frame3").read_text(encoding="utf-8")


def kicked(m: mujoco.MjModel) -> Array:
    return np.asarray(0.05 * np.sin(1.0 + np.arange(m.nv)))


def levels(m: mujoco.MjModel, dampers: list[int], k: int) -> Array:
    """Controls (nu,) in the step k: a current for the dampers, and a ground motion or nothing for the rest."""
    out: Array = np.where(np.arange(m.nu) == 0, 3.0 * np.sin(0.01 * k), 0.0)
    out[dampers] = 1.0 + (k // 50 % 2)
    return out


def off(source: Any, steps: int, kick: bool = True, **values: Any) -> Array:
    """RMS of the difference of the dampers' forces over their RMS, in Warp's second world and MuJoCo."""
    pytest.importorskip("mujoco_warp", reason="the extra `warp` is not installed")
    import mujoco_warp

    from mrdamp.warp import put_model

    spec = mujoco.MjSpec.from_string(source) if source.startswith("<") else mujoco.MjSpec.from_file(source)
    for name, value in values.items():
        for plugin in spec.plugins:
            if plugin.plugin_name == "mrdamp.damper":
                plugin.config = dict(plugin.config) | {name: repr(value)}
    m = spec.compile()
    d = mujoco.MjData(m)
    model, dampers = put_model(source)
    data = dampers.make_data(2)
    for name, value in values.items():
        dampers.set(data, {name: np.array([0.5 * value, value])})
    controls = [one.control for one in dampers.converted.dampers]
    columns = [one.actuator for one in dampers.converted.dampers]
    if kick:
        d.qvel[:] = kicked(m)
        data.qvel.assign(np.tile(kicked(m), (2, 1)).astype(np.float32))
    forces = np.empty((2, steps, len(columns)))
    for k in range(steps):
        d.ctrl[:] = levels(m, controls, k)
        data.ctrl.assign(np.tile(d.ctrl, (2, 1)).astype(np.float32))
        mujoco.mj_step(m, d)
        mujoco_warp.step(model, data)
        forces[:, k] = d.actuator_force[columns], data.actuator_force.numpy()[1, columns]
    apart, own = forces[1] - forces[0], forces[0]
    return np.asarray(np.sqrt(np.mean(apart**2, axis=0) / np.mean(own**2, axis=0)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["frame3", "cable", "quarter_car", "car"])
def test_the_shipped_models_have_the_plugins_forces(name: str) -> None:
    apart = off(str(models_xml.path(name)), 300, kick=name != "car")
    assert apart.max() < 5e-3


@pytest.mark.slow
def test_two_dampers_that_act_on_each_other() -> None:
    mass, stiffness, damping = np.array([98.3, 98.3]), np.array([5e5, 7e5]), np.array([125.0, 50.0])
    frame = ShearFrame(mass=mass, stiffness=stiffness, damping=damping, damper_between=(0, 1))
    models = frame_models([default_damper(), default_damper()], frame, [(0, 1), (1, 2)])
    assert off(frame_xml(models, 5e-4), 300).max() < 5e-3


def dashpots(values: list[float], bodies: int) -> str:
    config = "".join(f'<config key="{key}" value="0"/>' for key in ("c0b", "fya", "fyb"))
    instances = "".join(
        f'<instance name="d{k}"><config key="law" value="bingham"/><config key="c0a" value="{c}"/>'
        f'<config key="v_ref" value="0.1"/>{config}</instance>'
        for k, c in enumerate(values)
    )
    inertia = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    body = '<body pos="{0} 0 0"><joint name="j{0}" type="slide"/>' + inertia + "</body>"
    plugins = "".join(
        f'<plugin joint="j{k % bodies}" plugin="mrdamp.damper" instance="d{k}"/>' for k in range(len(values))
    )
    return (
        f'<mujoco><option timestep="0.001" gravity="0 0 0"/><extension><plugin plugin="mrdamp.damper">{instances}'
        f"</plugin></extension><worldbody>{''.join(body.format(k) for k in range(bodies))}</worldbody>"
        f"<actuator>{plugins}</actuator></mujoco>"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "bodies", "sum_of_c"),
    [([500.0, 500.0], 2, 500.0), ([5000.0, 5000.0], 1, 1e4), ([1000.0] * 8, 1, 8e3)],
)
def test_linear_dashpots_take_the_exact_impulse(values: list[float], bodies: int, sum_of_c: float) -> None:
    """1 kg at 1 m/s loses 1 - exp(-c h) in a step of h, with one damper and with several, in every world."""
    mujoco_warp = pytest.importorskip("mujoco_warp", reason="the extra `warp` is not installed")
    from mrdamp.warp import put_model

    model, dampers = put_model(dashpots(values, bodies))
    data = dampers.make_data(3)
    data.qvel.fill_(1.0)
    mujoco_warp.step(model, data)
    np.testing.assert_allclose(data.qvel.numpy(), np.exp(-1e-3 * sum_of_c), atol=1e-5)


@pytest.mark.slow
def test_parameters_of_each_world() -> None:
    """The second world has the parameter of MuJoCo's model, the first another one."""
    assert off(FRAME, 200, c0a=4000.0).max() < 5e-3


@pytest.mark.slow
def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """With fewer worlds and steps, on the CPU device."""
    pytest.importorskip("mujoco_warp", reason="the extra `warp` is not installed")
    page = (Path(__file__).parents[1] / "docs" / "how-to" / "gpu.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", page, re.S | re.M)
    (tmp_path / "frame.xml").write_text(FRAME)
    monkeypatch.chdir(tmp_path)
    exec(compile(code.replace("4096", "4").replace("1000", "3"), "gpu.md", "exec"), {})
    assert capsys.readouterr().out.splitlines()[-1].startswith("[")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FRAME.replace('integrator="Euler"', 'integrator="RK4"'), "integrator mjINT_RK4: dampers in Warp take Euler"),
        (FRAME.replace("<option ", '<option actuatorgroupdisable="0" '), "its group 0 is disabled"),
        ("<mujoco/>", "no actuator is a mrdamp.damper"),
        ("no such file.xml", "'no such file.xml' is neither an MJCF file nor its text"),
    ],
)
def test_refusals(text: str, message: str) -> None:
    refuses(lambda: convert(text), message)


LAWS = [law for law in core.laws() if law != "narx"]
SPECIALISED = {"bingham": "Bingham", "bouc_wen": "BoucWen", "hyperbolic_tangent": "HyperbolicTangent",
               "modified_bouc_wen": "ModifiedBoucWen"}  # fmt: skip
GPU = """
#define __global__
struct Index {{ int x; }};
static Index blockIdx, blockDim{{1}}, threadIdx;
#include "device/{what}.cu"
extern "C" void in_all(const {type}* a) {{
  for (blockIdx.x = 0; blockIdx.x < a->{threads}; blockIdx.x++) {kernel}(*a);
}}
"""
WORLDS = GPU.format(what="worlds", type="mrdamp::Worlds", threads="worlds", kernel="act")
RECORDS = GPU.format(what="records", type="Records", threads="sets", kernel="run")


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


def away(law: str, settings: dict[str, float], entry: Callable[[Worlds], object], free: bool = False) -> float:
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
    wrong = {name: away(law, settings, by_library) for name, settings in {"": {}, **terms}.items()}
    # The store of a delay's commands is shared by those closer together than a hundredth of it.
    most = {name: 1e-5 if name.startswith("command_delay") else 1e-12 for name in wrong}
    assert {name: x for name, x in wrong.items() if not x < most[name]} == {}


def compiled(folder: Path, law: str, free: tuple[int, ...], text: str) -> ctypes.CDLL:
    """The sources of a GPU's kernel, compiled for the processor: a loop over threads."""
    root = sources()
    (folder / "core").mkdir(exist_ok=True)
    (folder / "core" / "fields.h").write_text(fields(free))
    (folder / "in_all.cc").write_text(text)
    options = ["-std=c++17", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-w", f"-I{folder}", f"-I{root}"]
    options += [f"-I{root.parent / 'include'}"]
    options += ["-DMRDAMP_FIELDS", "-DMRDAMP_DAMPERS=1", f"-DMRDAMP_PACK_LAW=k{SPECIALISED[law]}"]
    library = folder / f"{len(list(folder.glob('*.so')))}.so"  # a library of one name is loaded once
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
    library = compiled(tmp_path, law, free_attributes(vector(law, damper(law) | settings)), WORLDS)
    assert away(law, settings, lambda worlds: library.in_all(ctypes.byref(worlds)), free=True) < 1e-12


#: Columns of a run by their numbers.
EACH = tuple(range(len(core.COLUMNS)))


def on_processor(folder: Path) -> Callable[[gpu.Task], Array]:
    def run(task: gpu.Task) -> Array:
        library, kept = compiled(folder, task.law, task.free, RECORDS), []

        def put(array: np.ndarray[Any, Any]) -> int:
            kept.append(np.ascontiguousarray(array))
            return kept[-1].ctypes.data

        out = np.empty((len(task.params), task.record.columns, task.record.n))
        task.run(lambda record: library.in_all(ctypes.byref(record)), put, out, 0)
        return out

    return run


def records_off(law: str, sets: Sequence[dict[str, float]], folder: Path) -> float:
    """Largest difference of a column of the kernel from the library's, over the column's size: through a record that
    begins in motion, with the command along lines and held."""
    x, v, a, u = (channel[300:] for channel in sampled(DT, 2.4))
    params = np.array([vector(law, damper(law) | one) for one in sets])
    lines = core.Sets(params, DT, x, u, v, a, run_in=True)
    assert core.run_in(DT, x, u, v)
    worst = 0.0
    for inputs in (lines, core.Sets(params, 2 * DT, x[::2], u[::2], hold=True, substep=DT)):
        lead = core.run_in(inputs.dt, inputs.x, inputs.u, inputs.v) if inputs.run_in else None
        (found,) = gpu.run_records(law, [inputs], [lead], EACH, on_processor(folder))
        (expected,) = core.run_records(law, [inputs], columns=core.COLUMNS)
        size = np.abs(expected).max(axis=2, keepdims=True)
        worst = max(worst, float(np.max(np.abs(found - expected) / np.where(size > 0, size, 1))))
    return worst


@pytest.mark.parametrize("law", [LAWS[-1], *(pytest.param(law, marks=pytest.mark.slow) for law in LAWS[:-1])])
def test_a_gpus_sources_take_parameter_sets_through_records(tmp_path: Path, law: str) -> None:
    sets = [{}, {"channel_shift_d": 2e-3}, {"sensor_lag_tau": 5e-3, "driver_lag_tau": 0.01}]
    assert records_off(law, sets, tmp_path) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.name)
def test_every_effect_of_a_gpus_sources_is_the_chains(tmp_path: Path, term: Term) -> None:
    assert records_off("bouc_wen", [settings_of(term, term.starts[0])], tmp_path) < 1e-12


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"u": None}, "u is None"),
        ({"x": np.zeros(100) * 1j}, "x is no array of real numbers"),
        ({"u": "on"}, "u is no array of real numbers"),
        ({"run_in": "false"}, "run_in is 'false'; allowed: True, False"),
        ({"columns": ()}, "columns is empty"),
        ({"params": vector("bingham", damper("bingham") | {"channel_shift_d": 0.06})[None]}, "half of the record"),
    ],
)
def test_what_the_library_cannot_see_is_refused(given: dict[str, Any], said: str) -> None:
    params = vector("bingham", damper("bingham") | {"channel_shift_d": 0.05})[None]
    whole: dict[str, Any] = {"params": params, "dt": 1e-3, "x": np.zeros(100), "u": np.zeros(100)}
    assert core.run_many("bingham", **whole).shape == (1, 1, 100)
    refuses(lambda: core.run_many("bingham", **whole | given), said)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["worlds", "records"])
@pytest.mark.parametrize(("law", "arch"), [*((law, 80) for law in LAWS), (LAWS[0], 90)])
def test_the_kernels_compile_for_a_gpu(
    law: str, arch: int, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cuda.bindings", reason="the extra `cuda` is not installed")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    free = free_attributes(vector(law, damper(law) | {"driver_lag_tau": 0.008}))
    code = gpu.compiled(what, law, free, arch)
    assert code[:4] == b"\x7fELF"
    assert all(name in code for name in ((b"act", b"read") if what == "worlds" else (b"run",)))
    assert gpu.compiled(what, law, free, arch) == code  # from the cache
