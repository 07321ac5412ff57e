"""What is compared: a structure with its damper and loads; `FrameBench` and `CableBench` are such benches."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.control.base import Controller
    from mrdamp.envs.task import Task

#: Option of a kind of controller -> what tuning chooses it from, the lower and the upper end.
Ranges = Mapping[str, tuple[float, float]]
Found = TypeVar("Found")

#: The spec of a run without the damper.
UNCONTROLLED = "uncontrolled"


class Load(Protocol):
    """A ground motion, or a load on a cable."""

    @property
    def name(self) -> str: ...


@dataclass(frozen=True)
class Measure:
    """key: in files; title: in tables, with its unit; ratio: over the uncontrolled run, its worst case is shown."""

    key: str
    title: str
    ratio: bool = False


def digest(of: Sequence[Any]) -> str:
    """16 hexadecimal digits of the SHA-256 of what JSON can hold."""
    return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()[:16]


#: What ratios are over on a structure with a damper more or less.
WITHOUT = "the structure without a damper"

#: Controllers compared by default on a frame or a cable.
DEFAULT = (
    "passive-off",
    "passive-on",
    "best-constant",
    "clipped-optimal",
    "clipped-optimal-tuned",
    "modulated-optimal-tuned",
    "force-tracking-tuned",
    "lyapunov-tuned",
    "max-dissipation-tuned",
    "skyhook-tuned",
)
#: The tuned ones of them: name -> registered controller.
TUNED = {
    "best-constant": "constant",
    "clipped-optimal-tuned": "clipped-optimal",
    "modulated-optimal-tuned": "modulated-optimal",
    "force-tracking-tuned": "force-tracking",
    "lyapunov-tuned": "lyapunov",
    "max-dissipation-tuned": "max-dissipation",
    "skyhook-tuned": "skyhook",
}


def score(bench: Bench, values: Mapping[str, float]) -> float:
    """What tuning makes small, from the measures of a run."""
    return sum(weight * values[key] for key, (_, weight) in bench.objective.items())


def of_kind(ranges: Mapping[str, Found], kind: str) -> Found:
    """Raises InputError for a kind that has none."""
    if kind not in ranges:
        raise InputError(f"tuning: nothing to tune in {kind}; allowed: {', '.join(ranges)}")
    return ranges[kind]


#: Of the command and the coil, on any bench; NaN for an ideal actuator.
ELECTRIC: tuple[Measure, ...] = (
    Measure("mean_command", "mean command ({unit})"),
    Measure("rms_command", "RMS command ({unit})"),
    Measure("mean_current", "mean current (A)"),
    Measure("rms_current", "RMS current (A)"),
    Measure("coil_energy", "coil energy (J)"),
    Measure("switching_rate", "switching (1/s)"),
)


@dataclass(frozen=True)
class Coil:
    """What the command's power goes into. resistance: ohm; amperes: of coil current per unit of the command.

    Defaults: 5 ohm; a command in V is that of the current driver of Spencer, Dyke, Sain and Carlson 1997
    (doi 10.1061/(ASCE)0733-9399(1997)123:3(230)), 1 A at 3 V, and one in A is the current itself.
    """

    resistance: float = 5.0
    amperes: float = 1.0

    @classmethod
    def of(cls, command_unit: str) -> Coil:
        return cls(amperes=1 / 3 if command_unit == "V" else 1.0)

    def use(self, mean: float, mean_square: float, duration: float) -> dict[str, float]:
        """mean_current and rms_current, A, and coil_energy, J, from the current in units of the command."""
        square = self.amperes**2 * mean_square
        return {
            "mean_current": self.amperes * mean,
            "rms_current": math.sqrt(square),
            "coil_energy": self.resistance * square * duration,
        }


class Bench(Protocol):
    """A structure on which any controller can be run under any load. A run is pure: its result is the same anywhere.

    measures: of a run. headline: keys of the measures that a short table shows. claimed: keys of those by which a
    learned controller is set against the others. tuned: controllers that are tuned, by name -> their kind. default:
    controllers of the default table. unseen_amplitudes: of the loads of the evaluation. objective: what tuning makes
    small, measure -> its name in the `info` of a task, and its weight. option: of a task's reset, that names the load.
    reference: denominator of the ratios, in words. bounds: name -> weights by key of measure, which a clairvoyant
    command minimises; empty without such a search. base: spec of the constant command that gains count from.
    """

    @property
    def command_unit(self) -> str: ...

    @property
    def environment(self) -> str: ...

    @property
    def measures(self) -> tuple[Measure, ...]: ...

    @property
    def headline(self) -> tuple[str, ...]: ...

    @property
    def claimed(self) -> tuple[str, ...]: ...

    @property
    def tuned(self) -> Mapping[str, str]: ...

    @property
    def default(self) -> tuple[str, ...]: ...

    @property
    def objective(self) -> Mapping[str, tuple[str, float]]: ...

    @property
    def option(self) -> str: ...

    @property
    def unseen_amplitudes(self) -> tuple[float, ...]: ...

    @property
    def reference(self) -> str: ...

    @property
    def bounds(self) -> Mapping[str, Mapping[str, float]]: ...

    @property
    def base(self) -> str: ...

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of controllers, see `mrdamp.control.registry`."""

    def check(self, spec: str) -> None:
        """Raises InputError for an unknown controller."""

    def key(self, spec: str, load: Any, amplitude: float) -> str:
        """Hash of all inputs of a run."""

    def run(self, spec: str, load: Any, amplitude: float) -> dict[str, Any]:
        """What is kept of a run, for JSON; spec: UNCONTROLLED or a controller's."""

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        """Every measure by key, from what is kept of a run and of the uncontrolled one; NaN where it has no value."""

    def controller(self, spec: str) -> Controller:
        """Of a spec, as it is compared: see `mrdamp.control.told`. Raises InputError."""

    def task(self, n: int) -> Task:
        """n of the structures on the chain, as controllers are tuned on them."""

    def ranges(self, kind: str) -> Ranges:
        """Of every option of a kind. Raises InputError where there is none."""

    def effort(self, kind: str) -> tuple[int, int]:
        """A search runs every so many-th of the tuning loads, its last choice all or a quarter of them; and how many
        control periods a search may take."""

    def tuning_loads(self) -> Sequence[Any]:
        """Loads that controllers are tuned on."""

    def unseen_loads(self) -> Sequence[Any]:
        """Other loads, for the evaluation."""

    def identity(self) -> str:
        """What tuned settings belong to, as a hash."""

    def about(self) -> str:
        """The structure in words."""
