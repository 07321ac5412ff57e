"""A rig whose answer is a sum of known parts: the diagnosis' statistics against truths that can be worked out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Settings, Term
from mrdamp.diagnosis.problem.designs import Envelope, Signal
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record

DT = 0.01


def parts(x: Array) -> dict[str, Array]:
    """What the toy's answer is made of: one array (n,) by setting."""
    late = np.concatenate([[x[0]], x[:-1]])
    return {
        "gain": x,
        "cubic": x**3,
        "offset": np.ones_like(x),
        "sign": np.sign(np.gradient(x)),
        "late": late - x,
        "outside": np.where(x > 0.7, np.sin(40 * x), 0.0),
        "fifth": x**5,
    }


@dataclass(frozen=True)
class ToyRig:
    """Force = sum of settings times parts; nominal gain 2, everything else 0."""

    records: tuple[Record, ...]
    channels: tuple[str, ...] = ("force_N",)
    rivals: tuple[Term, ...] = ()
    threads: int = 1
    still: bool = False

    @property
    def nominal(self) -> tuple[Coordinate, ...]:
        return (Coordinate("gain", 2.0, 0.5, 8.0, 0.1, log=True, prior=3.0),)

    @property
    def terms(self) -> tuple[Term, ...]:
        stages = {"cubic": "fluid", "offset": "sensor", "sign": "mechanics", "late": "driver"}
        return tuple(
            Term(name, stage, (Coordinate(name, 0.0, -50.0, 50.0, 0.1),), ((0.2,),))
            for name, stage in stages.items()
        )

    def measured(self, record: int) -> Array:
        return self.records[record].channel("force_N")[None]

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        return self._answer(settings, np.asarray(self.records[record].displacement))

    def driven(self, record: int) -> Record:
        return self.records[record]

    def compared(self, simulated: Mapping[str, Array], record: int) -> Array:
        return simulated["force_N"][None]

    def rougher(self, terms: Sequence[Term]) -> ToyRig | None:
        return None

    def _answer(self, settings: Sequence[Settings], x: Array) -> Array:
        made = parts(x)
        full = [{"gain": 2.0} | dict(s) for s in settings]
        return np.array([[sum(value * made[name] for name, value in s.items())] for s in full])

    @property
    def envelope(self) -> Envelope:
        return Envelope("displacement_m", 1.2, 12.0, 0.2, 5.0, 0.0, 1.0, DT)

    def admitted(self, signal: Signal, settings: Settings) -> Signal:
        return signal

    def try_signal(self, settings: Sequence[Settings], signal: Signal) -> Array:
        return self._answer(settings, signal.motion)

    @property
    def noise_shares(self) -> Array:
        return np.ones((len(self.records), 1))

    def input_noise(self, settings: Settings, record: int) -> Array:
        return np.zeros(1)

    def conditions(self, record: int) -> dict[str, Array]:
        x = np.asarray(self.records[record].displacement)
        return {"displacement (m)": x, "velocity (m/s)": np.gradient(x, DT)}

    def model(self, settings: Mapping[str, float]) -> Model:
        """A viscous damper of the same gain: the nearest thing that a file can hold."""
        gain = settings.get("gain", 2.0)
        return Model("bingham", {"c0a": gain, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01})


#: A cause outside the toy's catalogue that `cubic` nearly explains.
FIFTH = Term("fifth", "mechanics", (Coordinate("fifth", 0.0, -50.0, 50.0, 0.1),), ((0.2,),))


def toy(truth: Settings, noise: float = 0.02, seed: int = 0, records: int = 6, n: int = 600) -> ToyRig:
    rng = np.random.default_rng(seed)
    t = DT * np.arange(n)
    made = []
    for k in range(records):
        x = (0.6 + 0.1 * k) * np.sin(2 * np.pi * (0.4 + 0.15 * k) * t + k) + 0.3 * np.sin(9 * t + 2 * k)
        force = sum(value * parts(x)[name] for name, value in ({"gain": 2.0} | truth).items())
        channels = {
            "displacement_m": x,
            "command": np.zeros(n),
            "force_N": force + noise * rng.standard_normal(n),
        }
        made.append(Record(f"{k:02d}", None, DT, channels))
    return ToyRig(tuple(made))


def search_of(rig: ToyRig, noise: float = 0.02) -> Search:
    """A search that has tried no cause yet, told of the noise."""
    problem = Problem(rig)
    return Search(problem, sum((noise / b.size) ** 2 for b in problem.blocks))


def searched(truth: Settings, noise: float = 0.02) -> Search:
    search = search_of(toy(truth, noise), noise)
    search.run()
    return search
