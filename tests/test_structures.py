"""The shear frame: matrices, modes and what it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.structures import ShearFrame, dyke1996


def test_dyke_frame_has_the_published_matrices_and_modes() -> None:
    frame = dyke1996()
    # Dyke et al. 1996, in SI, with K22 not rounded.
    k = [[12e5, -6.84e5, 0], [-6.84e5, 13.68e5, -6.84e5], [0, -6.84e5, 6.84e5]]
    np.testing.assert_allclose(frame.stiffness_matrix, k, rtol=1e-14)
    np.testing.assert_allclose(frame.damping_matrix, [[175, -50, 0], [-50, 100, -50], [0, -50, 50]])
    np.testing.assert_allclose(frame.mass_matrix, 98.3 * np.eye(3))
    np.testing.assert_allclose(frame.frequencies, [5.44, 15.81, 23.63], rtol=3e-4)
    np.testing.assert_array_equal(frame.gamma, [-1, 0, 0])
    assert frame.weight == pytest.approx(3 * 98.3 * 9.80665)


def test_damping_ratios_agree_with_the_poles() -> None:
    frame = ShearFrame(np.array([120.0, 90, 70]), np.array([4e5, 5e5, 3e5]), np.array([80.0, 150, 20]))
    inverse = np.linalg.inv(frame.mass_matrix)
    a = np.block(
        [[np.zeros((3, 3)), np.eye(3)], [-inverse @ frame.stiffness_matrix, -inverse @ frame.damping_matrix]]
    )
    poles = np.linalg.eigvals(a)
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(np.abs(poles))]
    np.testing.assert_allclose(frame.damping_ratios, -poles.real / np.abs(poles), rtol=1e-3)
    np.testing.assert_allclose(frame.frequencies, np.abs(poles) / (2 * np.pi), rtol=1e-4)


def test_geometry_between_floors() -> None:
    frame = dyke1996(damper_between=(1, 3))
    x = np.array([[0.1, 0.3, 0.7], [0.0, -0.2, 0.2]])
    np.testing.assert_array_equal(frame.gamma, [1, 0, -1])
    np.testing.assert_allclose(frame.stroke(x), [0.6, 0.2])
    np.testing.assert_allclose(frame.drift(x), [[0.1, 0.2, 0.4], [0.0, -0.2, 0.4]])
    np.testing.assert_allclose(frame.displacement(frame.drift(x)), x)


def test_an_extending_damper_resists() -> None:
    # A dashpot between any two floors must only ever take energy from the frame.
    for floors in ((0, 1), (1, 0), (1, 2), (0, 3)):
        frame = dyke1996(damper_between=floors)
        v = np.array([0.3, -0.2, 0.5])
        force = 7.0 * frame.stroke(v)
        assert float(frame.gamma @ v * force) == pytest.approx(-7.0 * float(frame.stroke(v)) ** 2)


def test_dictionary_round_trip() -> None:
    frame = dyke1996(damper_between=(1, 2))
    data, between = frame.to_dict(), list(frame.damper_between)
    assert ShearFrame.from_dict(data, between) == frame
    assert hash(ShearFrame.from_dict(data, between)) == hash(frame)
    assert ShearFrame.from_dict(data, [0, 1]) != frame
    assert frame != data


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"stiffness": [5e5, 6e5]}, "stiffness has 2 values and mass has 3"),
        ({"mass": [98.0, 0.0, 98.0]}, "mass of storey 2 is 0; allowed: > 0"),
        ({"damping": [1.0, 2.0, -3.0]}, "damping of storey 3 is -3; allowed: >= 0"),
        ({"stiffness": [5e5, float("nan"), 1.0]}, "stiffness of storey 2 is nan"),
        ({"mass": ["a", 1.0, 1.0]}, "mass is"),
        ({"mass": 98.3}, "mass has shape ()"),
        ({"damper_between": (0, 4)}, "damper_between is (0, 4); allowed: two different floor numbers"),
        ({"damper_between": (1, 1)}, "damper_between is (1, 1)"),
        ({"damper_between": (0, 1.5)}, "damper_between is (0, 1.5)"),
        ({"damper_between": (0,)}, "damper_between is (0,)"),
    ],
)
def test_bad_frames_get_one_line(change: dict[str, Any], says: str) -> None:
    good: dict[str, Any] = {"mass": [98.0] * 3, "stiffness": [5e5] * 3, "damping": [50.0] * 3}
    with pytest.raises(InputError) as error:
        ShearFrame(**{**good, **change})
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_bad_entry_names_the_file() -> None:
    with pytest.raises(InputError, match=r"case\.json: structure has no stiffness_n_m"):
        ShearFrame.from_dict({"mass_kg": [1.0], "damping_n_s_m": [1.0]}, (0, 1), where="case.json")
    with pytest.raises(InputError, match=r"case\.json: structure: mass of storey 1 is -1"):
        ShearFrame.from_dict({**dyke1996().to_dict(), "mass_kg": [-1.0] * 3}, where="case.json")
    with pytest.raises(InputError, match=r"case\.json: structure is 3; allowed: an object with mass_kg"):
        ShearFrame.from_dict(3, where="case.json")  # type: ignore[arg-type]


def test_arrays_cannot_be_changed() -> None:
    source = np.array([98.3, 98.3, 98.3])
    frame = ShearFrame(source, np.full(3, 5e5), np.full(3, 50.0))
    source[0] = 1.0
    assert frame.mass[0] == 98.3
    with pytest.raises(ValueError, match="read-only"):
        frame.mass[0] = 1.0
