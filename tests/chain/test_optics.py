from dataclasses import replace
from math import asin, atan, cos, hypot, pi

import numpy as np
import pytest

from labcdp.chain import Optics

PITCH_M = 3.45e-6


@pytest.mark.parametrize("f_number", [0.5, 1.4, 2.0, 8.0])
def test_axial_illuminance_is_the_integral_over_the_cone_of_light(optics: Optics, f_number: float) -> None:
    # A lens that obeys the sine condition fills the cone with half angle asin(1 / 2N) with the scene's luminance.
    edges = np.linspace(0, asin(1 / (2 * f_number)), 20_001)
    theta = (edges[:-1] + edges[1:]) / 2
    brute_force = np.sum(np.cos(theta) * 2 * pi * np.sin(theta) * np.diff(edges))
    lens = replace(optics, f_number=f_number, transmittance=1.0)
    assert lens.axial_illuminance_per_cd_m2 == pytest.approx(brute_force, rel=1e-7)


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
