"""Records: the channels of one test on one clock, read from CSV and written back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np

from mrdamp.errors import LARGEST, InputError, require_kind, require_path
from mrdamp.files import SUFFIXES, decode, files_in, read_bytes, write_atomic
from mrdamp.records import csv_file, division, motion, sampling
from mrdamp.records.channels import check_header, is_channel
from mrdamp.records.sampling import Array
from mrdamp.shown import Shown

#: A measured velocity that is so many times the displacement's rate, or that part of it, has another unit.
_RATE = 2.0
#: Relative difference of the sample time from the steps of `time_s`.
_CLOCK = 1e-3
#: Sets that come with the package: a self-sensing damper, and the tests of the two papers.
PACKAGED = ("embedded", "self_sensing", "foam")


@dataclass(frozen=True, eq=False)
class Record(Shown):
    """One test: channels (n,) on a uniform clock.

    name: of the file without folder and suffix. path: where it was read from; None for one made in memory or embedded.
    sample_time: s. channels: name -> (n,) float64, read-only, in file order; the names and units of
    `mrdamp.records.channels.CHANNELS`, `time_s` is put in front when it is not given. ignored: columns of the file that
    are no channels. lead: number of samples at its start that lead into it: simulated, and compared with nothing.

    Raises InputError: not a channel name, unequal lengths, fewer than 3 samples, a number that is not finite.
    """

    picture: ClassVar[str] = "mrdamp.pictures.damper:channels"
    name: str
    path: Path | None
    sample_time: float
    channels: Mapping[str, Array]
    ignored: tuple[str, ...] = ()
    lead: int = 0

    def __post_init__(self) -> None:
        check_header(self.label, tuple(self.channels), ())
        if not 0.0 < self.sample_time < np.inf:
            raise InputError(f"{self.label}: sample time {self.sample_time:g} s: it must be positive")
        channels: dict[str, Array] = {
            name: np.array(values, dtype=np.float64) for name, values in self.channels.items()
        }
        shapes = {values.shape for values in channels.values()}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1:
            raise InputError(f"{self.label}: channels must be one-dimensional and equally long: {shapes}")
        count = next(iter(shapes))[0]
        if count < 3:
            raise InputError(f"{self.label}: {count} samples: at least 3 are needed")
        if "time_s" not in channels:
            channels = {"time_s": np.arange(count, dtype=np.float64) * self.sample_time} | channels
        step = float(np.mean(np.diff(channels["time_s"])))
        if not abs(step / self.sample_time - 1) < _CLOCK:
            raise InputError(f"{self.label}: sample time {self.sample_time:g} s, but time_s has steps of {step:g} s")
        for name, values in channels.items():
            if not is_channel(name):
                raise InputError(f"{self.label}: {name} is not a channel")
            if not (np.abs(values) <= LARGEST).all():
                raise InputError(f"{self.label}: {name} holds NaN, infinity or a number above {LARGEST:g}")
            values.setflags(write=False)
        object.__setattr__(self, "channels", channels)

    def __repr__(self) -> str:
        rate, rest = 1.0 / self.sample_time, ", ".join(self.channels)
        return f"Record({self.name!r}, {self.n} samples, {self.duration:.4g} s at {rate:.6g} Hz: {rest})"

    @property
    def label(self) -> str:
        """The path, or the name where there is none: how error lines call the record."""
        return str(self.path) if self.path is not None else self.name

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.time)

    @property
    def time(self) -> Array:
        """(n,) s; exact multiples of the sample time from the first stamp on."""
        return self.channels["time_s"]

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return (self.n - 1) * self.sample_time

    @property
    def displacement(self) -> Array:
        """(n,) m, extension positive."""
        return self.channel("displacement_m")

    @property
    def command(self) -> Array:
        """(n,) A or V."""
        return self.channel("command")

    @property
    def force(self) -> Array | None:
        """(n,) N, the damper's own force; None where it is not in the record."""
        return self.channels.get("force_N")

    def channel(self, name: str) -> Array:
        """One channel (n,). Raises InputError: the record does not hold it; the line lists what it holds."""
        if name not in self.channels:
            raise InputError(f"{self.label}: no channel {name}; the record has {', '.join(self.channels)}")
        return self.channels[name]

    def velocity(self, cutoff_hz: float | None = None) -> Array:
        """(n,) m/s: the displacement's central difference, whether a velocity was measured or not; cutoff_hz: of a
        zero-phase Butterworth low-pass before it."""
        return sampling.derivative(self._smooth("displacement_m", cutoff_hz), self.sample_time)

    def acceleration(self, cutoff_hz: float | None = None) -> Array:
        """(n,) m/s2: as measured, else the central difference of `velocity`; cutoff_hz as there."""
        if "acceleration_m_s2" in self.channels:
            return self._smooth("acceleration_m_s2", cutoff_hz)
        return sampling.derivative(self.velocity(cutoff_hz), self.sample_time)

    def part(self, t0: float, t1: float) -> Record:
        """The samples with t0 <= time <= t1 (s), on their own stamps. Raises InputError: fewer than 3 samples are left.
        """
        slack = 1e-6 * self.sample_time
        keep = (self.time >= t0 - slack) & (self.time <= t1 + slack)
        if np.count_nonzero(keep) < 3:
            raise InputError(
                f"{self.label}: fewer than 3 samples from {t0:g} to {t1:g} s;"
                f" the record runs from {self.time[0]:g} to {self.time[-1]:g} s"
            )
        return replace(self, channels={name: x[keep] for name, x in self.channels.items()}, lead=0)

    def resample(self, sample_time: float) -> Record:
        """The record on another sample time (s): linear interpolation.

        A channel other than the command is low-passed first where the rate falls (see
        `mrdamp.records.sampling.resampled`); a command steps, and a filter would make it ring.
        """
        channels: dict[str, Array] = {}
        for name, x in self.channels.items():
            filtered = name not in ("time_s", "command")
            channels[name] = sampling.resampled(x, self.sample_time, sample_time, filtered=filtered)
        count = len(channels["time_s"])
        channels["time_s"] = self.time[0] + sample_time * np.arange(count)
        lead = round(self.lead * self.sample_time / sample_time)
        return replace(self, sample_time=sample_time, channels=channels, lead=lead)

    def with_channels(self, channels: Mapping[str, Array]) -> Record:
        """The record with channels (n,) added or replaced."""
        return replace(self, channels={**self.channels, **channels})

    def save(self, path: Path | str, digits: int = 9) -> None:
        """Write a .csv or .csv.gz in one go, with so many significant digits. Raises InputError: another suffix, or the
        file cannot be written."""
        path = Path(path)
        if not path.name.endswith(SUFFIXES):
            raise InputError(f"{path}: a record is written as .csv or .csv.gz")
        write_atomic(path, csv_file.rendered(self.channels, digits))

    def _smooth(self, name: str, cutoff_hz: float | None) -> Array:
        x = self.channel(name)
        return x if cutoff_hz is None else sampling.lowpass(x, self.sample_time, cutoff_hz)


@dataclass(frozen=True, eq=False)
class RecordSet:
    """Records of one rig: some to fit to, others for the evaluation.

    test: of these, the ones that nothing is chosen on either (a network's stage, inputs and size); most sets have none.
    """

    name: str
    train: tuple[Record, ...]
    validation: tuple[Record, ...]
    test: tuple[Record, ...] = ()

    @property
    def records(self) -> tuple[Record, ...]:
        """All of them, the training ones first."""
        return self.train + self.held_out

    @property
    def held_out(self) -> tuple[Record, ...]:
        """All that no law is fitted to."""
        return self.validation + self.test

    @property
    def whole(self) -> tuple[Record, ...]:
        """All of them; a record that is cut in time, once and uncut."""
        uncut = tuple(replace(r, lead=0) for r in self.held_out if r.lead)
        return uncut or self.records

    def smoothed(
        self, cutoff_hz: float | None, *, force: bool = False, zero_mean: bool = False
    ) -> RecordSet:
        """The set with every measured displacement low-passed, zero-phase, and its derivatives with it.

        For motions whose samples carry noise, such as a jittering clock's: a law answers it with its stiffness and
        damping. force: the force too. zero_mean: the means of both are taken off, as in the foam-damper paper. Raises
        InputError for a cut-off above half of a record's rate.
        """
        names = ("displacement_m", "force_N") if force or zero_mean else ("displacement_m",)

        def smooth(record: Record) -> Record:
            new = {name: record.channels[name] for name in names if name in record.channels}
            for name, x in new.items():
                if cutoff_hz is not None and (force or name == "displacement_m"):
                    x = sampling.lowpass(x, record.sample_time, cutoff_hz)
                new[name] = x - x.mean() if zero_mean else x
            return record.with_channels(new)

        return self.changed(smooth)

    def changed(self, change: Callable[[Record], Record]) -> RecordSet:
        """The set with every record changed."""
        parts = (tuple(map(change, part)) for part in (self.train, self.validation, self.test))
        return RecordSet(self.name, *parts)

    def __repr__(self) -> str:
        counts = f"{len(self.train)} train, {len(self.validation)} validation, {len(self.test)} test"
        return f"RecordSet({self.name!r}, {counts})"

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, name: str) -> Record:
        """The record of that name. Raises InputError: there is none; the line lists the names."""
        for record in self:
            if record.name == name:
                return record
        raise InputError(f"{self.name}: no record {name!r}; there are {', '.join(r.name for r in self)}")


def read_record(path: Path | str, required: Sequence[str] | None = None) -> Record:
    """Reads a .csv or .csv.gz of the channels in `mrdamp.records.channels.CHANNELS`.

    required: channels that must be there; None: time, command and displacement (damper), or ground acceleration where
    the file has a frame's channels. Raises InputError with the file, the line number and the channel.
    """
    require_path(path="" if path is None else path)
    path = Path(path)
    if not path.name.lower().endswith(SUFFIXES):
        raise InputError(f"{path}: a record is a .csv or .csv.gz file")
    channels, ignored, sample_time = csv_file.parse(str(path), decode(str(path), read_bytes(path)), required)
    if "velocity_m_s" in channels and "displacement_m" in channels:
        ratio = motion.rate_ratio(channels["displacement_m"], channels["velocity_m_s"], sample_time)
        if not 1 / _RATE < ratio < _RATE:
            raise InputError(
                f"{path}: velocity_m_s is {ratio:.3g} times the rate of displacement_m; correct the units or the sign,"
                " or leave the column out"
            )
    time = channels["time_s"]
    channels["time_s"] = time[0] + sample_time * np.arange(len(time))  # printed stamps are rounded
    return Record(_stem(path.name), path, sample_time, channels, ignored)


def read_records(
    source: Path | str | Sequence[Path | str], required: Sequence[str] | None = None
) -> RecordSet:
    """Reads a folder, a file or a list of them, sorted by name.

    The name of a set of `PACKAGED`, where no such file or folder is there, is that set. A folder with `train/` and
    `validation/`, and `test/` where there is one, gives the division. Otherwise records are held out whole: every third
    one (the last of two) is for validation, another in its place where its command goes beyond those of the rest, and a
    test that repeats another (`repeat` in its name, same input) stays on the side of the other. A record that is alone
    is cut in time, where it has covered two thirds of its path: the rest is held out, simulated from the record's start
    on.

    required: as in `read_record`. Raises InputError: no records, a half of the set missing, two files of one name, a
    record twice, or a bad record.
    """
    if isinstance(source, Path | str):
        require_path(source=source)
    else:
        require_kind("a path or several", Sequence, source=source)
        listed = [f for item in source or () for f in record_files(item)]
        files = sorted(listed, key=lambda path: (path.name, str(path)))
        return _hold_out("records", _read_all("the list", files, required))
    folder = Path(source)
    if folder.is_file():
        return _hold_out(_stem(folder.name), (read_record(folder, required),))
    if str(source) in PACKAGED and not folder.is_dir():
        return embedded(str(source))
    name = folder.resolve().name
    halves = [folder / "train", folder / "validation"]
    if any(half.is_dir() for half in halves):
        for half in halves:
            if not half.is_dir():
                raise InputError(f"{half}: no such folder; a set has both train/ and validation/")
        halves += [test] if (test := folder / "test").is_dir() else []
        parts = [_read_all(str(half), files_in(half), required) for half in halves]
        division.refuse_copies([record for part in parts for record in part])
        return RecordSet(name, *parts)
    return _hold_out(name, _read_all(str(folder), files_in(folder), required))


def record_files(path: Path | str) -> list[Path]:
    """A file, or the records of a folder: those of its ``train/``, ``validation/`` and ``test/`` where it has them.
    Raises InputError: there is nothing there, or none in the folder."""
    folder = Path(path)
    parts = [part for name in ("train", "validation", "test") if (part := folder / name).is_dir()]
    return [file for where in parts or [folder] for file in files_in(where)]


def embedded(name: str = "embedded") -> RecordSet:
    """A set of `PACKAGED`, each made by a simulation that shares no physics with the plugin (data/README.md)."""
    found = read_records(Path(__file__).parents[1] / "data" / name)
    return found.changed(lambda record: replace(record, path=None))


def _stem(name: str) -> str:
    lower = name.lower()
    return name[: -len(".csv.gz")] if lower.endswith(".csv.gz") else name.removesuffix(name[-4:])


def _read_all(where: str, files: Sequence[Path], required: Sequence[str] | None) -> tuple[Record, ...]:
    if not files:
        raise InputError(f"{where}: no records")
    names = [_stem(path.name) for path in files]
    for first, second in pairwise(names):
        if first == second:
            raise InputError(f"{where}: two records are named {first}: keep one")
    return tuple(read_record(path, required) for path in files)


def _hold_out(name: str, records: tuple[Record, ...]) -> RecordSet:
    if len(records) == 1:
        only = records[0]
        x = only.channels.get("displacement_m", only.time)
        at = min(max(motion.cut(x), 2), only.n - 4)
        fitted = replace(only.part(only.time[0], only.time[at]), name=f"{only.name}:train")
        return RecordSet(name, (fitted,), (replace(only, lead=at + 1),))
    division.refuse_copies(records)
    validation = division.held_out(records)
    train = tuple(record for k, record in enumerate(records) if k not in validation)
    return RecordSet(name, train, tuple(records[k] for k in sorted(validation)))
