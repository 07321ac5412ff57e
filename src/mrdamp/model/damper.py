"""A damper in the simulator: law, parameters, effects and, in a frame, the structure.

What `case.json` (the nominal simulator) and `corrected.json` hold; see docs for the format.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from mrdamp.errors import InputError, nearest
from mrdamp.files import read_json, write_atomic
from mrdamp.model import core, schema
from mrdamp.model.attributes import MISREADING, effects
from mrdamp.model.core import Array
from mrdamp.model.native import pointer
from mrdamp.structures import ShearFrame

#: s, the damper's longest inner step in a frame (which is stepped with half of it): a damper whose command jumps rings
#: with its floor, at 110 Hz in a frame of 100 kg and a Bouc-Wen law, and twice that leaves 2 % of it out.
_FRAME_SUBSTEP = 2.5e-4

#: Effects of the structure: parameter -> (unit, meaning); their place is a storey, or a floor for the mass.
STRUCTURE_EFFECTS: Mapping[str, Mapping[str, str]] = {
    "storey_stiffness": {"e": "relative change of the storey's stiffness"},
    "storey_damping": {
        "e": "relative change of the storey's damping",
        "quadratic": "N s2/m2, times |v| v beside it",
    },
    "joint_friction": {
        "coulomb": "N, dry friction in the storey",
        "width": "m/s, velocity over which it turns; 0: it builds up over a drift",
        "presliding": "m, that drift; 0: 10 um",
    },
    "floor_mass": {"dm": "kg, mass added to the floor"},
}
#: Effects of a floor's accelerometer in a frame, where their place is the floor.
FLOOR_SENSOR_EFFECTS: Mapping[str, Mapping[str, str]] = {
    "sensor_gain": {"g": "acc_gain"},
    "sensor_offset": {"f": "acc_offset", "settle": "acc_settle", "time": "acc_settle_time"},
    "sensor_leakage": {"tau": "acc_leakage", "share": "acc_leakage_share", "tau2": "acc_leakage2"},
    "sensor_lag": {"tau": "acc_lag", "tau2": "acc_lag2", "ratio": "acc_ratio"},
}
#: Columns of `core.FrameInput` that effects with a place set.
_COLUMNS: Mapping[str, Mapping[str, str]] = {
    **FLOOR_SENSOR_EFFECTS,
    "storey_damping": {"quadratic": "damping2"},
    "joint_friction": {"coulomb": "friction", "width": "friction_width", "presliding": "friction_presliding"},
}


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue, with its parameters and, in a frame, its place (storey or floor, from 1)."""

    name: str
    parameters: Mapping[str, float]
    place: int | None = None


@dataclass(frozen=True)
class Model:
    """A damper and, for the rig `frame`, the structure that it stands in.

    law, parameters: as in `mrdamp.model.core.law_parameters`, SI. weights: text of the NARX weights file (law narx).
    effects: what is switched on. Raises InputError for anything the chain would not take.
    """

    law: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()
    rig: str = "damper"
    structure: ShearFrame | None = None
    weights: str | None = None
    name: str = "model"
    sample_rate_hz: float | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)  # what a file carries besides, kept on writing

    def __repr__(self) -> str:
        effects = ", ".join(e.name for e in self.effects) or "none"
        return f"Model({self.name!r}, {self.law}, rig {self.rig}, effects: {effects})"

    @property
    def hold(self) -> bool | None:
        """Whether records of the rig hold the command from sample to sample; None: the file does not say."""
        return self.extra.get("hold")

    def with_hold(self, hold: bool) -> Model:
        """The same model with what it says of commands between samples."""
        return replace(self, extra={**self.extra, "hold": hold})

    def __post_init__(self) -> None:
        if self.rig not in schema.RIGS:
            raise InputError(f"{self.name}: rig '{self.rig}'; allowed: {', '.join(schema.RIGS)}")
        if (self.rig == "frame") != (self.structure is not None):
            raise InputError(f"{self.name}: rig frame needs a structure, and rig damper has none")
        for effect in self.effects:
            self._check_effect(effect)
        try:
            core.vector(self.law, self.attributes)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None
        if (self.law == "narx") != (self.weights is not None):
            raise InputError(f"{self.name}: law narx needs weights, and no other law has any")
        _ = self.narx  # what is no network's text is refused here, before anything is written

    def _check_effect(self, effect: Effect) -> None:
        where = f"{self.name}: effect {effect.name}"
        try:
            known = effect_parameters(effect.name, effect.place is not None)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None
        if effect.place is not None or effect.name in STRUCTURE_EFFECTS:
            if self.structure is None:
                raise InputError(f"{where}: a place or an effect of the structure needs rig frame")
            storeys = self.structure.storeys
            if effect.place is None or not 1 <= effect.place <= storeys:
                raise InputError(f"{where}: place {effect.place}; allowed: 1 to {storeys}")
        for key, value in effect.parameters.items():
            if key not in known:
                allowed = f"allowed: {', '.join(known)}{nearest(key, known)}"
                raise InputError(f"{where}: parameter '{key}' is unknown; {allowed}")
            if not schema.is_number(value):
                raise InputError(f"{where}: parameter '{key}' is {value!r}; allowed: a finite number")

    @property
    def command_lag(self) -> float:
        """s, of the current behind the command: the delay and the driver's time constants together."""
        names = ("command_delay_d", "driver_lag_tau", "driver_lag_tau2")
        return sum(self.attributes.get(name, 0.0) for name in names)

    @property
    def sensor_lag(self) -> float:
        """s, of the measured force behind the force: the time constants of its sensor together."""
        return sum(self.attributes.get(name, 0.0) for name in ("sensor_lag_tau", "sensor_lag_tau2"))

    @cached_property
    def attributes(self) -> dict[str, float]:
        """The plugin's attributes: the law's parameters and those of the effects that have no place."""
        out = dict(self.parameters)
        for effect in self.effects:
            if effect.place is None and effect.name not in STRUCTURE_EFFECTS:
                out |= {f"{effect.name}_{key}": float(value) for key, value in effect.parameters.items()}
        return out

    @cached_property
    def narx(self) -> core.Narx | None:
        return core.Narx(self.weights) if self.weights is not None else None

    @property
    def frame(self) -> core.FrameInput:
        """The structure with its effects, for the C entry."""
        if self.structure is None:
            raise InputError(f"{self.name}: rig damper has no structure")
        s = self.structure
        columns = {name: getattr(s, name).copy() for name in ("mass", "stiffness", "damping")}
        columns["acc_gain"] = np.ones(s.storeys)
        for effect in self.effects:
            k = (effect.place or 0) - 1
            for key, value in effect.parameters.items() if effect.place is not None else ():
                if effect.name == "floor_mass":
                    columns["mass"][k] += value
                elif key == "e":
                    columns[effect.name.removeprefix("storey_")][k] *= 1 + value
                else:
                    columns.setdefault(_COLUMNS[effect.name][key], np.zeros(s.storeys))[k] = value
        return core.FrameInput(damper_between=s.damper_between, **columns)

    @property
    def built(self) -> ShearFrame:
        """The structure with the masses, stiffnesses and damping that the effects give it."""
        held, s = self.frame, self.structure
        assert s is not None
        return ShearFrame(held.mass, held.stiffness, held.damping, s.damper_between, s.others)

    def with_effects(self, effects: Sequence[Effect]) -> Model:
        """The same model with these effects in place of its own."""
        return replace(self, effects=tuple(effects))

    def simulate(
        self, dt: float, inputs: Mapping[str, Array], *, hold: bool | None = None
    ) -> dict[str, Array]:
        """Free run over the inputs of a record, through the C entry; channels as in a record file.

        dt (s); inputs: `displacement_m` and `command`, or `ground_acceleration_m_s2` and `command`, (n,) each.
        hold: the command is held between samples; None: as the model says, else along lines.
        Returns force_N and reference_force_N, or the floors' accelerations and displacements and force_N.
        """
        hold = bool(self.hold) if hold is None else hold
        if self.rig == "damper":
            v, a = inputs.get("velocity_m_s"), inputs.get("acceleration_m_s2")
            out = core.run(
                self.law, self.attributes, dt, inputs["displacement_m"], v, a, inputs["command"], hold=hold,
                run_in=True, narx=self.narx, columns=("force", "reference"),
            )  # fmt: skip
            return {"force_N": out["force"], "reference_force_N": out["reference"]}
        substep = min(_FRAME_SUBSTEP, self.attributes.get("substep", _FRAME_SUBSTEP))
        out = core.run_frame(
            self.law, self.attributes, self.frame, dt, inputs["ground_acceleration_m_s2"], inputs["command"], hold=hold,
            substep=substep, narx=self.narx,
        )  # fmt: skip
        return floor_channels(out, dt, self.attributes)

    def to_dict(self) -> dict[str, Any]:
        """What `write` puts into a file."""
        out: dict[str, Any] = {"name": self.name, "format": schema.FORMAT, "rig": self.rig}
        if self.sample_rate_hz is not None:
            out["sample_rate_hz"] = self.sample_rate_hz
        model: dict[str, Any] = {"law": self.law, "parameters": dict(self.parameters)}
        model["effects"] = [
            {"name": e.name, "place": e.place, "parameters": dict(e.parameters)} for e in self.effects
        ]
        if self.structure is not None:
            model["structure"] = self.structure.to_dict()
            model["damper_between"] = list(self.structure.damper_between)
        if self.weights is not None:
            model["weights"] = self.weights
        return {**out, "model": model, **self.extra}

    def write(self, path: Path | str) -> None:
        """Writes a JSON file in one go."""
        write_atomic(Path(path), json.dumps(self.to_dict(), indent=1) + "\n")

    @classmethod
    def read(cls, path: Path | str) -> Model:
        """Reads a case.json, a corrected.json or a model file; a folder means the case.json in it."""
        path = Path(path)
        if path.is_dir():
            path = path / "case.json"
        return cls.from_dict(read_json(path), str(path))

    @classmethod
    def from_dict(cls, data: Any, where: str = "model") -> Model:
        """From a file's content; `where` is what messages call it. Raises InputError for what is not in `schema`."""
        bodies = [key for key in ("model", "nominal") if key in data] if isinstance(data, Mapping) else []
        if isinstance(data, Mapping):
            schema.check(data, schema.FILE, where)
        if len(bodies) != 1:
            has = "both are" if bodies else "none is"
            raise InputError(f"{where}: one object 'nominal' (a case) or 'model' is needed; {has} in it")
        body = data[bodies[0]]
        schema.check(body, schema.BODY, f"{where}: {bodies[0]}")
        if "law" not in body:
            raise InputError(f"{where}: no 'law'; allowed: {', '.join(core.laws())}")
        parameters = _numbers(body.get("parameters", {}), f"{where}: parameters")
        effects = tuple(_effect(item, where) for item in body.get("effects", ()))
        if repeated := {e.name for e in effects if sum((o.name, o.place) == (e.name, e.place) for o in effects) > 1}:
            raise InputError(f"{where}: effect {', '.join(sorted(repeated))} stands there twice; allowed: once")
        rig = data.get("rig", "frame" if "structure" in body else "damper")
        if rig == "damper" and ("structure" in body or "damper_between" in body):
            raise InputError(f"{where}: rig is 'damper' and the model has a structure; allowed: rig 'frame'")
        structure = None
        if rig == "frame":
            schema.check(body.get("structure", {}), schema.STRUCTURE, f"{where}: structure")
            structure = ShearFrame.from_dict(
                body.get("structure", {}), body.get("damper_between", (0, 1)), where
            )
        rate = data.get("sample_rate_hz")
        known = {"name", "format", "rig", "sample_rate_hz", *bodies}
        extra = {key: value for key, value in data.items() if key not in known}
        name = f"{where}" if where != "model" else str(data.get("name", "model"))
        model = cls(body["law"], parameters, effects, rig, structure, body.get("weights"), name, rate, extra)
        model._check_values()
        return replace(model, name=str(data.get("name", Path(where).stem)))

    def _check_values(self) -> None:
        """Raises InputError for a coefficient that is negative at both ends of the commands, and for a frame that the
        chain does not take."""
        given = self.attributes
        low, high = given.get("command_min", 0.0), given.get("command_max", 0.0)
        for stem in ("c0", "c1", "fy", "alpha_"):
            a, b, c, e = (given.get(f"{stem}{part}", 0.0) for part in "abce")
            rate = given.get(f"{stem}r", 1.0)
            first, last = (a + b * u + c * u * u - e * np.expm1(-rate * u) for u in (low, max(low, high)))
            if first < 0 and last < 0:
                what = f"{stem.rstrip('_')} is {first:g} at command {low:g}"
                raise InputError(f"{self.name}: {stem}a is {a:g}: {what}; allowed: at least 0")
        if self.structure is not None:
            try:
                core.run_frame(self.law, given, self.frame, 1e-3, np.zeros(3), np.zeros(3), narx=self.narx)
            except InputError as error:
                raise InputError(f"{self.name}: with its effects, {error}") from None


def effect_parameters(name: str, placed: bool = False) -> tuple[str, ...]:
    """Parameter names of an effect; `placed`: of a floor's accelerometer rather than of the damper."""
    if name in STRUCTURE_EFFECTS:
        return tuple(STRUCTURE_EFFECTS[name])
    if placed:
        if name not in FLOOR_SENSOR_EFFECTS:
            raise InputError(
                f"effect {name} has no place; with one: {', '.join((*STRUCTURE_EFFECTS, *FLOOR_SENSOR_EFFECTS))}"
            )
        return tuple(FLOOR_SENSOR_EFFECTS[name])
    if name not in damper_effects():
        known = (*damper_effects(), *STRUCTURE_EFFECTS)
        raise InputError(f"effect '{name}' is unknown; allowed: {', '.join(known)}{nearest(name, known)}")
    return tuple(row.name[len(name) + 1 :] for row in core.attributes() if row.group == name)


def damper_effects() -> tuple[str, ...]:
    """Names of the effects from driver to sensor, in the order of the chain."""
    return tuple(effects())


def effects_from(attributes: Mapping[str, float]) -> tuple[Effect, ...]:
    """Effects from attribute names such as `driver_lag_tau`; names of a law's parameters are passed over."""
    groups = {row.name: row.group for row in core.attributes()}
    found: dict[str, dict[str, float]] = {}
    for name, value in attributes.items():
        group = groups.get(name, "law")
        if group in damper_effects():
            found.setdefault(group, {})[name[len(group) + 1 :]] = value
    return tuple(Effect(name, found[name]) for name in damper_effects() if name in found)


def recorded(x: Array, dt: float, attributes: Mapping[str, float]) -> Array:
    """A displacement (n,), m, as its channel reads it: late (`channel_shift`), filtered or averaged (`motion_lag`)."""
    shift, tau, width = (attributes.get(name, 0.0) for name in MISREADING)
    t = dt * np.arange(len(x))
    if tau > 0:  # exact for straight lines between samples
        decay = np.exp(-dt / tau)
        own = tau / dt * (1 - decay)
        lagged = signal.lfilter([1 - own, own - decay], [1, -decay], x - x[0])
        x = np.asarray(lagged + x[0])
    if width > 0:
        path = np.concatenate([[0.0], np.cumsum((x[1:] + x[:-1]) / 2) * dt])
        low, high = np.clip(t - width / 2, 0, t[-1]), np.clip(t + width / 2, 0, t[-1])
        mean = (np.interp(high, t, path) - np.interp(low, t, path)) / np.maximum(high - low, dt)
        x = np.where(high > low, mean, x)
    return np.interp(t - shift, t, x) if shift else x


def true_motion(attributes: Mapping[str, float], dt: float, x: Array, v: Array, a: Array) -> tuple[Array, ...]:
    """The inverse of `recorded`: displacement (m), velocity (m/s) and acceleration (m/s2), (n,) each, of the motion
    that a channel has recorded as x, v, a at steps of dt (s)."""
    moved = tuple(np.array(channel, dtype=np.float64) for channel in (x, v, a))
    own = [attributes.get(name, 0.0) for name in MISREADING]
    if any(own):
        core.library().mrdamp_true_motion(*own, dt, len(x), *map(pointer, moved))
    return moved


def floor_channels(out: Mapping[str, Array], dt: float, attributes: Mapping[str, float]) -> dict[str, Array]:
    """Columns of `core.run_frame` as a frame record's channels, with displacements as they are `recorded`."""
    storeys = range(1, 1 + sum(name.startswith("acceleration_") for name in out))
    channels = {f"floor{k}_acceleration_m_s2": out[f"acceleration_{k}"] for k in storeys}
    channels |= {f"floor{k}_displacement_m": recorded(out[f"displacement_{k}"], dt, attributes) for k in storeys}
    return {**channels, "force_N": out["force"]}


def _effect(item: Any, where: str) -> Effect:
    schema.check(item, schema.EFFECT, f"{where}: an effect")
    if "name" not in item:
        raise InputError(f"{where}: an effect has no name; needed: name, place and parameters")
    name = item["name"]
    return Effect(name, _numbers(item.get("parameters", {}), f"{where}: effect {name}"), item.get("place"))


def _numbers(values: Any, where: str) -> dict[str, float]:
    schema.check(values, None, where)
    return {key: float(value) for key, value in values.items()}
