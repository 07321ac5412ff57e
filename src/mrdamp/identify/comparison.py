"""The foam-damper paper's Table 1 for any record set: Bingham, Bouc-Wen, hyperbolic tangent and a network.

E_t, E_x and E_v as in its Eq. (9), in its unit (cm), and the free-run NRMSE; all on records held out: the test records
where the set has some. With a condition, as in the paper, on one cycle of one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mrdamp.errors import InputError
from mrdamp.identify.calibration import frequency_of
from mrdamp.identify.excerpts import skipped
from mrdamp.identify.fit import Fit, error, identify, simulate
from mrdamp.identify.laws import PAPER_FOLLOWS
from mrdamp.identify.norms import CENTIMETRE, FoamNorms, delta_2, record_norms, rmse
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.narx import FitNarx, Network, lagged, train_narx
from mrdamp.narx.data import series
from mrdamp.narx.evaluation import one_step_force
from mrdamp.narx.splits import of_records
from mrdamp.parallel import Progress, silent
from mrdamp.pictures.damper import LoopData, error_bars, overview
from mrdamp.pictures.identification import model_loops
from mrdamp.records import Record, RecordSet

LAWS = ("bingham", "bouc_wen", "hyperbolic_tangent")
#: What the paper measured on its own damper, 4 Hz at 3 V, one cycle, its data not public.
PAPER: Mapping[str, FoamNorms] = {
    "bingham": FoamNorms(0.4734, 0.3052, 5.6954),
    "bouc_wen": FoamNorms(0.0586, 0.1205, 1.1656),
    "hyperbolic_tangent": FoamNorms(0.0620, 0.1166, 1.1785),
    "network": FoamNorms(0.0301, 0.0747, 0.3793),
}


@dataclass(frozen=True)
class Row:
    """One model: Eq. (9) pooled over the judged records (cm), the NRMSE, and the paper's own figures."""

    model: str
    norms: FoamNorms
    nrmse: float
    paper: FoamNorms | None


@dataclass(frozen=True, eq=False)
class Table1:
    """The table, the fits behind it by law, and each model's force (n,) N on the held-out records by name."""

    rows: tuple[Row, ...]
    fits: Mapping[str, Fit]
    forces: Mapping[str, Mapping[str, Array]]
    records: tuple[Record, ...]

    def picture(self) -> Figure:
        """Loops of all models over the record of the largest force."""
        r = max(self.records, key=lambda r: float(np.std(r.channel("force_N"))))
        shown = {name: forces[r.name] for name, forces in self.forces.items()}
        return model_loops(r.time, r.displacement, r.velocity(), r.channel("force_N"), shown)


def overview_of(model: Model, records: Sequence[Record], command_unit: str = "A") -> Figure:
    """A model in free run over records of damper tests, as `mrdamp.pictures.damper.overview` draws them."""

    def drawn(r: Record) -> LoopData:
        said, channels = f"free run: {error(model, r).rmse:.1f} N", (r.displacement, r.velocity(), r.command)
        forces = r.channel("force_N"), simulate(model, r)
        t, x, v, u, measured, simulated = (values[r.lead :] for values in (r.time, *channels, *forces))
        return LoopData(r.name, t, x, v, u, measured, simulated, command_unit, said)

    return overview([drawn(r) for r in records])


def errors_picture(fit: Fit) -> Figure:
    """The errors of a fit by record."""
    errors = [*fit.held_out, *fit.train]
    apart = [k < len(fit.held_out) for k in range(len(errors))]
    return error_bars([e.record for e in errors], [e.nrmse for e in errors], apart)


def record_errors(model: Model, records: Sequence[Record]) -> list[dict[str, Any]]:
    """A model's free-run errors by record in both papers' measures: Eq. (9), E_x and E_v in cm; delta_2 of Eq. (4).

    The first 20 ms do not count.
    """
    parts = [_without_start(record, simulate(model, record)) for record in records]
    return [
        {
            "record": rest.name,
            **asdict(record_norms(rest, force, CENTIMETRE)),
            "delta_2": delta_2(rest.channel("force_N"), force),
        }
        for rest, force in parts
    ]


def paper_network(
    records: RecordSet,
    *,
    initialisations: int = 3,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
) -> FitNarx:
    """The paper's network: displacement, velocity, command and force, four samples of each, 10 and 4 tanh units.

    Its stages are chosen on the validation records where the set has test records too; else on the training records,
    so that the held-out ones evaluate it as they do the laws. Raises InputError.
    """
    splits = of_records(records)
    channels = "xviF" if splits.varies else "xvF"
    tell = progress or silent
    left_out, judged = (splits.validation, splits.test) if splits.test else ((), splits.validation)
    return train_narx(
        splits.train, left_out, judged, inputs=lagged(channels, 3), hidden=(10, 4), initialisations=initialisations,
        refined=min(2, initialisations), seed=seed, workers=workers,
        progress=lambda what, share: tell(f"network: {what}", share),
    )  # fmt: skip


def network_forces(network: Model, records: Sequence[Record]) -> dict[str, dict[str, Array]]:
    """Force (n,) N by record name of a network, "network" in free run and "network, one step ahead" of measured forces.

    The second runs at the network's own rate, between its samples along lines; its first samples, whose lags are not
    measured, are the measured force.
    """
    forces = {"network": {r.name: simulate(network, r) for r in records}}
    if network.weights:
        net = Network.from_text(network.weights)
        one: dict[str, Array] = {}
        for r, s in ((r, series(r, net.sample_time)) for r in records):
            force = np.concatenate([s.force[: net.max_lag], one_step_force(net, s)])
            one[r.name] = np.interp(r.time - r.time[0], s.sample_time * np.arange(s.n), force)
        forces["network, one step ahead"] = one
    return forces


def judged_records(records: RecordSet, condition: str | None = None) -> tuple[Record, ...]:
    """The records that a table is of: the test records, or the held-out ones; or the one of that name. InputError."""
    held = records.test or records.validation
    if condition is None:
        return held
    found = tuple(r for r in held if r.name == condition)
    if not found:
        raise InputError(f"no held-out record {condition!r}; there are {', '.join(r.name for r in held)}")
    return found


def table_1(
    records: RecordSet,
    laws: Sequence[str] = LAWS,
    others: Mapping[str, Mapping[str, Array]] | None = None,
    *,
    condition: str | None = None,
    extras: Sequence[str] = ("offset",),
    dependence: str | None = None,
    paper_follows: bool = False,
    starts: int = 4,
    seed: int = 0,
    progress: Progress | None = None,
) -> Table1:
    """Fits each law to the train records and compares them on the others, in free run.

    others: more models by name ("network"): their force (n,) N for each judged record, by the record's name.
    condition: a held-out record; the table is of its last whole cycle. paper_follows: the paper's choice of what
    follows the command. Raises InputError where a prediction is missing or of another length.
    """
    judged, say = judged_records(records, condition), progress or silent
    fits: dict[str, Fit] = {}
    forces: dict[str, Mapping[str, Array]] = {}
    for count, law in enumerate(laws):
        say(law, count / len(laws))
        fits[law] = identify(
            law, records.train, records.held_out, extras=extras, dependence=dependence,
            follows=PAPER_FOLLOWS.get(law) if paper_follows else None, starts=starts, seed=seed,
        )  # fmt: skip
        forces[law] = {r.name: simulate(fits[law].model, r) for r in judged}
    for name, given in (others or {}).items():
        for record in judged:
            if record.name not in given or np.shape(given[record.name]) != (record.n,):
                raise InputError(f"{name}: no force of {record.n} samples for held-out record {record.name}")
        forces[name] = given
    say("evaluating", 1.0)
    part = _without_start if condition is None else _last_cycle
    rows = tuple(row_of(name, given, judged, part) for name, given in forces.items())
    return Table1(rows, fits, forces, judged)


def _last_cycle(record: Record, force: Array) -> tuple[Record, Array]:
    """Both over the last whole period of the displacement."""
    count = round(1 / (frequency_of(record.displacement, record.sample_time) * record.sample_time))
    first = record.n - count - 1
    if first < round(0.02 / record.sample_time):
        raise InputError(f"{record.label}: no whole cycle of its displacement after the first 20 ms")
    return record.part(record.time[first], record.time[-1]), np.asarray(force)[first:]


Part = Callable[[Record, Array], tuple[Record, Array]]


def row_of(name: str, forces: Mapping[str, Array], records: Sequence[Record], part: Part | None = None) -> Row:
    """A model's row from its force (n,) N by record name.

    Mean squares of the errors over the records, over the mean variance of the force: as in `identify.pooled`. part:
    what of a record and its force counts; None: all but the first 20 ms.
    """
    parts = []
    for record in records:
        rest, force = (part or _without_start)(record, forces[record.name])
        norms = record_norms(rest, force, CENTIMETRE)
        deviation = float(np.std(rest.channel("force_N")))
        left = rmse(rest.channel("force_N"), force)
        parts.append([norms.e_t * deviation, norms.e_x * deviation, norms.e_v * deviation, left, deviation])
    *total, size = np.sqrt(np.mean(np.square(parts), axis=0))
    e_t, e_x, e_v, nrmse = (float(x / size) for x in total)
    return Row(name, FoamNorms(e_t, e_x, e_v), nrmse, PAPER.get(name))


def _without_start(record: Record, force: Array) -> tuple[Record, Array]:
    """Both without the first 20 ms, where the unknown start state fades."""
    skip = skipped(record)
    return record.part(record.time[skip], record.time[-1]), np.asarray(force)[skip:]
