"""What makes records unfit, told in a line."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.identify import identify
from mrdamp.records import embedded
from mrdamp.records.checks import check_clipping, clipped, warnings_of
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
    with pytest.raises(InputError, match=r"1.2A_8mm: channel force_N is clipped: .* %"):
        identify("bingham", bad)


def test_a_coarse_converter_is_not_clipping() -> None:
    t = np.arange(4000) / 1000
    noise = np.random.default_rng(0).normal(0, 2.0, len(t))
    assert clipped(np.round((500 * np.sin(2 * np.pi * 0.5 * t) + noise) / 3) * 3) is None


def test_a_constant_channel_of_one_record_is_told() -> None:
    records = grid()
    dead = records[2].with_channels({"force_N": np.full(records[2].n, 3.0)})
    with pytest.raises(InputError, match=r"0.4A_4mm: channel force_N is constant \(3\)"):
        identify("bingham", [*records[:2], dead])


def test_too_few_samples_are_told() -> None:
    short = [r.part(0.0, 0.02) for r in grid()[:4]]
    with pytest.raises(InputError, match="44 samples to fit 6 free numbers to; at least 120"):
        identify("bingham", short)


def test_a_displacement_in_mm_is_doubted() -> None:
    record = grid()[0]
    assert warnings_of([record]) == []
    in_mm = record.with_channels({"displacement_m": 1000 * record.displacement})
    assert warnings_of([record, in_mm]) == ["0A_4mm: displacement_m spans 8 m; channels are in m, N and s"]
