"""A frame on a foundation that gives way, with a late ground channel, with few channels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from frame_case import DT, believed, case_of, records
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.evidence.ties import tie_classes
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.report.page import page
from mrdamp.diagnosis.run import diagnose
from mrdamp.records import Record

SOIL = Path(__file__).parents[2] / "shared" / "cases" / "faults" / "19_soil"
LATE = 5  # samples


@pytest.fixture(scope="module")
def measured() -> dict[str, Record]:
    return records()


@pytest.fixture(scope="module")
def late(measured: dict[str, Record]) -> dict[str, Record]:
    """The records with a ground channel that is LATE samples behind the others."""
    name, out = "ground_acceleration_m_s2", {}
    for key, r in measured.items():
        ground = np.asarray(r.channel(name))
        out[key] = r.with_channels({name: np.concatenate([np.full(LATE, ground[0]), ground[:-LATE]])})
    return out


@pytest.mark.slow
def test_a_late_ground_channel_is_the_nearest_cause(late: dict[str, Record]) -> None:
    found = diagnose(case_of(believed(), late))
    assert found.verdict == "unknown"
    assert found.outside is not None
    assert found.outside["cause"] == "ground_delay"
    assert found.outside["parameters"]["ground_delay"] == pytest.approx(LATE * DT, rel=0.02)
    assert found.outside["gap"] < 0.1 * found.gap.nominal
    assert found.where.stages["sensor"] == 1
    assert "late or early" in found.sentence


@pytest.mark.slow
@pytest.mark.skipif(not SOIL.is_dir(), reason="needs the folder ../shared/cases")
def test_soil_that_sways_and_rocks_is_no_storey() -> None:
    """Base 100 kg, 4 MN/m, 2 kN s/m, by another integrator; rocking by an inertia and a spring in kg m2 and N m/rad."""
    found = diagnose(read_case(SOIL), jobs=2)
    assert found.verdict == "unknown"
    assert found.outside is not None
    assert (found.outside["cause"], found.outside["form"]) == ("foundation", "that sways and rocks")
    assert found.outside["gap"] < 1.2 * found.gap.noise_floor
    parameters = found.outside["parameters"]
    assert parameters["sway_stiffness"] == pytest.approx(4e6, rel=0.1)
    # The height of a storey is not in the records: k / I does not depend on it.
    assert parameters["rock_stiffness"] / parameters["rock_mass"] == pytest.approx(1.5e6 / 20, rel=0.1)
    assert found.where.stages["structure"] == 1
    assert "due to" not in found.sentence


@pytest.mark.slow
def test_a_frame_of_which_only_the_force_is_measured(measured: dict[str, Record], tmp_path: Path) -> None:
    kept = ("time_s", "ground_acceleration_m_s2", "command", "force_N")
    few = {
        k: Record(r.name, None, DT, {c: np.asarray(r.channel(c)) for c in kept}) for k, r in measured.items()
    }
    case = case_of(believed(), few)
    found = diagnose(case)
    assert (found.verdict, found.effects) == ("none", ())
    page(found, case.model, case.records).write(tmp_path / "index.html")
    text = (tmp_path / "index.html").read_text()
    assert "Where in the chain" not in text, "there is no gap that could lie anywhere"


@pytest.mark.slow
def test_a_right_simulator_is_right_without_a_repeat_too(measured: dict[str, Record]) -> None:
    case = replace(case_of(believed(), measured), repeats=())
    found = diagnose(case)
    assert (found.verdict, found.effects) == ("none", ())
    assert not any("does not repeat" in note for note in found.notes)


@pytest.mark.parametrize(("rival", "tied"), [(1.2, True), (58.0, False)])
def test_alike_signatures_are_a_tie_only_if_noise_hides_the_difference(rival: float, tied: bool) -> None:
    """Two changes with a cosine of .999; the rival leaves 1.1 or 7.6 times the noise."""
    n, rng = 2000, np.random.default_rng(0)
    change = rng.standard_normal(n)

    def fit(cause: str, cost: float) -> Fit:
        left = rng.standard_normal(n)
        left *= np.sqrt(cost) / np.linalg.norm(left)
        hypothesis = SimpleNamespace(causes=(cause,) if cause else (), nominal=(), name=cause)
        residual = left if cause else 1e3 * change / np.linalg.norm(change)
        return cast(Fit, SimpleNamespace(hypothesis=hypothesis, cost=cost, residual=residual))

    nominal, named, other = fit("", 1e6), fit("floor_mass@3", 1.0), fit("floor_mass@5", rival)
    search = SimpleNamespace(ranked=lambda free: [named, other], smallest=lambda free, causes: nominal, floor=1.0)
    found = tie_classes(cast(Search, search), named, {("floor_mass@3",): 1.0, ("floor_mass@5",): 1e-9})
    assert found == ((("floor_mass@3", "floor_mass@5"),) if tied else ())
