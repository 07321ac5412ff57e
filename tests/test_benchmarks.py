"""The benchmarks run and measure what they say; no figure of theirs is judged by a clock here."""

from __future__ import annotations

import math
import socket
import sys

import numpy as np
import pytest

from benchmarks import __main__ as program
from benchmarks import accuracy, fits, opensees, python_env
from benchmarks.frames import DYKE
from benchmarks.python_law import PythonDamper
from benchmarks.result import Figure, Section, machine, markdown, of_ratio
from benchmarks.timing import Effort, interleave, ratio
from mrdamp.envs import FrameEnv
from mrdamp.identify import simulate
from mrdamp.model import Model
from mrdamp.narx.splits import cut_varying
from mrdamp.records import Record, embedded

END = 1.2  # s, of the accuracy runs


@pytest.mark.slow
@pytest.mark.parametrize("name", program.benchmarks(Effort(), sys.executable))
def test_every_benchmark_gives_figures(name: str) -> None:
    sections = program.benchmarks(Effort(rounds=2, steps=40), sys.executable, END)[name]()
    figures = [figure for section in sections for figure in section.figures]
    assert figures
    for figure in figures:
        if figure.skipped:
            assert name in ("opensees", "narx")
        else:
            assert math.isfinite(figure.value)
            # What is left out to see what it costs may cost nothing in so few steps.
            assert figure.value > 0.0 or figure.unit == "us"


def test_ratio_is_of_the_rounds_and_the_order_is_turned() -> None:
    calls: list[str] = []
    costs = {"a": iter([9.0, 2.0, 4.0, 8.0]), "b": iter([9.0, 1.0, 1.0, 2.0])}

    def task(name: str) -> float:
        calls.append(name)
        return next(costs[name])

    measured = interleave({name: lambda name=name: task(name) for name in costs}, 3)  # type: ignore[misc]
    assert "".join(calls) == "ab" + "ab" + "ba" + "ab"
    found = ratio(measured["a"], measured["b"])
    assert (found.value, found.top, found.bottom) == (4.0, 4.0, 1.0)


def test_errors_are_small_where_the_speed_is_stated() -> None:
    for dt in (5e-4, 1e-3):
        assert accuracy.law_error(dt, END) < 2e-3
        assert accuracy.frame_error(dt, END) < 8e-3


def test_python_law_is_the_same_law() -> None:
    """Against SciPy: three inner steps are as good as the plugin, one is useless at this step of the engine."""
    p = DYKE.attributes()
    assert accuracy.python_law_error(PythonDamper(p, 3), 5e-4, END) < 2e-3
    assert accuracy.python_law_error(PythonDamper(p, 1), 1e-4, END) < 2e-3
    assert accuracy.python_law_error(PythonDamper(p, 0), 1e-3, END) > 0.1
    assert accuracy.frame_error(1e-4, END, PythonDamper(p, 1)) < 8e-3


@pytest.mark.slow
def test_the_environment_in_python_is_the_same_environment() -> None:
    """Neither side of the comparison is let off: forces are alike, those of the finer steps too."""
    exact = python_env.forces(FrameEnv(motions=python_env.MOTIONS, timestep=1e-4), 1.0)
    plugin = accuracy.error(python_env.forces(FrameEnv(motions=python_env.MOTIONS), 1.0), exact)
    errors = [accuracy.error(python_env.forces(loop.env(), 1.0), exact) for loop in python_env.LOOPS]
    plain, abreast, shorter, fine = errors
    assert plugin < max(abreast, shorter) < 2.5e-3
    assert fine < 4e-3 < plain < 0.02


def test_opensees_frame_is_the_same_frame() -> None:
    try:
        error = opensees.force_error(sys.executable, 2e-4, END)
    except opensees.MissingError as missing:
        pytest.skip(str(missing))
    assert error < 0.02


def test_page_has_every_row_and_no_machine_name() -> None:
    measured = interleave({"a": lambda: 3.0, "b": lambda: 2.0}, 2)
    row = of_ratio("this over that", ratio(measured["a"], measured["b"]), "<= 2")
    page = markdown(
        [Section("Title", "Words.", (row, Figure("other", target=">= 4", skipped="not installed")))], 2
    )
    assert "| this over that | 1.50 x (<= 2) |" in page
    assert "| other | skipped (>= 4) | not installed |" in page
    assert socket.gethostname() not in machine()


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
