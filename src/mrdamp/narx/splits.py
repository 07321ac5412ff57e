"""What a network is trained, chosen and tested on: whole records, or the self-sensing paper's two protocols."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mrdamp.errors import InputError
from mrdamp.identify import error, pooled
from mrdamp.model import Model
from mrdamp.narx.data import PROTOCOL, PROTOCOL_TIME, Series, counted, protocol, series
from mrdamp.narx.evaluation import free_run_error
from mrdamp.narx.network import Network
from mrdamp.records import Record, RecordSet
from mrdamp.records.checks import check_channels, check_clipping

LAG_TIME = 8e-3  # s: the self-sensing paper's lag space of 4 at 500 Hz
#: Share of the largest command within which a command counts as constant, or as the same.
_SAME = 0.02


@dataclass(frozen=True, eq=False)
class DataSplit:
    """DataSplit at the network's sample time (s), and the whole records that the validation ones stand for.

    whole: empty where the validation parts are cut from records.
    """

    train: tuple[Series, ...]
    validation: tuple[Series, ...]
    test: tuple[Series, ...]
    sample_time: float
    whole: tuple[Record, ...] = ()

    @property
    def varies(self) -> bool:
        return bool(np.ptp(np.concatenate([s.i for s in self.train])) > 0.0)

    @property
    def channels(self) -> str:
        """Inputs of the self-sensing paper: v and F, and i where the command varies."""
        return "viF" if self.varies else "vF"

    @property
    def lags(self) -> int:
        """Lag space of about 8 ms."""
        return max(1, round(LAG_TIME / self.sample_time))

    @property
    def units(self) -> tuple[int, ...]:
        """Hidden units: the paper's 20 where the command varies within a record, else its 9."""
        return (20,) if any(np.ptp(s.i) > 0.0 for s in self.train) else (9,)

    def score(self, network: Network) -> float:
        """Free-run error on the validation records; slower ones than the network at their own rate.

        There the plugin evaluates it between samples, where a network that is good on its own grid may go astray.
        """
        model = Model("narx", weights=network.to_text())
        value = pooled([
            error(model, record) if record.sample_time > 1.001 * self.sample_time else free_run_error(network, s)
            for record, s in zip(self.whole, self.validation, strict=True)
        ])
        return value if np.isfinite(value) else float("inf")


def of_records(records: RecordSet, sample_time: float | None = None) -> DataSplit:
    """Whole records. sample_time (s): None is the slowest training record's, 2 ms at least. Raises InputError."""
    step = sample_time or max(PROTOCOL_TIME, *(record.sample_time for record in records.train))
    parts = [
        tuple(counted(r, step) for r in part) for part in (records.train, records.validation, records.test)
    ]
    return DataSplit(parts[0], parts[1], parts[2], step, records.validation)


def varying_command(
    records: RecordSet,
    name: str | None = None,
    counts: tuple[int, int, int] = PROTOCOL,
    sample_time: float = PROTOCOL_TIME,
) -> DataSplit:
    """The time-varying protocol: one record cut into training, validation and test, 4000:2000:1500 at 500 Hz.

    Every other record whose command varies is a test of its own, never trained on (the paper's testing sets 1
    and 2). Chen, Ni and Or (2015), Section 4. name: None is the first long enough. Raises InputError.
    """
    chosen, others = _varying(records, name, sum(counts), sample_time)
    train, validation, test = protocol(chosen, counts, sample_time)
    rest = tuple(series(r, sample_time) for r in others)
    return DataSplit((train,), (validation,), (test, *rest), sample_time)


def at_constant_command(records: RecordSet, command: float | None = None) -> RecordSet:
    """The records at one constant command. command: None is the one with the most training records.

    The constant-current protocol of Chen, Ni and Or (2015), Section 3. Raises InputError where there are none to fit
    to, or none held out.
    """
    check_channels(records.records)
    size = max(float(np.abs(r.command).max()) for r in records) or 1.0
    level = {r.name: float(r.command.mean()) for r in records if np.ptp(r.command) <= _SAME * size}
    there = [level[r.name] for r in records.train if r.name in level]
    if not there:
        raise InputError(f"{records.name}: no training record has a constant command; use --protocol varying")

    def count(value: float) -> int:
        return sum(abs(other - value) <= _SAME * size for other in there)

    wanted = max(there, key=count) if command is None else command
    halves = [
        tuple(r for r in part if r.name in level and abs(level[r.name] - wanted) <= _SAME * size)
        for part in (records.train, records.validation, records.test)
    ]
    for half, name in zip(halves[:2], ("training", "validation"), strict=True):
        if not half:
            shown = ", ".join(f"{v:g}" for v in sorted(set(np.round(list(level.values()), 4))))
            raise InputError(
                f"{records.name}: no {name} record at the constant command {wanted:g}; there are {shown}"
            )
    return RecordSet(records.name, *halves)


def cut_varying(
    records: RecordSet, name: str | None = None, counts: tuple[int, int, int] = PROTOCOL,
    sample_time: float = PROTOCOL_TIME,
) -> RecordSet:  # fmt: skip
    """The time-varying protocol as records, for a law: its training part, and as held out the test part and the rest.

    The validation part is left out: a law has nothing that is chosen on it. Arguments as in `varying_command`.
    """
    chosen, others = _varying(records, name, sum(counts), sample_time)
    same = abs(chosen.sample_time / sample_time - 1.0) < 1e-6
    whole = chosen if same else chosen.resample(sample_time)
    first, last = counts[0], sum(counts)
    train = replace(whole.part(whole.time[0], whole.time[first - 1]), name=f"{whole.name}:train")
    test = replace(whole.part(whole.time[last - counts[2]], whole.time[last - 1]), name=f"{whole.name}:test")
    return RecordSet(records.name, (train,), (test, *others))


def _varying(
    records: RecordSet, name: str | None, count: int, sample_time: float
) -> tuple[Record, tuple[Record, ...]]:
    """The record to cut, and the others whose command varies."""
    records = RecordSet(records.name, records.whole, ())
    varying = [r for r in records if np.ptp(r.command) > 0.0]
    if not varying:
        raise InputError(f"{records.name}: the command never varies in any record; use --protocol constant")
    need = (count - 1) * sample_time * (1.0 - 1e-9)
    chosen = records[name] if name else next((r for r in varying if r.duration >= need), None)
    if chosen is None:
        longest = max(varying, key=lambda r: r.duration)
        raise InputError(
            f"{longest.label}: {longest.duration:g} s are too few for {count} samples at {sample_time:g} s;"
            " give fewer with --counts"
        )
    if chosen not in varying:
        raise InputError(f"{chosen.label}: the command never varies; the protocol needs one that does")
    check_clipping([chosen])
    return chosen, tuple(r for r in varying if r is not chosen)
