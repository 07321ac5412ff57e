"""A MuJoCo model with damper plugins as one without, what its dampers and their sensors are, and the structures of
`plugin_cpp/core/worlds.h` that hold these."""

from __future__ import annotations

import ctypes
import os
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mrdamp.errors import InputError, require_kind
from mrdamp.library import load_plugin
from mrdamp.model.attributes import attributes, law_number, vector
from mrdamp.model.core import Array, Narx
from mrdamp.model.native import library


class Reading(ctypes.Structure):
    """`Reading` of `core/reading.h`."""

    _fields_ = (
        ("signal", ctypes.c_int),
        *((name, ctypes.c_double) for name in ("sensitivity", "resolution", "range", "noise")),
        ("key", ctypes.c_uint64),
    )


class Worlds(ctypes.Structure):
    """`Worlds` of `core/worlds.h`."""

    _fields_ = (
        *((n, ctypes.c_int) for n in ("worlds", "dampers", "actuators", "controls", "sensors", "readings", "sets")),
        ("timestep", ctypes.c_double),
        *(
            (name, ctypes.c_void_p)
            for name in (
                "law", "params", "net", "actuator", "control", "control_range", "force_range", "store", "lines",
                "pasts", "time", "length", "velocity", "ctrl", "force", "free", "weight", "bare", "acceleration",
                "reading_damper", "reading_column", "reading", "effects", "cutoff", "reading_store", "sensordata",
            )
        ),
    )  # fmt: skip


#: Bytes of what `core/worlds.h` stores, in the order of `mrdamp_worlds_sizes`.
_SIZES = ("Worlds", "WorldDamper", "WorldLine", "WorldPast", "Reading", "ReadingState", "SensorParams", "most")


def sizes() -> dict[str, int]:
    """Bytes of the C++ structures, and the largest number of dampers (`most`)."""
    out = (ctypes.c_int * len(_SIZES))()
    library().mrdamp_worlds_sizes(out)
    return dict(zip(_SIZES, out, strict=True))


DAMPER, SENSOR = "mrdamp.damper", "mrdamp.force_sensor"
#: Signals of a force sensor by their numbers in `core/reading.h`.
SIGNALS = (
    "force", "charge", "true_force", "applied_force", "unlimited_force", "stroke", "stroke_velocity", "power", "energy",
    "current", "field", "temperature",
)  # fmt: skip
#: Attributes of a force sensor behind its signal, in the plugin's order; then effects in that of `SensorParams`.
_OPTIONS = {"sensitivity": -158.248, "resolution": 0.0, "range": 0.0, "noise": 0.0, "seed": 0.0}
_EFFECTS = 10
_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
_LENGTHS = (*_JOINTS, mujoco.mjtTrn.mjTRN_TENDON, mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK)
_FREE = (-np.inf, np.inf)
_INTEGRATORS = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)


@dataclass(frozen=True)
class OneDamper:
    """A damper of a model: actuator and control it is, law, attributes (attributes,), network, and the limits of the
    actuator's force and control."""

    actuator: int
    control: int
    force: tuple[float, float]
    command: tuple[float, float]
    law: int
    params: Array
    net: Narx | None


@dataclass(frozen=True)
class OneReading:
    """A force sensor: the damper that it reads, its number in `sensordata`, its cutoff (0: none), effects (10,), NaN:
    the damper's."""

    damper: int
    column: int
    cutoff: float
    reading: Reading
    effects: Array


@dataclass(frozen=True)
class Converted:
    """model: without damper plugins, for `mujoco_warp.put_model`."""

    model: mujoco.MjModel
    dampers: tuple[OneDamper, ...]
    readings: tuple[OneReading, ...]


def convert(source: mujoco.MjSpec | Path | str) -> Converted:
    """Of a specification, an MJCF file or its text. Raises InputError for what dampers in Warp do not take."""
    load_plugin()
    spec, given = _compiled(source)
    dampers = {k: _damper(given, k) for k in range(given.nactuator) if _kind(given, given.actuator_plugin[k]) == DAMPER}
    if not dampers:
        raise InputError(f"{spec.modelname}: no actuator is a {DAMPER}")
    _check(given, list(dampers))
    numbers = {actuator: number for number, actuator in enumerate(dampers)}
    readings = [
        _reading(given, s, numbers)
        for s in range(given.nsensor)
        if _kind(given, given.sensor_plugin[s]) == SENSOR
    ]
    return Converted(_without(spec), tuple(dampers.values()), tuple(readings))


def _compiled(source: mujoco.MjSpec | Path | str) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    require_kind("an MjSpec, an MJCF file or its text", (mujoco.MjSpec, Path, str), source=source)
    try:
        if isinstance(source, mujoco.MjSpec):
            spec = source.copy()
        elif isinstance(source, str) and source.lstrip().startswith("<"):
            spec = mujoco.MjSpec.from_string(source)
        elif Path(source).is_file():
            spec = mujoco.MjSpec.from_file(str(source))
        else:
            raise InputError(f"'{source}' is neither an MJCF file nor its text")
        return spec, spec.compile()
    except ValueError as error:
        raise InputError(" ".join(str(error).split())) from None


def _kind(m: mujoco.MjModel, instance: int) -> str:
    """Which of the two plugins an instance is, by the number of its attributes; empty: none of them."""
    count = len(_values(m, instance)) if instance >= 0 else 0
    return {len(attributes()) + 2: DAMPER, 1 + len(_OPTIONS) + _EFFECTS: SENSOR}.get(count, "")


def _values(m: mujoco.MjModel, instance: int) -> list[str]:
    """Attributes of a plugin instance in the plugin's order; empty where not given."""
    ends = [*m.plugin_attradr, m.npluginattr]
    end = min((e for e in ends if e > m.plugin_attradr[instance]), default=m.npluginattr)
    raw = bytes(m.plugin_attr[m.plugin_attradr[instance] : end].view(np.uint8))
    return raw.decode().split("\0")[:-1]


def _damper(m: mujoco.MjModel, actuator: int) -> OneDamper:
    law, weights, *values = _values(m, m.actuator_plugin[actuator])
    given = {row.name: float(v) for row, v in zip(attributes(), values, strict=True) if v}
    net = _network(m, weights) if weights else None
    control = int(m.actuator_ctrladr[actuator])
    clamps = m.actuator_ctrllimited[control] and not m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    low, high = m.actuator_ctrlrange[control] if clamps else _FREE
    force, params = _force_range(m, actuator), vector(law, given)
    return OneDamper(actuator, control, force, (float(low), float(high)), law_number(law), params, net)


def _force_range(m: mujoco.MjModel, actuator: int) -> tuple[float, float]:
    """Limits of an actuator's force: its own, and those of a joint on which it is alone."""
    low, high = m.actuator_forcerange[actuator] if m.actuator_forcelimited[actuator] else _FREE
    joint = int(m.actuator_trnid[actuator, 0])
    if _transmission(m, actuator) in _JOINTS and m.jnt_actfrclimited[joint]:
        others = [k for k in range(m.nactuator) if _transmission(m, k) in _JOINTS and m.actuator_trnid[k, 0] == joint]
        ends = sorted(m.jnt_actfrcrange[joint] / m.actuator_gear[actuator, 0]) if len(others) == 1 else _FREE
        low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)


def _network(m: mujoco.MjModel, weights: str) -> Narx:
    asset = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_TEXT, weights.removeprefix("text:"))
    if asset < 0:
        folders = ["", *filter(None, os.environ.get("MRDAMP_PATH", "").split(":"))]
        found = (Path(folder) / weights for folder in folders)
        return Narx.read(next((path for path in found if path.is_file()), Path(weights)))
    begin = m.text_adr[asset]
    return Narx(bytes(m.text_data[begin : begin + m.text_size[asset] - 1]).decode())


def _reading(m: mujoco.MjModel, sensor: int, numbers: dict[int, int]) -> OneReading:
    signal, *values = _values(m, m.sensor_plugin[sensor])
    numeric = [float(v) if v else np.nan for v in values]
    options = [d if np.isnan(v) else v for v, d in zip(numeric, _OPTIONS.values(), strict=False)]
    key = _mix(int(options[4]) ^ _mix(sensor + 1))
    reading = Reading(SIGNALS.index(signal or "force"), *options[:4], key)
    column = int(m.sensor_adr[sensor])
    cutoff = float(m.sensor_cutoff[sensor])
    return OneReading(numbers[int(m.sensor_objid[sensor])], column, cutoff, reading, np.array(numeric[len(_OPTIONS) :]))


def _mix(z: int) -> int:
    """`Mix` of `core/random.h`."""
    mask = (1 << 64) - 1
    z = (z + 0x9E3779B97F4A7C15) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    return z ^ (z >> 31)


def _check(m: mujoco.MjModel, dampers: list[int]) -> None:
    integrator = mujoco.mjtIntegrator(m.opt.integrator)
    if integrator not in _INTEGRATORS:
        raise InputError(f"integrator {integrator.name}: dampers in Warp take Euler and implicitfast")
    if m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION):
        raise InputError("actuation is disabled: the dampers would not act")
    for kind, instances in (("actuator", m.actuator_plugin), ("sensor", m.sensor_plugin)):
        for k, instance in enumerate(instances):
            if instance >= 0 and not _kind(m, instance):
                name = getattr(m, kind)(k).name or str(k)
                raise InputError(f"{kind} '{name}' is of another plugin, which Warp does not take")
    mass = {row.name: k for k, row in enumerate(attributes())}["moving_mass_m"]
    for k in dampers:
        name = m.actuator(k).name or str(k)
        along_site = _transmission(m, k) == mujoco.mjtTrn.mjTRN_SITE and int(m.actuator_trnid[k, 1]) < 0
        if _transmission(m, k) not in _LENGTHS or along_site:
            raise InputError(f"actuator '{name}': dampers in Warp act on a joint, tendon, two sites or slider-crank")
        group = int(m.actuator_group[k])
        if 0 <= group < 31 and m.opt.disableactuator & 1 << group:
            raise InputError(f"actuator '{name}': its group {group} is disabled, which Warp ignores")
        if _transmission(m, k) == mujoco.mjtTrn.mjTRN_TENDON and m.tendon_actfrclimited[m.actuator_trnid[k, 0]]:
            raise InputError(f"actuator '{name}': its tendon has actuatorfrcrange, which acts on no plugin but in Warp")
        if m.actuator_delay[k] > 0:
            raise InputError(f"actuator '{name}': no delay of the engine's in Warp; use command_delay_d")
        if _damper(m, k).params[mass] > 0 and not _straight(m, k):
            raise InputError(f"actuator '{name}': a moving mass needs a joint or a tendon along joints in Warp")


def _transmission(m: mujoco.MjModel, k: int) -> mujoco.mjtTrn:
    return mujoco.mjtTrn(int(m.actuator_trntype[k]))


def _straight(m: mujoco.MjModel, k: int) -> bool:
    """True where the length is linear in the positions."""
    if _transmission(m, k) == mujoco.mjtTrn.mjTRN_TENDON:
        return int(m.wrap_type[m.tendon_adr[m.actuator_trnid[k, 0]]]) == int(mujoco.mjtWrap.mjWRAP_JOINT)
    return _transmission(m, k) in _JOINTS


def _without(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model with a user actuator for each damper and a user sensor for each force sensor."""
    for a in spec.actuators:
        if a.plugin.active:
            a.plugin.active = False
            a.plugin.name = a.plugin.plugin_name = ""
            a.biastype = mujoco.mjtBias.mjBIAS_USER
            a.gaintype = mujoco.mjtGain.mjGAIN_FIXED
            a.gainprm[:] = 0.0
    for s in spec.sensors:
        if s.type == mujoco.mjtSensor.mjSENS_PLUGIN:
            s.plugin.active = False
            s.type, s.dim = mujoco.mjtSensor.mjSENS_USER, 1
            s.needstage, s.datatype = mujoco.mjtStage.mjSTAGE_ACC, mujoco.mjtDataType.mjDATATYPE_REAL
    for p in list(spec.plugins):
        spec.delete(p)
    # Warp never resets a world by itself, which is what this flag asks for, and refuses the flag.
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return spec.compile()
