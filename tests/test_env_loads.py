"""Loads that environments draw: ranges, spectra, seeds, files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from scipy.signal import csd, welch

from mrdamp.envs import AmbientLoads, CableLoad, MixedMotions, RecordedMotions, SyntheticMotions, WindLoads
from mrdamp.envs.loads import cut
from mrdamp.motions import GroundMotion, embedded_motion
from refusals import refuses


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


def test_mixtures_draw_from_each_by_weight() -> None:
    a = RecordedMotions([GroundMotion("a", 0.01, np.ones(5))])
    b = RecordedMotions([GroundMotion("b", 0.01, np.ones(5))])
    rng = np.random.default_rng(0)
    names = [MixedMotions([a, b], [1.0, 3.0]).draw(rng).name for _ in range(400)]
    assert names.count("b") == pytest.approx(300, abs=30)


def test_a_cut_motion_is_the_start_of_it() -> None:
    motion = embedded_motion()
    short = cut(motion, 2.0)
    assert short.duration == pytest.approx(2.0)
    np.testing.assert_array_equal(short.acceleration, motion.acceleration[: short.n])
    assert cut(motion, None) is motion


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


MOTION = embedded_motion()
HALF = np.array([0.5])


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        (SyntheticMotions, {"pga": (0.0, 1.0)}),
        (SyntheticMotions, {"rise": (2.0, 1.0)}),
        (SyntheticMotions, {"spectrum": "white"}),
        (RecordedMotions, {"motions": []}),
        (RecordedMotions, {"motions": ["nowhere.csv"]}),
        (RecordedMotions, {"motions": [MOTION], "amplitude": (-1.0, 1.0)}),
        (MixedMotions, {"sources": []}),
        (MixedMotions, {"sources": [SyntheticMotions()], "weights": [-1.0]}),
        (AmbientLoads, {"rms": (0.0, 1.0)}),
        (AmbientLoads, {"shape": "point"}),
        (AmbientLoads, {"bandwidth": -1.0}),
        (WindLoads, {"speed": (5.0, 1.0)}),
        (WindLoads, {"diameter": 0.0}),
        (WindLoads, {"places": 0}),
        (WindLoads, {"duration": 0.0}),
        (CableLoad, {"name": "x", "sample_time": 0.0, "places": HALF, "force": np.ones((5, 1))}),
        (CableLoad, {"name": "x", "sample_time": 0.1, "places": -HALF, "force": np.ones((5, 1))}),
        (CableLoad, {"name": "x", "sample_time": 0.1, "places": HALF, "force": np.full((5, 1), np.nan)}),
        (CableLoad, {"name": "x", "sample_time": 0.1, "places": HALF, "force": np.ones((5, 2))}),
    ],
)
def test_loads_that_cannot_be(kind: Callable[..., object], arguments: dict[str, Any]) -> None:
    refuses(lambda: kind(**arguments), ".")
