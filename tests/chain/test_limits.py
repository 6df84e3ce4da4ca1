"""Each number of a chain's parts is taken up to the limits of its annotation, and refused by name beyond them."""

import re
from dataclasses import replace
from math import inf, nan
from typing import Any

import numpy as np
import pytest

from labcdp.chain import Checkerboard, Flat, Patch, PatchScene, StepChart
from labcdp.chain.hdr import Hdr
from labcdp.chain.isp import ToneCurve
from labcdp.chain.optics import Optics, Windscreen
from labcdp.chain.parameters import Number, Whole, _rules
from labcdp.chain.sensor import Sensor
from labcdp.chain.signal import ExposureSettings
from labcdp.chain.thesis import ThesisSensor, ThesisWindscreen
from labcdp.core.errors import InputError

BOARD = Checkerboard(width=4, height=4, luminance_cd_m2=1.0, contrast=1e-300, square_px=1)
EXPOSURE, OPTICS = ExposureSettings(0.01), Optics(2.0, 0.9, focal_length_m=0.006)
CONVERTER = {"full_well_e": 1e4, "k_dn_per_e": 0.1, "bits": 12, "quantum_efficiency": 0.5, "dark_current_e_s": 1.0}
SIZE = {"pixel_pitch_m": 5e-6, "width": 3, "height": 2}
SENSOR = Sensor(**SIZE, **CONVERTER, read_noise_e=2.0)
THESIS = {"row_dark_current_e_s": 1.0, "column_dark_current_e_s": 1.0, "doubling_temperature_c": 8.0}
PARTS = (
    *(BOARD, Flat(3, 3, 1.0), Patch(0, 0, 1, 1, 1.0), PatchScene(3, 3, 1.0), StepChart(4, 4, (1.0,))),
    *(Windscreen(0.9), ThesisWindscreen(0.9), OPTICS, EXPOSURE, SENSOR, ThesisSensor(**SIZE, **CONVERTER, **THESIS)),
    *(Hdr("normal"), ToneCurve()),
)
#: Fields whose range depends on others, so that no annotation states it.
OTHERS = (
    (SENSOR, "quantum_efficiency", Number("", 0, 1, above=True)),
    (SENSOR, "black_level_dn", Number("", 0, 4095)),
    (EXPOSURE, "exposure_s", Number("", 1e-7, 100)),
    (BOARD, "square_px", Number("", 1, 3)),
)
RULED = [(part, name, rule) for part in PARTS for name, rule, _ in _rules(type(part)) if isinstance(rule, Number)]
CASES = [pytest.param(*case, id=f"{type(case[0]).__name__}.{case[1]}") for case in (*RULED, *OTHERS)]


@pytest.mark.parametrize(("part", "name", "rule"), CASES)
def test_a_number_is_taken_within_its_limits_only(part: Any, name: str, rule: Number) -> None:
    whole = isinstance(rule, Whole) or name == "square_px"
    step: Any = (lambda value, side: value + side) if whole else (lambda value, side: np.nextafter(value, side * inf))
    number = int if whole else float
    least = step(0.0, 1) if rule.above else number(rule.low)
    inside, outside = [least], [step(least, -1), -inf, nan, "1", True, [[1.0]]]
    if rule.high < inf:
        inside, outside = [least, number(rule.high)], [*outside, step(number(rule.high), 1), inf, 10**400]
    if isinstance(rule, Whole):
        outside += [2.5, float(least)]
    for value in inside:
        assert getattr(replace(part, **{name: value}), name) in (value, (value,))
    for value in outside:
        with pytest.raises(InputError, match=rf"^{name} is .*: give [^\n]*\Z"):
            replace(part, **{name: value})


@pytest.mark.parametrize(
    ("part", "name", "slip"),
    [
        (BOARD, "contrast", 100.0),  # percent
        *[(OPTICS, "focal_length_m", millimetres) for millimetres in (1.8, 6, 50)],
        *[(OPTICS, name, 5e-3) for name in ("blur_sigma_m", "defocus_disc_m")],  # mm
        *[(OPTICS, "diffraction_nm", other) for other in (0.55, 550e-9)],
        (OPTICS, "mtf", [(0, 1.0), (60_000, 0.5)]),  # per m
        (Windscreen(0.9), "glare_fraction", 5.0),  # percent
        *[(EXPOSURE, "exposure_s", microseconds) for microseconds in (500, 5000)],
        *[(EXPOSURE, "gain_db", iso_speed) for iso_speed in (100, 400)],
        (EXPOSURE, "temperature_c", 298.0),  # K
        *[(SENSOR, "pixel_pitch_m", other) for other in (3.45, 3.45e-3, 3.45e-9)],
        (SENSOR, "quantum_efficiency", 57),
        *[(SENSOR, "quantum_efficiency", [(0.4 * nm, 0.3), (0.7 * nm, 0.3)]) for nm in (1, 1e-6)],
        *[(SENSOR, "full_well_e", kilo) for kilo in (7, 10.7)],
        (SENSOR, "prnu_rel", 0.7),  # percent
    ],
)
def test_a_value_in_another_unit_is_refused(part: Any, name: str, slip: Any) -> None:
    with pytest.raises(InputError, match=f"^{name} "):
        replace(part, **{name: slip})


@pytest.mark.parametrize(
    ("part", "changes", "message"),
    [
        (SENSOR, {"dsnu_e_s": 1.0, "dark_current_e_s": 0.0}, "dsnu_e_s is 1.0 e⁻/s, but dark_current_e_s is 0"),
        (EXPOSURE, {"exposure_s": []}, "exposure_s is empty: give one exposure time in s, or several"),
        (EXPOSURE, {"exposure_s": [1, 0.5, 1.0]}, "exposure_s has the times [1, 0.5, 1.0] s, of which two are equal"),
        (
            BOARD,
            {"contrast": 99.0, "luminance_cd_m2": 1e11},
            "contrast is 99.0: the bright squares would have 1e+13 cd",
        ),
        (BOARD, {"square_px": 1.3, "oversampling": 4}, "square_px is 1.3: give a multiple of 1/4 pixels"),
        (BOARD, {"square_px": 4}, "square_px is 4, and a scene of 4 x 4 pixels then is one square"),
        *[
            (OPTICS, {"mtf": mtf}, f"mtf is {mtf}: give pairs of line pairs per mm")
            for mtf in ([[0.0, 1.0], [50.0, 1.2]], [[1.0, 1.0], [50.0, 0.5]], [[0.0, 0.5]])
        ],
        *[
            (StepChart(4, 4, (1.0,)), {"luminances_cd_m2": values}, "luminances_cd_m2 is ")
            for values in ([], [1] * 5, 3.0, "123", [1, -2], [nan])
        ],
        (Patch(0, 0, 1, 1, 1.0), {"width": 0}, "width is 0: give a number of at least 1 pixels"),
        (PatchScene(10, 8, 1.0), {"patches": (Patch(6, 2, 5, 2, 3.0),)}, "a patch spans x 6 to 11, y 2 to 4, but the"),
    ],
)
def test_numbers_that_do_not_go_together_are_refused(part: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match="^" + re.escape(message)):
        replace(part, **changes)
