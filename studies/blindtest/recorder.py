"""Noise and resolution of the channels, and the files of a case."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from mrdamp.files import write_atomic
from studies.blindtest.bench import SAMPLE_RATE_HZ
from studies.blindtest.rig import Array


@dataclass(frozen=True)
class Noise:
    """Noise of one channel: standard deviation, correlation between samples, and quantisation step (0: none).
    """

    deviation: float
    correlation: float = 0.0
    step: float = 0.0

    def onto(self, values: Array, rng: np.random.Generator) -> Array:
        """A channel as the logger writes it."""
        white = rng.standard_normal(len(values) + 200)
        coloured = lfilter([np.sqrt(1 - self.correlation**2)], [1, -self.correlation], white)[200:]
        out = values + self.deviation * coloured
        return np.asarray(np.round(out / self.step) * self.step if self.step else out)


def damper_noise(rng: np.random.Generator, force: float, command: float) -> dict[str, Noise]:
    """Noise of a damper's channels, for an RMS force (N) and a largest command."""
    level = force * float(np.exp(rng.uniform(np.log(0.003), np.log(0.013))))
    force_noise = Noise(level, rng.choice([0.0, 0.0, 0.3]), rng.choice([0.0, 0.0, 4 * force / 2**12]))
    motion = Noise(float(rng.uniform(5e-7, 1.1e-6)), 0.92, rng.choice([0.0, 0.0, 5e-7]))
    return {
        "displacement_m": motion,
        "force_N": force_noise,
        "reference_force_N": Noise(level * float(rng.uniform(0.7, 1.2))),
        "current_A": Noise(0.004 * command),
        "temperature_C": Noise(0.05, step=0.1),
    }


def frame_noise(rng: np.random.Generator) -> dict[str, Noise]:
    """Noise of a frame's channels: accelerometers of one type, displacement transducers, the damper's load
    cell."""
    acceleration = float(rng.uniform(0.005, 0.015))
    noise = {f"floor{k}_acceleration_m_s2": Noise(acceleration) for k in (1, 2, 3)}
    noise |= {f"floor{k}_displacement_m": Noise(3e-6) for k in (1, 2, 3)}
    return noise | {"force_N": Noise(float(rng.uniform(3.0, 5.0)))}


def write_record(path: Path, channels: Mapping[str, Array]) -> None:
    """Writes a record with its time column first; a name with `.gz` is compressed."""
    n = len(next(iter(channels.values())))
    columns = {"time_s": np.arange(n) / SAMPLE_RATE_HZ, **channels}
    rows = zip(*([f"{value:.6g}" for value in values] for values in columns.values()), strict=True)
    write_atomic(path, "\n".join([",".join(columns), *(",".join(row) for row in rows)]) + "\n")


def write_case(
    folder: Path,
    rig: str,
    nominal: Mapping[str, Any],
    records: Mapping[str, Mapping[str, Array]],
    baseline: Mapping[str, Mapping[str, Array]] | None = None,
) -> None:
    """A case folder: the records by file name, and case.json last.

    baseline: records of the rig in the state in which its simulator was identified.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, channels in {**records, **(baseline or {})}.items():
        write_record(folder / name, channels)
    first = next(iter(records.values()))
    case = {
        "name": folder.name,
        "format": 1,
        "rig": rig,
        "sample_rate_hz": SAMPLE_RATE_HZ,
        "nominal": dict(nominal),
        "channels": ["time_s", *first],
        "records": list(records),
    }
    if baseline:
        case["baseline"] = list(baseline)
    write_atomic(folder / "case.json", json.dumps(case, indent=1) + "\n")


def write_tests(path: Path, tests: Mapping[str, Mapping[str, Array]]) -> None:
    """Writes records outside the case, without noise, as `test/channel` arrays."""
    arrays: dict[str, Any] = {}
    for test, channels in tests.items():
        n = len(next(iter(channels.values())))
        arrays[f"{test}/time_s"] = np.arange(n) / SAMPLE_RATE_HZ
        arrays |= {f"{test}/{name}": values.astype(np.float32) for name, values in channels.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.npz")
    np.savez_compressed(temporary, **arrays)
    temporary.replace(path)
