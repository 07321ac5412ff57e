"""Ground motions: file forms, scaling, the synthetic motion; loads that environments draw: ranges, spectra, seeds."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from scipy.signal import csd, welch

from mrdamp.envs import AmbientLoads, RecordedMotions, SyntheticMotions, WindLoads
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


@pytest.mark.parametrize("line", [
    "NPTS=7, DT=.005 SEC", "NPTS =   7 , DT =  0.0050 SEC", "   7    0.0050    NPTS, DT", "7 .0050 NPTS, DT",
    "   7   .005000000  NPTS,  DT (SEC)", "NPTS=  7, DT= 5.0E-03 SEC",
])  # fmt: skip
def test_at2_header_forms(tmp_path: Path, line: str) -> None:
    text = NEW_AT2.replace("NPTS=   7, DT=   .0050 SEC,", line)
    motion = read_motion(write(tmp_path, text, "a.at2"))
    assert (motion.n, motion.sample_time) == (7, 0.005)


def test_one_column(tmp_path: Path) -> None:
    text = "# somewhere\n# dt_s=0.02 n=4 pga_m_s2=3\n1\n-3\n2\n0.5\n"
    motion = read_motion(write(tmp_path, text))
    assert (motion.sample_time, motion.source, motion.pga) == (0.02, "somewhere", 3.0)
    plain = write(tmp_path, "1\n-3\n2\n", "plain.csv")
    assert read_motion(plain, 0.01).sample_time == 0.01
    assert "no sample time" in refused(plain)
    headed = write(tmp_path, "acceleration_m_s2\n1\n2\n3\n")
    assert read_motion(headed, 0.01).acceleration.tolist() == [1, 2, 3]


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
        (NEW_AT2.replace("NPTS=   7, DT=   .0050 SEC,", ""), "no NPTS, DT line"),
        (NEW_AT2.replace("NPTS=   7, DT=   .0050 SEC,", "NPTS"), "line 4: NPTS and DT not understood: 'NPTS'"),
        (NEW_AT2.replace("ACCELERATION TIME", "VELOCITY TIME"), "velocity or displacement"),
        (NEW_AT2.replace(" .3000000E-01", " 1.E+999"), "sample 3 is inf"),
        ("# dt_s=0.02\n1\nnan\n2\n", "line 3: column 1 is NaN"),
        ("# dt_s=0.02 n=5\n1\n2\n3\n", "3 samples, its header says n=5"),
        ("0,1\n0.01,2\n0.03,3\n0.04,3\n0.05,3\n", "line 3: non-uniform clock"),
    ],
)
def test_files_that_are_no_motions(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in refused(write(tmp_path, text, "a.AT2" if "PEER" in text else "a.csv"))
    assert "no such file" in refused(tmp_path / "nowhere.AT2")


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


def test_embedded_motion() -> None:
    motion = embedded_motion()
    np.testing.assert_allclose(motion.acceleration, kanai_tajimi(1940).acceleration, atol=2e-4)
    velocity = np.cumsum(motion.acceleration) * motion.sample_time
    assert abs(velocity[-1]) < 0.05 * np.abs(velocity).max()  # the ground comes to rest


def test_synthetic_motions_keep_to_their_ranges() -> None:
    source = SyntheticMotions(pga=(1.0, 4.0), duration=10.0)
    peaks = [source.draw(np.random.default_rng(k)).pga for k in range(60)]
    assert min(peaks) >= 1.0
    assert max(peaks) <= 4.0
    assert np.std(np.log(peaks)) == pytest.approx(np.log(4) / np.sqrt(12), rel=0.2)
    assert source.draw(np.random.default_rng(0)).duration == pytest.approx(2.0)
    a, b = (source.draw(np.random.default_rng(3)).acceleration for _ in range(2))
    np.testing.assert_array_equal(a, b)


def test_kanai_tajimi_lacks_the_second_filter() -> None:
    """The soil layer lets low frequencies through as they are; Clough and Penzien take them out."""
    low = {}
    spectra: tuple[Literal["kanai-tajimi", "clough-penzien"], ...] = ("kanai-tajimi", "clough-penzien")
    for spectrum in spectra:
        source = SyntheticMotions(
            pga=(1.0, 1.0), spectrum=spectrum, ground_frequency=(15.0, 15.0), ground_damping=(0.6, 0.6),
            plateau=(100.0, 100.0), duration=100.0, compression=1.0,
        )  # fmt: skip
        motion = source.draw(np.random.default_rng(1))
        f, p = welch(motion.acceleration, 1 / motion.sample_time, nperseg=4096)
        low[spectrum] = p[(f > 0.03) & (f < 0.1)].mean() / p[(f > 2.0) & (f < 3.0)].mean()
    assert 0.2 < low["kanai-tajimi"] < 1.5
    assert low["clough-penzien"] < 0.2 * low["kanai-tajimi"]


def test_recorded_motions_are_scaled_turned_and_played_faster() -> None:
    motion = embedded_motion()
    changed: Any = {"amplitude": (0.5, 2.0), "to_peak": True, "mirror": True, "speed": (0.8, 1.2), "compression": 5.0}
    source = RecordedMotions([motion], **changed)
    found = [source.draw(np.random.default_rng(k)) for k in range(40)]
    assert all(0.5 <= m.pga <= 2.0 + 1e-12 for m in found)
    assert all(4.0 <= motion.sample_time / m.sample_time <= 6.0 for m in found)
    signs = {float(np.sign(m.acceleration @ motion.acceleration)) for m in found}
    assert signs == {-1.0, 1.0}
    plain = RecordedMotions([motion], amplitude=(2.0, 2.0)).draw(np.random.default_rng(0))
    np.testing.assert_allclose(plain.acceleration, 2 * motion.acceleration)


def test_ambient_noise_has_its_size_and_band() -> None:
    source = AmbientLoads(rms=(2.0, 2.0), bandwidth=10.0, duration=120.0)
    load = source.draw(np.random.default_rng(0), 12.0)
    assert load.rms == pytest.approx(2.0, rel=0.03)
    f, p = welch(load.force[:, 3], 1 / load.sample_time, nperseg=512)
    assert p[(f > 15)].max() < 0.25 * p[(f > 1) & (f < 8)].mean()
    assert abs(np.corrcoef(load.force[:, 3], load.force[:, 4])[0, 1]) < 0.1
    even = AmbientLoads(shape="uniform").draw(np.random.default_rng(0), 12.0)
    assert even.force.shape[1] == 1


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "duration"), [(6.0, 1.0), (15.0, 1.0), (15.0, 20.0)])
def test_a_short_wind_has_its_whole_deviation(speed: float, duration: float) -> None:
    """Over many loads: the integral of von Karman's spectrum up to the bandwidth."""
    source = WindLoads(speed=(speed, speed), intensity=(0.2, 0.2), places=1, duration=duration)
    rng, size = np.random.default_rng(4), 1.25 * 1.2 * 0.03 * speed
    squares = [np.mean(source.draw(rng, 12.0).force ** 2) / size**2 for _ in range(3000)]
    n = np.concatenate([[0.0], np.geomspace(1e-5, 15.0, 20001)])
    f = n * 50.0 / speed
    wanted = np.trapezoid(4 * (0.2 * speed) ** 2 * 50.0 / speed / (1 + 70.8 * f**2) ** (5 / 6), n)
    assert np.sqrt(np.mean(squares)) == pytest.approx(np.sqrt(wanted), rel=0.04)


def test_wind_has_von_karmans_spectrum_and_davenports_coherence() -> None:
    source = WindLoads(speed=(20.0, 20.0), intensity=(0.15, 0.15), duration=600.0, bandwidth=8.0, places=5)
    load = source.draw(np.random.default_rng(0), 12.65)
    unit = 1.25 * 1.2 * source.diameter * 20.0  # N/m per m/s
    rate = 1 / load.sample_time
    for place in (0, 2):
        f, p = welch(load.force[:, place] / unit, rate, nperseg=2048)
        n = 50.0 * f / 20.0
        wanted = 4 * 3.0**2 * (50.0 / 20.0) / (1 + 70.8 * n**2) ** (5 / 6)
        band = (f > 0.2) & (f < 6.0)
        assert np.log(p[band] / wanted[band]).mean() == pytest.approx(0.0, abs=0.05)
    f, cross = csd(load.force[:, 1], load.force[:, 2], rate, nperseg=512)
    own = [welch(load.force[:, k], rate, nperseg=512)[1] for k in (1, 2)]
    band = (f > 0.3) & (f < 1.0)
    found = (cross.real / np.sqrt(own[0] * own[1]))[band]
    wanted = np.exp(-10.0 * f[band] * 12.65 / 4 / 20.0)
    assert np.mean(found - wanted) == pytest.approx(0.0, abs=0.04)
    # The rest of the variance lies below one over the duration and above the bandwidth.
    assert load.rms / unit == pytest.approx(3.0, rel=0.12)
