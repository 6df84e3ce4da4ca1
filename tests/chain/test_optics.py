from dataclasses import replace
from math import asin, atan, cos, hypot, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labcdp.chain import Context, Optics, Signal

PITCH_M = 3.45e-6


@pytest.mark.parametrize("f_number", [0.5, 1.4, 2.0, 8.0])
def test_axial_illuminance_is_the_integral_over_the_cone_of_light(optics: Optics, f_number: float) -> None:
    # A lens that obeys the sine condition fills the cone with half angle asin(1 / 2N) with the scene's luminance.
    edges = np.linspace(0, asin(1 / (2 * f_number)), 20_001)
    theta = (edges[:-1] + edges[1:]) / 2
    brute_force = np.sum(np.cos(theta) * 2 * pi * np.sin(theta) * np.diff(edges))
    lens = replace(optics, f_number=f_number, transmittance=1.0)
    assert lens.axial_illuminance_per_cd_m2 == pytest.approx(brute_force, rel=1e-7)


def test_illuminance_is_13_percent_above_the_tangent_form_at_f_1_4(optics: Optics) -> None:
    lens = replace(optics, f_number=1.4, transmittance=1.0)
    assert lens.axial_illuminance_per_cd_m2 / (pi / (1 + 4 * 1.4**2)) == pytest.approx(1.13, abs=0.005)


def test_transmittance_and_magnification(optics: Optics) -> None:
    lens = replace(optics, f_number=2.0, transmittance=0.9, magnification=0.25)
    assert lens.axial_illuminance_per_cd_m2 == pytest.approx(0.9 * pi / (4 * 2.5**2), rel=1e-15)


@pytest.mark.parametrize("magnification", [0.1, 1.0, 3.0])
def test_all_light_that_enters_the_lens_is_in_the_image(optics: Optics, magnification: float) -> None:
    # A small lamp (1 + 1/m) f in front of a thin lens of the diameter f / N: its flux L A pi r^2 / d^2 falls on A m^2.
    focal_length_m, f_number = 0.05, 100.0
    distance_m = focal_length_m * (1 + 1 / magnification)
    pupil_m2 = pi * (focal_length_m / f_number / 2) ** 2
    lens = replace(optics, f_number=f_number, transmittance=1.0, magnification=magnification)
    assert lens.axial_illuminance_per_cd_m2 == pytest.approx(pupil_m2 / distance_m**2 / magnification**2, rel=1e-12)


@pytest.mark.parametrize(("row", "column"), [(0, 0), (0, 1000), (300, 20), (601, 1001)])
def test_vignetting_is_cos_4_of_the_angle(optics: Optics, row: int, column: int) -> None:
    illuminance = optics.apply(np.full((602, 1002), 10.0), PITCH_M)
    radius_m = hypot(row - 300.5, column - 500.5) * PITCH_M
    expected = 10 * optics.axial_illuminance_per_cd_m2 * cos(atan(radius_m / 6e-3)) ** 4
    assert illuminance[row, column] == pytest.approx(expected, rel=1e-12)


def test_magnification_moves_the_image_away_from_the_lens(optics: Optics) -> None:
    lens = replace(optics, magnification=0.5)
    assert lens.vignetting(PITCH_M).focal_length_m == pytest.approx(9e-3)


@given(
    scene=arrays(np.float64, (5, 7), elements=st.floats(0, 1e5)),
    f_number=st.floats(0.5, 128),
    transmittance=st.floats(0.01, 1),
    magnification=st.floats(0, 10),
)
def test_invert_returns_the_luminance(
    scene: np.ndarray, f_number: float, transmittance: float, magnification: float
) -> None:
    lens = Optics(f_number, transmittance, 1e-3, magnification)
    signal = Signal(scene, "luminance", lambda luminance: luminance)
    behind = lens.process(signal, Context("D65", pixel_pitch_m=1e-4))
    np.testing.assert_allclose(behind.values, lens.apply(scene, 1e-4), rtol=1e-15)
    np.testing.assert_allclose(behind.luminance_cd_m2, scene, rtol=1e-12, atol=1e-300)
