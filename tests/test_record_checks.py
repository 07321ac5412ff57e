"""What makes records unfit, told in a line."""

from __future__ import annotations

import re

import numpy as np
import pytest

from mrdamp.identify import identify
from mrdamp.records import Record, embedded
from mrdamp.records.checks import check_clipping, clipped, warnings_of
from refusals import refuses
from sine_records import grid


def test_a_clipped_force_is_told_and_a_whole_one_passes() -> None:
    records = grid()
    check_clipping(records)
    check_clipping(embedded().records)
    force = records[-1].channel("force_N")
    cut = np.minimum(force, 0.9 * force.max())
    found = clipped(cut)
    assert found is not None
    assert found[0] == 0.9 * force.max()
    assert found[1] == pytest.approx(np.mean(force >= 0.9 * force.max()))
    assert clipped(np.maximum(force, 0.9 * force.min())) is not None
    bad = [*records[:-1], records[-1].with_channels({"force_N": cut})]
    refuses(lambda: identify("bingham", bad), r"1.2A_8mm: channel force_N is clipped: .* %")


def test_a_coarse_converter_is_not_clipping() -> None:
    t = np.arange(4000) / 1000
    noise = np.random.default_rng(0).normal(0, 2.0, len(t))
    assert clipped(np.round((500 * np.sin(2 * np.pi * 0.5 * t) + noise) / 3) * 3) is None


def test_a_constant_channel_or_too_few_samples_are_told() -> None:
    records = grid()
    dead = records[2].with_channels({"force_N": np.full(records[2].n, 3.0)})
    said = r"0.4A_4mm: channel force_N is constant \(3\)"
    refuses(lambda: identify("bingham", [*records[:2], dead]), said)
    short = [r.part(0.0, 0.02) for r in records[:4]]
    said = "44 samples to fit 6 free numbers to; at least 120"
    refuses(lambda: identify("bingham", short), said)


@pytest.mark.parametrize(
    ("channel", "factor", "told"),
    [
        ("displacement_m", 1000.0, "2.4A_4mm: displacement_m spans 8 m; usual are 0.0001 to 3"),
        ("force_N", 1e-3, "2.4A_4mm: force_N is up to 0.[0-9]+ N; usual are 2 to 1e[+]07"),
        ("command", 1000.0, "2.4A_4mm: command is up to 2.4e[+]03; usual are 0 to 50"),
        ("displacement_m", 300.0, "2.4A_4mm: displacement_m spans 2.4 m, the other records 0.01[26]"),
    ],
)
def test_units_are_doubted(channel: str, factor: float, told: str) -> None:
    """By what dampers are, and by the other records of the set."""
    records = grid(commands=(0.0, 1.2, 2.4))
    assert warnings_of(records) == []
    k = next(k for k, r in enumerate(records) if r.name == "2.4A_4mm")
    records[k] = records[k].with_channels({channel: factor * records[k].channel(channel)})
    (line,) = warnings_of(records)
    assert re.match(f"{told}: channels are in m, N, s, pC, and A or V", line)


@pytest.mark.parametrize(
    ("force", "charge", "told"),
    [
        (1.0, 1e-3, "t: charge_pC is 0.158 pC for each N of reference_force_N; usual are 1 to 10000"),
        (1e-3, 1.0, "t: reference_force_N is up to 1 N; usual are 2 to 1e[+]07"),
        (1e-3, 1e-3, "t: reference_force_N is up to 1 N"),
        (1.0, 1.0, ""),
    ],
)
def test_units_of_a_calibration_are_doubted(force: float, charge: float, told: str) -> None:
    """1 kN and 158 pC/N, in kN or nC."""
    swing = 1000.0 * np.sin(0.01 * np.arange(1000))
    channels = {"reference_force_N": force * swing, "charge_pC": 158.0 * charge * swing}
    found = warnings_of([Record("t", None, 0.01, channels)])
    assert bool(found) == bool(told)
    assert re.match(told, "".join(found))


def test_milliseconds_taken_for_seconds_are_doubted() -> None:
    record = grid()[0]
    slow = Record(record.name, None, 1000 * record.sample_time, {"command": record.command})
    (line,) = warnings_of([slow])
    told = "the clock runs at 0.5 Hz, and every 0.5 ms is computed; usual are 20 to 100000"
    assert line.startswith(f"{record.name}: {told}")
