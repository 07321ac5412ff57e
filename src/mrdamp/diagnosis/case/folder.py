"""A case folder: the nominal simulator and the measured records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.errors import InputError
from mrdamp.files import read_json
from mrdamp.identify.provenance import IDENTIFIED_ON, hashes, text_hash
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record, read_record
from mrdamp.records.channels import DAMPER_INPUTS, FRAME_INPUTS, is_channel, listed
from mrdamp.records.checks import check_frame_sign, check_sign

#: Least number of samples of a record.
LEAST = 100
_INPUTS = {"damper": DAMPER_INPUTS, "frame": FRAME_INPUTS}
#: Simulated over measured force from which, or from the inverse of which, units differ.
_OTHER_UNIT = 100.0
#: Correlation of a frame's channel with the simulator's from which its sign is the other one: whatever is wrong in it,
#: a damper resists. Of 18 frames of other makers the least is .31 of the force, and .24 of the floors.
_REVERSED = -0.5
#: Two tests have the same input if their inputs differ by at most this share of their RMS.
_SAME = 0.02


@dataclass(frozen=True, eq=False)
class Case:
    """A case as read.

    model: nominal simulator. records: without repeats. repeats: each with the number of the record that it
    repeats. baseline: records of the rig in the state in which the nominal simulator was identified. own: number of the
    records that the nominal simulator was identified on; None if the case does not say on which it was.
    """

    name: str
    folder: Path
    model: Model
    records: tuple[Record, ...]
    repeats: tuple[tuple[Record, int | None], ...]
    baseline: tuple[Record, ...] = ()
    own: int | None = None

    @property
    def question(self) -> str:
        """What is asked: `changed`, what has changed since the baseline; `missed`, what the simulator misses on records
        at least half of which it was identified on; `either` if the case does not tell."""
        if self.baseline:
            return "changed"
        return "missed" if self.own is not None and 2 * self.own >= len(self.records) else "either"


def read_case(folder: Path | str) -> Case:
    """Reads a case folder.

    Raises InputError, one line with the file: no such folder, no case.json, a missing record or channel, a
    time axis that is not uniform or differs from case.json, NaN, fewer than 100 samples, no output channel.
    """
    folder = Path(folder)
    path = folder / "case.json"
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; a case is a folder with a case.json")
    if not path.is_file():
        raise InputError(f"{folder}: no case: there is no case.json in it")
    data = read_json(path)
    model = Model.from_dict(data, str(path))
    channels, names = _lists(path, data, model.rig)
    found = [_record(folder, path, name, channels, data.get("sample_rate_hz")) for name in names]
    records = tuple(r for r in found if "repeat" not in r.name.lower())
    if not records:
        raise InputError(f"{path}: every record is a repeat of another one; at least one test is needed")
    repeats = tuple((r, _original(r, records)) for r in found if "repeat" in r.name.lower())
    baseline = tuple(
        _record(folder, path, name, channels, data.get("sample_rate_hz"))
        for name in _baseline(path, data, names)
    )
    for record in (*records, *(r for r, _ in repeats), *baseline):
        check_sign(record)
        if model.structure is not None:
            check_frame_sign(record, model.structure.damper_between)
    _check_against(path, model, records)
    own = None
    if IDENTIFIED_ON in data:
        used = hashes(str(path), data[IDENTIFIED_ON])
        own = sum(text_hash(folder / name) in used for name in names)
    return Case(str(data.get("name", folder.name)), folder, model, records, repeats, baseline, own)


def against(model: Model, records: Sequence[Record]) -> dict[str, tuple[float, float, float]]:
    """Of each measured channel, over the records: RMS over that of the simulator, correlation with it, and with it less
    the ground's acceleration, for floors' accelerations."""
    sums: dict[str, Array] = {}
    for r in records:
        for name, simulated in model.simulate(r.sample_time, r.channels).items():
            if name in r.channels:
                measured, less = np.asarray(r.channel(name)), simulated
                if name.startswith("floor") and name.endswith("_m_s2"):
                    less = simulated - r.channel("ground_acceleration_m_s2")
                both = np.array([measured, simulated, less])
                sums[name] = sums.get(name, np.zeros((3, 3))) + both @ both.T / r.n
    out = {}
    for name, products in sums.items():
        sizes = np.sqrt(np.maximum(np.diag(products), 1e-300))
        alike = products[0] / (sizes[0] * sizes)
        out[name] = float(np.sqrt(products[0, 0]) / sizes[1]), float(alike[1]), float(alike[2])
    return out


def _check_against(path: Path, model: Model, records: Sequence[Record]) -> None:
    """Raises InputError where a channel and the simulator differ as units do (kN, mm, mA: by 1000), or as signs do."""
    for name, (ratio, alike, _) in against(model, records).items():
        if np.isnan(ratio):
            raise InputError(f"{path}: the simulator's {name} is no number with the inputs of the records")
        if not 1e-9 < ratio < 1e9:
            of = f"{name} is 0" if ratio < 1 else f"the simulator's {name} is 0 with the inputs of the records"
            raise InputError(f"{path}: {of}: nothing can be compared")
        if not 1 / _OTHER_UNIT < ratio < _OTHER_UNIT:
            raise InputError(
                f"{path}: {name} is {ratio:.3g} times that of the simulator (RMS over the records): it, an input or the"
                " parameters are in another unit; channels are in m, N, s, and A or V"
            )
        if model.rig == "frame" and alike < _REVERSED:
            way = "floors and ground are positive in one direction"
            if name == "force_N":
                way = "it is positive while the second floor of damper_between moves away from the first"
            raise InputError(
                f"{path}: {name} has the sign opposite to the simulator's (correlation {alike:.2f}): turn it, or the"
                f" ground's; {way}"
            )


def _baseline(path: Path, data: Mapping[str, Any], names: Sequence[str]) -> tuple[str, ...]:
    value = data.get("baseline", [])
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        raise InputError(f"{path}: 'baseline' must be a list of file names, got {value!r}")
    both = [v for v in value if v in names]
    if both or len(set(value)) != len(value):
        raise InputError(
            f"{path}: 'baseline' names a file twice, or one of 'records': {', '.join(both or value)}"
        )
    return tuple(value)


def _lists(path: Path, data: Mapping[str, Any], rig: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    channels, names = data.get("channels"), data.get("records")
    for key, value in (("channels", channels), ("records", names)):
        if not isinstance(value, list) or not value or not all(isinstance(v, str) for v in value):
            raise InputError(f"{path}: '{key}' must be a list of names, got {value!r}")
    assert isinstance(channels, list)
    assert isinstance(names, list)
    if len(set(names)) != len(names):
        raise InputError(f"{path}: 'records' names a file twice")
    for name in channels:
        if not is_channel(name):
            raise InputError(f"{path}: channels: {name!r} is not a channel")
    outputs = [c for c in channels if c.endswith("force_N") or c.startswith("floor")]
    if not outputs or (rig == "damper" and not any(c.endswith("force_N") for c in outputs)):
        raise InputError(
            f"{path}: channels: nothing that was measured can be compared with the simulator; a damper needs force_N"
            f" or reference_force_N, a frame a floor's channel; channels are {listed(channels)}"
        )
    return tuple(dict.fromkeys((*_INPUTS[rig], *channels))), tuple(names)


def _record(folder: Path, case: Path, name: str, channels: tuple[str, ...], rate: Any) -> Record:
    file = folder / name
    if Path(name).name != name:
        raise InputError(f"{case}: record {name!r}: a file name in the case's own folder is needed")
    if not file.is_file():
        raise InputError(f"{file}: no such record; {case} lists it")
    record = read_record(file, required=channels)
    if record.n < LEAST:
        raise InputError(f"{file}: {record.n} samples; at least {LEAST} are needed")
    if rate is not None and abs(record.sample_time * rate - 1) > 1e-3:
        raise InputError(
            f"{file}: the clock runs at {1 / record.sample_time:g} Hz, but {case} says {float(rate):g} Hz"
        )
    for channel in channels:
        if channel.endswith("force_N") and not float(np.ptp(record.channel(channel))) > 0:
            raise InputError(f"{file}: channel {channel} is constant ({record.channel(channel)[0]:g})")
    return record


def _original(repeat: Record, records: tuple[Record, ...]) -> int | None:
    """Number of the record whose input equals that of a repeat; None if there is none."""
    names = [n for n in ("displacement_m", "ground_acceleration_m_s2", "command") if n in repeat.channels]
    for k, record in enumerate(records):
        if record.n != repeat.n or any(n not in record.channels for n in names):
            continue
        if all(_alike(repeat.channel(n), record.channel(n)) for n in names):
            return k
    return None


def _alike(one: Array, other: Array) -> bool:
    """True if two inputs (n,) have the same shape and level; for constant inputs the same level."""
    difference, size = one - other, max(float(np.std(other)), 1e-3 * float(np.ptp(other)))
    same_course = float(np.std(difference)) <= _SAME * size or not np.ptp(other) > 0
    return same_course and abs(float(np.mean(difference))) <= _SAME * max(float(np.abs(other).max()), size)
