"""Both sides of the benchmarks of identification fit the same law to the same records."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import fits
from mrdamp.identify import simulate
from mrdamp.model import Model
from mrdamp.narx.splits import cut_varying
from mrdamp.records import Record, embedded

PARAMETERS = {"c0a": 900.0, "c0b": 500.0, "alpha_a": 300.0, "alpha_b": 450.0, "k0": 0.0, "k1": 0.0, "x0": 0.0,
              "c1a": 2e4, "c1b": 2e4, "A": 2000.0, "gamma": 1000.0, "beta": 1000.0, "n": 2.0}  # fmt: skip


def a_record() -> Record:
    (part,) = cut_varying(embedded(), fits.RECORD).train
    return part.part(part.time[0], part.time[0] + 1.5)


def test_the_law_in_python_is_that_of_the_c_entry() -> None:
    record = a_record()
    point = np.array([0.9, 0.5, 0.3, 0.45, 2.0])
    ours, other = fits.in_c(record)(point), fits.in_python(record)(point)
    assert np.std(ours - other) < 0.02 * np.std(ours)
    less = fits.in_python(record)(point * [1, 1, 0.9, 1, 1])
    assert np.std(ours - less) > 0.03 * np.std(ours)


def test_the_rig_that_mujoco_fits_in_moves_as_the_record_does() -> None:
    sysid = pytest.importorskip(
        "benchmarks.sysid", reason="mujoco[sysid] (extra bench) is missing", exc_type=ImportError
    )
    record, model = a_record(), Model("modified_bouc_wen", PARAMETERS)
    found, expected = sysid.force(model, record), simulate(model, record)[: record.n - 1]
    assert np.std(found - expected) < 0.03 * np.std(expected)
    assert np.std(found[1:] - expected[:-1]) > 0.05 * np.std(expected)  # not a sample late
