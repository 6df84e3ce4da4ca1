"""Each number of a chain's parts is taken up to the limits of its annotation, and refused by name beyond them."""

from dataclasses import replace
from math import inf, nan

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
STEPS = StepChart(4, 4, (1.0,))
EXPOSURE, OPTICS = ExposureSettings(0.01), Optics(2.0, 0.9, focal_length_m=0.006)
CONVERTER = {"full_well_e": 1e4, "k_dn_per_e": 0.1, "bits": 12, "quantum_efficiency": 0.5, "dark_current_e_s": 1.0}
SIZE = {"pixel_pitch_m": 5e-6, "width": 3, "height": 2}
SENSOR = Sensor(**SIZE, **CONVERTER, read_noise_e=2.0)
THESIS = {"row_dark_current_e_s": 1.0, "column_dark_current_e_s": 1.0, "doubling_temperature_c": 8.0}
PARTS = (
    *(BOARD, Flat(3, 3, 1.0), Patch(0, 0, 1, 1, 1.0), PatchScene(3, 3, 1.0), STEPS),
    *(Windscreen(0.9), ThesisWindscreen(0.9), OPTICS, EXPOSURE, SENSOR, ThesisSensor(**SIZE, **CONVERTER, **THESIS)),
    *(Hdr("normal"), ToneCurve()),
)
CASES = [(part, name, rule) for part in PARTS for name, rule, _ in _rules(type(part)) if isinstance(rule, Number)]


@pytest.mark.parametrize(("part", "name", "rule"), CASES)
def test_a_number_is_taken_within_its_limits_only(part, name, rule):
    number, step = float, lambda value, side: np.nextafter(value, side * inf)
    if isinstance(rule, Whole):
        number, step = int, lambda value, side: value + side
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


#: Values in percent, in mm, nm or m, in line pairs per m, in us, as an ISO speed, in K and in thousands.
SLIPS = [
    *((BOARD, "contrast", 100.0), (Windscreen(0.9), "glare_fraction", 5.0), (SENSOR, "prnu_rel", 0.7)),
    *((OPTICS, name, 5e-3) for name in ("blur_sigma_m", "defocus_disc_m")),
    *((OPTICS, "focal_length_m", millimetres) for millimetres in (1.8, 6, 50)),
    *((OPTICS, "diffraction_nm", other) for other in (0.55, 550e-9)),
    (OPTICS, "mtf", [(0, 1.0), (60_000, 0.5)]),
    *((EXPOSURE, name, value) for name, value in (("exposure_s", 500), ("gain_db", 100), ("temperature_c", 298.0))),
    *((SENSOR, "pixel_pitch_m", other) for other in (3.45, 3.45e-3, 3.45e-9)),
    *((SENSOR, "quantum_efficiency", other) for other in (57, [(0.4, 0.3), (0.7, 0.3)], [(4e-7, 0.3), (7e-7, 0.3)])),
    *((SENSOR, "full_well_e", kilo) for kilo in (7, 10.7)),
]


@pytest.mark.parametrize(("part", "name", "slip"), SLIPS)
def test_a_value_in_another_unit_is_refused(part, name, slip):
    with pytest.raises(InputError, match=f"^{name} "):
        replace(part, **{name: slip})


@pytest.mark.parametrize(
    ("part", "changes"),
    [
        (SENSOR, {"dsnu_e_s": 1.0, "dark_current_e_s": 0.0}),
        (EXPOSURE, {"exposure_s": [1, 0.5, 1.0]}),
        (BOARD, {"contrast": 99.0, "luminance_cd_m2": 1e11}),
        *((BOARD, changes) for changes in ({"square_px": 1.3, "oversampling": 4}, {"square_px": 4})),
        *((OPTICS, {"mtf": mtf}) for mtf in ([[0.0, 1.0], [50.0, 4.2]], [[1.0, 1.0], [50.0, 0.5]], [[0.0, 0.5]])),
        *((STEPS, {"luminances_cd_m2": values}) for values in ([], [1] * 5, [1, -2], [nan])),
    ],
)
def test_numbers_that_do_not_go_together_are_refused(part, changes):
    with pytest.raises(InputError, match=f"^{next(iter(changes))} (is|has) "):
        replace(part, **changes)
