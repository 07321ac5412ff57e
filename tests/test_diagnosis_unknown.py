"""The stage of a cause that no catalogue has: faults put about a damper in NumPy, one or two for each stage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from mrdamp.diagnosis.attribution.frame_blocks import Block, shares_by_stage
from mrdamp.diagnosis.attribution.frame_damper import damper_evidence
from mrdamp.diagnosis.attribution.shares import Measured
from mrdamp.diagnosis.attribution.stage_columns import columns_of
from mrdamp.diagnosis.attribution.stage_evidence import StageEvidence
from mrdamp.diagnosis.attribution.stages import stage_shares
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.evidence.resample import DRAWS
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.structures import ShearFrame
from toy_rig import toy

LAW = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
DT, NOISE, SIZE = 4e-3, 3.0, 0.014
TIME = DT * np.arange(1500)
#: Amplitudes, angular frequencies and commands of the records.
MOTIONS = ((1.0, 7.0), (0.6, 11.0), (0.8, 5.0), (0.4, 17.0))
COMMANDS = (
    0.5 + 0.5 * np.sign(np.sin(2.1 * TIME)),
    0.5 + 0.5 * np.sin(1.3 * TIME),
    np.clip(0.3 + 0.4 * np.floor(3 * np.abs(np.sin(0.9 * TIME))) / 2, 0, 1),
    0.8 * (np.sin(3.1 * TIME) > 0.3),
)

Fault = Callable[[Array, Array], Array]


def damper(x: Array, u: Array) -> Array:
    """Bingham's damper, written out."""
    v = np.gradient(x, DT, edge_order=2)
    yielding = (LAW["fya"] + LAW["fyb"] * u) * np.tanh(v / LAW["v_ref"])
    return np.asarray(yielding + (LAW["c0a"] + LAW["c0b"] * u) * v)


def low_pass(x: Array, tau: float) -> Array:
    share = 1 - np.exp(-DT / tau)
    return np.asarray(lfilter([share], [1, share - 1], x))


def bump(x: Array, at: float, width: float) -> Array:
    """One at a part of the stroke, 0 elsewhere."""
    return np.asarray(np.exp(-(((x - at * SIZE) / (width * SIZE)) ** 2)))


def opening_valve(x: Array, u: Array) -> Array:
    """Opens by the force, and closes in its own time."""
    whole, out, opened = damper(x, u), np.empty(len(x)), 0.0
    for k, force in enumerate(whole):
        opened = 1.0 if abs(force) > 450 else opened * np.exp(-DT / 0.4)
        out[k] = force * (1 - 0.3 * opened)
    return out


def soft_mount(x: Array, u: Array) -> Array:
    still = damper(x, u)
    return damper(x - 4e-7 * low_pass(still + 1e-3 * still * np.abs(still), 0.01), u)


FAULTS: dict[str, tuple[str, Fault]] = {
    "tired driver": ("driver", lambda x, u: damper(x, u * (1 - 0.5 * low_pass(u**3, 0.8)))),
    "dropouts": ("driver", lambda x, u: damper(x, np.where((TIME % 1.7) < 0.2, 0.0, u))),
    "few levels": ("driver", lambda x, u: damper(x, 0.35 * np.floor(u / 0.35 + 0.5))),
    "another coil in each record": ("driver", lambda x, u: damper(x, u * (1 + 0.4 * np.sin(1e3 * u.mean())))),
    "opening valve": ("fluid", opening_valve),
    "worn place": ("fluid", lambda x, u: damper(x, u) * (1 - 0.3 * bump(x, 0.4, 0.2))),
    "chatter": ("fluid", lambda x, u: damper(x, u) * (1 + 0.12 * np.sin(60 * TIME))),
    "stuck field": (
        "magnetics",
        lambda x, u: damper(x, u + 0.25 * np.exp(-((u / 0.3) ** 2)) * np.cos(3 * u)),
    ),
    "coil that pulls at the piston": (
        "magnetics",
        lambda x, u: damper(x, u) + 90 * u**2 * bump(x, 0.3, 0.25),
    ),
    "magnet against the coil": ("magnetics", lambda x, u: damper(x, 0.15 + np.abs(u - 0.15))),
    "leaking spring": ("mechanics", lambda x, u: damper(x, u) + 3e4 * (x - low_pass(x, 0.12))),
    "bumper": ("mechanics", lambda x, u: damper(x, u) + 400 * np.expm1(4 * np.maximum(x / SIZE - 0.3, 0))),
    "soft mount": ("mount", soft_mount),
    "creeping cell": ("sensor", lambda x, u: damper(x, u) + 0.25 * low_pass(damper(x, u), 0.25)),
    "hum": ("sensor", lambda x, u: damper(x, u) + 40 * np.sin(80 * TIME)),
    "slow clock": ("sensor", lambda x, u: damper(np.interp(TIME + 4e-3 * TIME, TIME, x), u)),
}


def moved(k: int) -> Array:
    scale, omega = MOTIONS[k]
    return np.asarray(scale * (0.01 * np.sin(omega * TIME) + 0.004 * np.sin(2.4 * omega * TIME)))


def searched(fault: Fault, cell: bool = False) -> Search:
    """A search that has tried no cause; cell: with a load cell that reads what the sensor does."""
    rng = np.random.default_rng(3)
    records = []
    for k, u in enumerate(COMMANDS):
        x = moved(k)
        force = fault(x, u)
        names = ("force_N", "reference_force_N") if cell else ("force_N",)
        read = {n: force + NOISE * rng.standard_normal(len(force)) for n in names}
        records.append(Record(f"{k}", None, DT, {"displacement_m": x, "command": u, **read}))
    problem = Problem(DamperRig(Model("bingham", LAW), tuple(records)))
    floor = float(np.sum((NOISE * problem.weights) ** 2))
    return Search(problem, floor, Limits(base=1))


@pytest.mark.parametrize("name", FAULTS)
def test_the_stage_of_a_fault_that_no_catalogue_has(name: str) -> None:
    stage, fault = FAULTS[name]
    search = searched(fault)
    evidence = StageEvidence.of(search.problem, NOISE)
    assert evidence is not None
    shares, intervals = stage_shares(search, search.base, "unknown", evidence=evidence)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=lambda s: shares[s]) == stage
    assert shares[stage] > 0.5
    low, high = intervals[stage]
    assert low - 1e-9 <= shares[stage] <= high + 1e-9


def test_beside_a_wrong_law_the_stages_are_those_of_the_candidates() -> None:
    """By their probabilities, which need not add up to 1; measured interfaces keep their shares."""
    search = searched(FAULTS["slow clock"][1], cell=True)
    known = {"backlash": 0.09, "mount_compliance": 0.03, "shear_thinning": 0.04, "unknown": 0.8, "none": 0.04}
    shares, intervals = stage_shares(search, search.base, "unknown", causes=known)
    assert (shares["mount"], shares["fluid"], shares["sensor"], intervals) == (0.75, 0.25, 0.0, {})
    parts = (
        Measured("a", ("driver", "magnetics", "fluid", "mechanics", "mount"), 0.9, (0.8, 1.0)),
        Measured("b", ("sensor",), 0.1, (0.0, 0.2)),
    )
    shares, _ = stage_shares(search, search.base, "unknown", parts, causes=known)
    assert shares["mount"] == pytest.approx(0.9 * 0.75)
    assert shares["sensor"] == pytest.approx(0.1)


def test_behind_a_load_cell_the_sensor_is_the_reading_of_the_displacement() -> None:
    """What the own sensor adds was measured; what a displacement read late does to the damper was not."""
    search = searched(FAULTS["slow clock"][1], cell=True)
    evidence = StageEvidence.of(search.problem, NOISE)
    assert evidence is not None
    parts = (
        Measured("a", ("driver", "magnetics", "fluid", "mechanics", "mount"), 0.9, (0.8, 1.0)),
        Measured("b", ("sensor",), 0.1, (0.0, 0.2)),
    )
    shares, _ = stage_shares(search, search.base, "unknown", parts, evidence=evidence)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["sensor"] > 0.9
    assert "sensor" not in columns_of(search.problem, search.problem.rig)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "between"), [("tired driver", (0, 1)), ("worn place", (1, 0))])
def test_the_stage_of_a_fault_of_a_frames_damper(name: str, between: tuple[int, int]) -> None:
    """With its measured stroke put in, whichever way it stands in the frame; its sensor is none of its stages."""
    stage, fault = FAULTS[name]
    rng = np.random.default_rng(4)
    records = []
    for k, u in enumerate(COMMANDS):
        x = moved(k)
        sign = 1.0 if between == (0, 1) else -1.0
        channels = {
            "floor1_displacement_m": sign * x + 1e-6 * rng.standard_normal(len(x)),
            "ground_acceleration_m_s2": np.zeros(len(x)),
            "command": u,
            "force_N": fault(x, u) + NOISE * rng.standard_normal(len(x)),
        }
        records.append(Record(f"{k}", None, DT, channels))
    frame = ShearFrame(np.array([500.0]), np.array([4e5]), np.array([800.0]), between)
    case = Case("a", Path(), Model("bingham", LAW, rig="frame", structure=frame), tuple(records), ())
    block = Block("damper", None, 0.2, 0.01, np.full(DRAWS, 0.04))
    clean, storey = replace(block, gap=0.01), Block("storey", 1, 0.2, 0.01, np.full(DRAWS, 0.04))
    assert damper_evidence(case, [clean, storey]) is None
    assert damper_evidence(case, [clean]) is not None  # what no block shows may be the damper's all the same
    evidence = damper_evidence(case, [block])
    problem = Problem(toy({}))
    search = Search(problem, 1e-3)
    shares, ends = shares_by_stage(search, search.base, "unknown", [block], evidence)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=lambda s: shares[s]) == stage
    assert shares["sensor"] == 0
    low, high = ends[stage]
    assert 0.5 < low <= high <= 1
    # In half of the draws no block is at fault: those have shares too.
    faint = replace(block, drawn=np.where(np.arange(DRAWS) % 2, 0.0, 0.04))
    low, high = shares_by_stage(search, search.base, "unknown", [faint], evidence)[1][stage]
    assert 0.5 < low <= high <= 1


def test_another_rig_has_no_such_stages() -> None:
    problem = Problem(toy({"cubic": 0.5}, 0.005))
    assert StageEvidence.of(problem, 1.0) is None
