"""Ground motions: file forms, scaling, time compression, and the synthetic motion against its equations."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import welch

from mrdamp import motions
from mrdamp.errors import InputError
from mrdamp.motions import GroundMotion, embedded_motion, kanai_tajimi, read_motion
from refusals import refusal_of, refuses

QUAKES = Path(__file__).resolve().parents[2] / "shared" / "data" / "earthquakes"

NEW_AT2 = """PEER NGA STRONG MOTION DATABASE RECORD
A Quake, 1/17/94, Some Station, 090
ACCELERATION TIME SERIES IN UNITS OF G
NPTS=   7, DT=   .0050 SEC,
  .1000000E-01 -.2000000E-01  .3000000E-01  .4000000E-01  .5000000E-01
 -.6000000E-01  .7000000E-01
"""


def write(folder: Path, text: str, name: str = "a.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def refused(path: Path, sample_time: float | None = None) -> str:
    return refusal_of(path, lambda: read_motion(path, sample_time))


@pytest.mark.skipif(not QUAKES.is_dir(), reason="the shared data folder is not here")
def test_every_shared_motion_reads_as_its_manifest_says() -> None:
    entries = json.loads((QUAKES / "MANIFEST.json").read_text())
    assert len(entries) == 8
    for entry in entries:
        motion = read_motion(QUAKES / entry["file"])
        assert motion.sample_time == entry["dt"]
        assert motion.n == entry["n"]
        assert motion.pga == pytest.approx(entry["pga_m_s2"], abs=1e-4)
        assert motion.pga / 9.80665 == pytest.approx(entry["pga_g"], abs=1e-4)
        assert motion.duration == pytest.approx(entry["duration_s"], abs=0.02)
        assert motion.source[:10] == entry["provenance"][:10]


def test_at2_in_g(tmp_path: Path) -> None:
    touching = NEW_AT2.replace("  .1000000E-01 -.2000000E-01", "  .1000000E-01-.2000000E-01")
    motion = read_motion(write(tmp_path, touching, "RSN1_A_B090.AT2"))
    assert motion.name == "RSN1_A_B090"
    assert motion.sample_time == 0.005
    np.testing.assert_allclose(motion.acceleration / 9.80665, [0.01, -0.02, 0.03, 0.04, 0.05, -0.06, 0.07])
    assert "Some Station" in motion.source


@pytest.mark.parametrize(
    "line",
    [
        "NPTS=7, DT=.005 SEC",
        "NPTS =   7 , DT =  0.0050 SEC",
        "   7    0.0050    NPTS, DT",
        "7 .0050 NPTS, DT",
        "   7   .005000000  NPTS,  DT (SEC)",
        "NPTS=  7, DT= 5.0E-03 SEC",
    ],
)
def test_at2_header_forms(tmp_path: Path, line: str) -> None:
    text = NEW_AT2.replace("NPTS=   7, DT=   .0050 SEC,", line)
    motion = read_motion(write(tmp_path, text, "a.at2"))
    assert (motion.n, motion.sample_time) == (7, 0.005)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("NPTS=   7", "NPTS=   8", "7 samples, its header says NPTS=8"),
        ("NPTS=   7", "NPTS=   6", "7 samples, its header says NPTS=6"),
        ("NPTS=   7, DT=   .0050 SEC,", "", "no NPTS, DT line"),
        ("NPTS=   7, DT=   .0050 SEC,", "NPTS", "line 4: NPTS and DT not understood: 'NPTS'"),
        (".3000000E-01", "abc", "line 5: not a number: 'abc'"),
        ("ACCELERATION TIME", "VELOCITY TIME", "velocity or displacement"),
        ("UNITS OF G", "UNITS OF CM/S/S", "units of 'CM/S/S'"),
        ("   .0050", "   0.0", "sample time 0 s: it must be positive"),
        (" .3000000E-01", " 1.E+999", "sample 3 is inf"),
    ],
)
def test_at2_refused(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in NEW_AT2
    assert expected in refused(write(tmp_path, NEW_AT2.replace(old, new), "a.AT2"))


def test_one_column(tmp_path: Path) -> None:
    text = "# somewhere\n# dt_s=0.02 n=4 pga_m_s2=3\n1\n-3\n2\n0.5\n"
    motion = read_motion(write(tmp_path, text))
    assert (motion.sample_time, motion.source, motion.pga) == (0.02, "somewhere", 3.0)
    plain = write(tmp_path, "1\n-3\n2\n", "plain.csv")
    assert read_motion(plain, 0.01).sample_time == 0.01
    assert "no sample time" in refused(plain)
    assert read_motion(write(tmp_path, "acceleration_m_s2\n1\n2\n3\n"), 0.01).acceleration.tolist() == [
        1,
        2,
        3,
    ]


def test_two_columns(tmp_path: Path) -> None:
    rows = "0,1\n0.01,-2\n0.02,3\n0.03,4\n"
    for text in (rows, "time_s,acceleration_m_s2\n" + rows, "time_s,ground_acceleration_m_s2\n" + rows):
        motion = read_motion(write(tmp_path, text))
        assert motion.sample_time == pytest.approx(0.01)
        np.testing.assert_array_equal(motion.acceleration, [1, -2, 3, 4])
    in_g = read_motion(write(tmp_path, "time_s,acceleration_g\n" + rows))
    np.testing.assert_allclose(in_g.acceleration, np.array([1, -2, 3, 4]) * 9.80665)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("# dt_s=0.02\n", "no samples"),
        ("", "the file is empty"),
        ("acceleration_m_s2\n", "0 samples: at least 3 are needed"),
        ("# dt_s=0.02\n1\n2\n", "2 samples: at least 3 are needed"),
        ("# dt_s=0.02\n1\nx\n2\n", "line 3: column 1 is not a number: 'x'"),
        ("# dt_s=0.02\n1\nnan\n2\n", "line 3: column 1 is NaN"),
        ("# dt_s=0.02 n=5\n1\n2\n3\n", "3 samples, its header says n=5"),
        ("# dt_s=oops\n1\n2\n3\n", "dt_s='oops' in the header is not a number"),
        ("# dt_s=-0.02\n1\n2\n3\n", "it must be positive"),
        ("0,1\n0.01,2\n0.03,3\n0.04,3\n0.05,3\n", "line 3: non-uniform clock"),
        ("0,1,2\n1,1,2\n2,1,2\n", "3 columns and no header"),
        ("time_s,acceleration_cm_s2\n0,1\n1,2\n2,3\n", "no acceleration column"),
        ("t,acceleration_m_s2\n0,1\n1,2\n2,3\n", "no time_s column"),
        ("time_s,acceleration_g,acceleration_g\n0,1,2\n1,2,4\n2,3,6\n", "two columns are named 'acceleration_g'"),
        ("0,1\n10,2\n20,3\n30,1\n", "a sample every 10 s; allowed: up to 0.1 s"),
        ("0,1\n0.01\n0.02,3\n", "line 2 has 1 cells, 2 columns are needed"),
    ],
)
def test_csv_refused(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in refused(write(tmp_path, text))


def test_missing_file(tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "nowhere.AT2")


@settings(max_examples=150, deadline=None)
@given(st.text(max_size=200), st.booleans(), st.sampled_from(["", "# dt_s=0.01\n", NEW_AT2[:150], NEW_AT2]))
def test_any_text_is_read_or_refused(text: str, at2: bool, head: str) -> None:
    refusal = None
    try:
        if at2:
            step, values, _ = motions.parse_at2("a.AT2", head + text)
        else:
            step, values, _ = motions.parse_csv("a.csv", head + text, 0.01)
        motion = GroundMotion("a", step, values)
    except InputError as error:
        refusal = str(error)
    if refusal is None:
        assert np.isfinite(motion.acceleration).all()
    else:
        assert "\n" not in refusal


def test_scaled_and_compressed() -> None:
    motion = GroundMotion("a", 0.02, np.array([1.0, -2.0, 3.0, 1.0]))
    assert motion.scaled(0.5).acceleration.tolist() == [0.5, -1.0, 1.5, 0.5]
    quick = motion.compressed(5.0)
    assert quick.sample_time == pytest.approx(0.004)
    assert quick.duration == pytest.approx(motion.duration / 5)
    np.testing.assert_array_equal(quick.acceleration, motion.acceleration)
    assert not quick.acceleration.flags.writeable
    for bad in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(InputError, match="time compression"):
            motion.compressed(bad)
    refuses(lambda: motion.scaled(math.nan), "scale factor nan")


def test_resampled_is_linear_between_samples() -> None:
    motion = GroundMotion("a", 0.02, np.array([0.0, 4.0, -4.0, 8.0])).resampled(0.005)
    np.testing.assert_allclose(motion.acceleration, [0, 1, 2, 3, 4, 2, 0, -2, -4, -1, 2, 5, 8], atol=1e-12)


def test_save_and_read_back(tmp_path: Path) -> None:
    motion = GroundMotion("wave", 1.0 / 30.0, np.array([0.123456789, -2.0, 3.0, 1e-7]), "one\nline")
    motion.save(tmp_path / "wave.csv", digits=9)
    back = read_motion(tmp_path / "wave.csv")
    assert (back.name, back.source) == ("wave", "one line")
    assert back.sample_time == pytest.approx(1.0 / 30.0, rel=1e-11)
    np.testing.assert_allclose(back.acceleration, motion.acceleration, rtol=1e-8)
    refuses(lambda: motion.save(tmp_path / "wave.AT2"), r"written as \.csv")


def test_synthetic_spectrum_is_clough_penzien() -> None:
    wg, zg, wf, zf = 20.0, 0.35, 3.0, 0.5
    made = kanai_tajimi(
        1, duration=3000.0, sample_time=0.005, ground_frequency=wg, ground_damping=zg, filter_frequency=wf,
        filter_damping=zf, rise=0.01, plateau=3000.0,
    )  # fmt: skip
    frequency, density = welch(made.acceleration, 200.0, nperseg=8192)
    band = (frequency > 0.15) & (frequency < 15.0)
    w = 2 * np.pi * frequency[band]
    soil = (wg**4 + (2 * zg * wg * w) ** 2) / ((wg**2 - w**2) ** 2 + (2 * zg * wg * w) ** 2)
    cut = w**4 / ((wf**2 - w**2) ** 2 + (2 * zf * wf * w) ** 2)
    ratio = density[band] / (soil * cut)
    groups = np.array([part.mean() for part in np.array_split(ratio, 12)])
    assert np.abs(groups / groups.mean() - 1.0).max() < 0.12


def test_synthetic_envelope_rises_stays_and_fades() -> None:
    square = np.mean([kanai_tajimi(k, pga=1.0).acceleration ** 2 for k in range(60)], axis=0)
    level = np.sqrt([part.mean() for part in np.split(square[:2500], 25)])  # each second
    stays = level[4:10].mean()
    assert level[0] < 0.1 * stays
    assert np.ptp(level[4:10]) < 0.25 * stays
    # exp(-0.35 t) from 11 s on; the mean square of the second from 15 to 16 s is read at its middle
    assert level[15] / stays == pytest.approx(math.exp(-0.35 * 4.5), rel=0.2)
    assert level[24] < 0.02 * stays


@pytest.mark.parametrize(
    ("name", "value"),
    [("duration", -1.0), ("pga", 0.0), ("ground_damping", math.nan), ("decay", math.inf), ("plateau", -1.0)],
)
def test_synthetic_refuses(name: str, value: float) -> None:
    refuses(lambda: kanai_tajimi(1, **{name: value}), f"kanai_tajimi: {name} is")
    refuses(lambda: kanai_tajimi(1, sample_time=0.05), r"sample_time is 0\.05 s: at most 0\.04028 s")


def test_embedded_motion() -> None:
    motion = embedded_motion()
    assert motion.pga == pytest.approx(3.4, abs=1e-4)
    assert not np.allclose(kanai_tajimi(3).acceleration, kanai_tajimi(4).acceleration)
    assert 20.0 <= motion.duration <= 30.0
    np.testing.assert_allclose(motion.acceleration, kanai_tajimi(1940).acceleration, atol=2e-4)
    velocity = np.cumsum(motion.acceleration) * motion.sample_time
    assert abs(velocity[-1]) < 0.05 * np.abs(velocity).max()  # the ground comes to rest


def test_times_in_place_of_a_sample_time_are_told() -> None:
    with pytest.raises(InputError, match=r"sample time array\(.*must be positive"):
        GroundMotion("short", np.arange(5.0), np.ones(5))  # type: ignore[arg-type]
