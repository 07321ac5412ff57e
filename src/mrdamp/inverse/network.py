"""The inverse as a network: commands learnt from records, with force and command in each other's place.

The network is that of `mrdamp.narx` with the force `lead` samples later (what was to come: the wanted force) where a
model has the command, and the command where a model has the force. Trained by Levenberg-Marquardt with Bayesian
regularisation. This is the inverse that Zapateiro, Luo, Taylor and Dyke leave for future work.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.errors import InputError, require_period
from mrdamp.files import read_json, write_atomic
from mrdamp.inverse.baselines import Extrapolation
from mrdamp.model.core import Array
from mrdamp.narx import network as nn
from mrdamp.narx.bayes import minimise
from mrdamp.narx.data import Series, check
from mrdamp.narx.network import Network
from mrdamp.narx.problems import OneStep
from mrdamp.narx.train import blank
from mrdamp.parallel import Progress, mapped, silent

FORMAT = 1
#: Lags (samples) of displacement, velocity and measured force. The present force contains the current, but a network
#: that uses it repeats its last command; so one without it is tried as well.
LAGS: tuple[Mapping[str, tuple[int, ...]], ...] = (
    {"x": (0,), "v": (0, 1, 2, 4), "F": ()},
    {"x": (0,), "v": (0, 1, 2, 4), "F": (0,)},
)
HIDDEN = (20,)
_MOST = 6_000  # samples that are trained on, evenly spread

Judge = Callable[["NetworkInverse"], float]


@dataclass(eq=False)
class NetworkInverse:
    """A trained inverse; a controller keeps its own past, so one object serves one run at a time.

    Attributes: network, whose channel i is the force (lag 0: wanted, lags from `lead` on: measured) and whose
    output is the command; lead, samples; low, high: range of the command; error: of the command on records held
    out, over its standard deviation; name.
    """

    network: Network
    lead: int
    low: float
    high: float
    error: float
    name: str = "network inverse"

    def __post_init__(self) -> None:
        early = any(0 < lag < self.lead for channel, lag in self.network.inputs if channel == "i")
        if self.lead < 1 or early or self.network.feedback:
            raise InputError(
                f"inverse {self.name}: lead {self.lead} and its inputs do not fit; allowed: x, v, and i at lag 0 and "
                "from a lead of at least 1 on"
            )
        if not -np.inf < self.low < self.high < np.inf:
            raise InputError(f"inverse {self.name}: command from {self.low:g} to {self.high:g}")
        self.reset()

    @property
    def period(self) -> float:
        """Control period, s: the network's sample time."""
        return self.network.sample_time

    @property
    def about(self) -> str:
        """One line on the network: topology, lead, error of the command."""
        return (
            f"{self.network.topology}, {1e3 * self.lead * self.period:.0f} ms ahead; held-out error of the command "
            f"{self.error:.3f} of its standard deviation"
        )

    def reset(self) -> None:
        self._past: dict[str, Array] = {}
        self._wanted: float | None = None
        self._extrapolation = Extrapolation(self.lead, self.period)

    def command(self, t: float, wanted_force: float, y: Mapping[str, float]) -> float:
        now = {"x": y["stroke"], "v": y["stroke_velocity"], "i": y["force"]}
        past = self._past
        if not past:  # as the network was trained: at rest where it stands, at the force that it has
            past |= {
                channel: np.full(self.network.max_lag + 1, 0.0 if channel == "v" else value)
                for channel, value in now.items()
            }
        for channel, value in now.items():
            past[channel][1:] = past[channel][:-1].copy()
            past[channel][0] = value
        last = wanted_force if self._wanted is None else self._wanted
        wanted = self._extrapolation(wanted_force, (wanted_force - last) * self.lead)
        self._wanted = wanted_force
        values = np.array([
            wanted if (channel, lag) == ("i", 0) else past[channel][lag - self.lead * (channel == "i")]
            for channel, lag in self.network.inputs
        ])  # fmt: skip
        return float(np.clip(self.network.forward(values[None])[0], self.low, self.high))

    def to_dict(self) -> dict[str, Any]:
        return {
            "inverse": "network", "format": FORMAT, "lead": self.lead, "command": [self.low, self.high],
            "held_out_error": self.error, "weights": self.network.to_text(),
        }  # fmt: skip

    def write(self, path: Path | str) -> None:
        write_atomic(Path(path), json.dumps(self.to_dict(), indent=1) + "\n")

    @classmethod
    def read(cls, path: Path | str) -> NetworkInverse:
        """Reads what `write` wrote; InputError names the file."""
        path = Path(path)
        try:
            data = read_json(path)
            if data["inverse"] != "network" or data["format"] != FORMAT:
                raise InputError(
                    f"inverse {data['inverse']!r}, format {data['format']!r}; allowed: network, {FORMAT}"
                )
            low, high = map(float, data["command"])
            network = Network.from_text(data["weights"])
            return cls(network, int(data["lead"]), low, high, float(data["held_out_error"]), path.stem)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: no network inverse: {error}") from None


def swapped(s: Series, lead: int) -> Series:
    """A series with the force `lead` samples later in the command's place, and the command in the force's."""
    keep = slice(0, s.n - lead)
    return Series(s.name, s.sample_time, s.x[keep], s.v[keep], s.force[lead:], s.i[keep])


def train_inverse(
    train: Sequence[Series],
    validation: Sequence[Series],
    *,
    leads: Sequence[int] = (1, 2, 3, 4),
    lags: Sequence[Mapping[str, Sequence[int]]] = LAGS,
    hidden: Sequence[int] = HIDDEN,
    commands: tuple[float, float] | None = None,
    judge: Judge | None = None,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
) -> NetworkInverse:
    """Trains network inverses on records whose command varies and returns the best.

    train, validation: stretches at the control period. leads: samples ahead to try. lags: sets of them to try, as in
    `LAGS`. hidden: tanh units per layer. commands: range; None: from 0 to the largest of the training. judge: smaller
    is better; None: the error of the command on the validation stretches, which does not see what a command does to the
    next one: a force tracking in simulation is the better criterion. workers: processes; the same network for any
    number. Raises InputError.
    """
    if not train or not validation:
        raise InputError("an inverse needs records to train on and others to choose by")
    for s in (*train, *validation):
        require_period(f"inverse {s.name}", s.sample_time)
    values = np.concatenate([s.i for s in train])
    varying = [s for s in validation if np.ptp(s.i) > 0]
    if not np.ptp(values) > 0 or not varying:
        raise InputError(f"{train[0].name}: the command never varies; an inverse cannot be learnt from it")
    low, high = commands or (0.0, float(values.max()))
    trials = list(product(lags, leads))
    tasks = [(train, chosen, lead, hidden, seed) for chosen, lead in trials]
    tried: list[tuple[float, NetworkInverse]] = []
    for count, network in enumerate(mapped(_trained, tasks, workers)):
        lead = trials[count][1]
        (progress or silent)(f"{1e3 * lead * network.sample_time:g} ms ahead", (count + 1) / len(trials))
        found = NetworkInverse(network, lead, low, high, _command_error(network, varying, lead))
        tried.append((judge(found) if judge else found.error, found))
    return min(tried, key=lambda one: one[0])[1]


def _trained(
    train: Sequence[Series], lags: Mapping[str, Sequence[int]], lead: int, hidden: Sequence[int], seed: int
) -> Network:
    turned = [swapped(s, lead) for s in train]
    motion = [(channel, lag) for channel in "xv" for lag in lags[channel]]
    inputs = (*motion, ("i", 0), *(("i", lead + lag) for lag in lags["F"]))
    start = nn.nguyen_widrow(len(inputs), hidden, np.random.default_rng(seed))
    check(turned, inputs, len(start))
    network = blank(turned, inputs, hidden)
    return network.with_theta(minimise(OneStep.of(network, turned, _MOST), start, iterations=150).theta)


def _command_error(network: Network, varying: Sequence[Series], lead: int) -> float:
    """RMS error of the command over its standard deviation, mean squares pooled."""
    turned = [swapped(s, lead) for s in varying]
    lag = network.max_lag
    left = [network.forward(s.regressors(network.inputs)[lag:]) - s.force[lag:] for s in turned]
    return float(
        np.sqrt(np.mean([np.mean(e**2) for e in left]) / np.mean([np.var(s.force[lag:]) for s in turned]))
    )
