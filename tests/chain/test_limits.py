"""Each number of a chain's parts is taken up to its limits, and refused by name beyond them."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from labcdp.chain import Checkerboard, Patch, PatchScene, StepChart
from labcdp.chain.optics import Optics, Windscreen
from labcdp.chain.sensor import Sensor
from labcdp.chain.signal import ExposureSettings
from labcdp.chain.thesis import ThesisSensor
from labcdp.core.errors import InputError

TINY = np.nextafter(0.0, 1.0)
ENDLESS = 10**30


def sensor(kind: Any) -> Any:
    """One of either kind; both have these in common."""
    own = (
        {"read_noise_e": 2.0}
        if kind is Sensor
        else {"row_dark_current_e_s": 1.0, "column_dark_current_e_s": 1.0, "doubling_temperature_c": 8.0}
    )
    size = {"pixel_pitch_m": 5e-6, "width": 3, "height": 2}
    converter = {"full_well_e": 1e4, "k_dn_per_e": 0.1, "bits": 12}
    return kind(**size, **converter, **own, quantum_efficiency=0.5, dark_current_e_s=1.0)


PATCH = Patch(0, 0, 1, 1, 1.0)
BOARD = Checkerboard(width=4, height=4, luminance_cd_m2=1.0, contrast=1.0, square_px=1)
EXPOSURE, OPTICS = ExposureSettings(0.01), Optics(2.0, 0.9, focal_length_m=0.006)
NUMBERS: list[tuple[Any, str, float, float]] = [
    *((sensor(kind), "quantum_efficiency", TINY, 1.0) for kind in (Sensor, ThesisSensor)),
    *((sensor(kind), "dark_current_e_s", 0.0, 1e9) for kind in (Sensor, ThesisSensor)),
    *((sensor(Sensor), "black_level_dn", 0.0, 4095.0), (sensor(Sensor), "prnu_rel", 0.0, 0.1)),
    *((EXPOSURE, "exposure_s", 1e-9, 3600.0), (EXPOSURE, "gain_db", -100.0, 100.0)),
    *((OPTICS, "f_number", 0.5, 128.0), (OPTICS, "focal_length_m", 1e-4, 2.0), (OPTICS, "diffraction_nm", 100.0, 2e3)),
    *((Windscreen(0.9), "glare_fraction", 0.0, 10.0), (PATCH, "luminance_cd_m2", 0.0, 1e12)),
    *((PatchScene(3, 3, 1.0), "background_cd_m2", 0.0, 1e12), (BOARD, "contrast", TINY, 99.0)),
]
WHOLE: list[tuple[Any, str, int, int]] = [
    *((sensor(kind), "bits", 1, 16) for kind in (Sensor, ThesisSensor)),
    *((sensor(Sensor), "width", 1, 20_000), (sensor(Sensor), "device_seed", 0, ENDLESS)),
    *((PATCH, "x", 0, ENDLESS), (BOARD, "square_px", 1, 3), (BOARD, "oversampling", 1, 64)),
]


@pytest.mark.parametrize(("part", "name", "least", "most"), NUMBERS)
def test_a_number_is_taken_within_its_limits_only(part: Any, name: str, least: float, most: float) -> None:
    for value in (least, most):
        kept = getattr(replace(part, **{name: value}), name)
        assert kept in (value, (value,))
    beyond = (np.nextafter(least, -np.inf), np.nextafter(most, np.inf), -np.inf, np.inf, np.nan, 10**400)
    for value in (*beyond, "1", True, [[1.0]]):
        with pytest.raises(InputError, match=rf"^{name} is .*: give "):
            replace(part, **{name: value})


@pytest.mark.parametrize(("part", "name", "least", "most"), WHOLE)
def test_a_whole_number_is_taken_within_its_limits_only(part: Any, name: str, least: int, most: int) -> None:
    for value in {least, most} - {ENDLESS}:
        assert getattr(replace(part, **{name: value}), name) == value
    for value in (least - 1, *({most + 1} - {ENDLESS + 1}), float(least), 2.5, np.nan, "3", True, None):
        with pytest.raises(InputError, match=rf"^{name} is .*: give "):
            replace(part, **{name: value})


def test_luminances_of_a_step_chart_are_a_list_of_some() -> None:
    for values in ([], [1] * 5, 3.0, "123", [1, -2], [np.nan]):
        with pytest.raises(InputError, match=r"^luminances_cd_m2 is "):
            StepChart(width=4, height=4, luminances_cd_m2=values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("part", "changes", "message"),
    [
        (sensor(Sensor), {"dsnu_e_s": 1.0, "dark_current_e_s": 0.0}, "dsnu_e_s is 1.0 e-/s, but dark_current_e_s is 0"),
        (EXPOSURE, {"exposure_s": []}, "exposure_s is empty: give one exposure time in s, or several"),
        (EXPOSURE, {"exposure_s": [1, 0.5, 1.0]}, "exposure_s has the times [1, 0.5, 1.0] s, of which two are equal"),
        (BOARD, {"contrast": 99.0, "luminance_cd_m2": 1e11}, "the bright squares would have 1e+13 cd/m^2"),
        (BOARD, {"square_px": 1.3, "oversampling": 4}, "square_px is 1.3: give a multiple of 1/4 pixels"),
        (OPTICS, {"mtf": [[0, 1], [50, 1.2]]}, "mtf is [[0.0, 1.0], [50.0, 1.2]]: give pairs of line pairs per mm"),
        (OPTICS, {"mtf": [[1, 1], [50, 0.5]]}, "mtf is [[1.0, 1.0], [50.0, 0.5]]: give pairs of line pairs per mm"),
        (OPTICS, {"mtf": "flat"}, "mtf is 'flat': give pairs of line pairs per mm"),
        (BOARD, {"square_px": 4}, "square_px is 4, and a scene of 4 x 4 pixels then is one square"),
    ],
)
def test_numbers_that_do_not_go_together_are_refused(part: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        replace(part, **changes)
