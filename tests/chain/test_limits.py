"""Each number of a chain's parts is taken up to its limits, and refused by name beyond them."""

import re
from dataclasses import replace
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


BOARD = Checkerboard(width=4, height=4, luminance_cd_m2=1.0, contrast=TINY, square_px=1)
EXPOSURE, OPTICS = ExposureSettings(0.01), Optics(2.0, 0.9, focal_length_m=0.006)
PARTS = (
    *(BOARD, Flat(3, 3, 1.0), Patch(0, 0, 1, 1, 1.0), PatchScene(3, 3, 1.0), StepChart(4, 4, (1.0,))),
    *(Windscreen(0.9), ThesisWindscreen(0.9), OPTICS, EXPOSURE, sensor(Sensor), sensor(ThesisSensor)),
    *(Hdr("normal"), ToneCurve()),
)
#: Lowest and highest value of each field, written here once more: a limit changed by mistake is noticed.
_FIELDS: dict[tuple[float, float], str] = {
    (0.0, 1e12): "luminance_cd_m2 background_cd_m2",
    (0.0, 1e9): "dark_current_e_s row_dark_current_e_s column_dark_current_e_s dsnu_e_s "
    "pixel_pattern_e_s row_pattern_e_s column_pattern_e_s",
    (0.0, 1e6): "read_noise_e dsnu_e column_dsnu_e row_dsnu_e",
    (0.0, 4095.0): "black_level_dn",
    (0.0, 1e3): "magnification",
    (0.0, 10.0): "glare_fraction",
    (0.0, 0.1): "prnu_rel",
    (0.0, 1e-2): "defocus_disc_m",
    (0.0, 1e-3): "blur_sigma_m",
    (TINY, 1e7): "full_well_e",
    (TINY, 99.0): "contrast",
    (TINY, 1.0): "transmittance quantum_efficiency",
    (TINY, 1e-3): "pixel_pitch_m",
    (-100.0, 200.0): "temperature_c reference_temperature_c",
    (-100.0, 100.0): "gain_db",
    (1e-9, 3600.0): "exposure_s",
    (1e-6, 1e6): "k_dn_per_e",
    (1e-4, 2.0): "focal_length_m",
    (0.5, 128.0): "f_number",
    (1.0, 100.0): "doubling_temperature_c",
    (100.0, 2e3): "diffraction_nm",
    (0, ENDLESS): "device_seed x y",
    (1, ENDLESS): "Patch.width Patch.height",
    (1, 20_000): "width height",
    (1, 64): "oversampling",
    (1, 48): "Hdr.bits isp_bits",
    (1, 16): "bits",
    (1, 3): "square_px",
}
LIMITS: dict[str, tuple[Any, Any]] = {name: pair for pair, names in _FIELDS.items() for name in names.split()}
#: Fields whose range their annotation does not state.
OTHERS = ((sensor(Sensor), "quantum_efficiency"), (sensor(Sensor), "black_level_dn"), (EXPOSURE, "exposure_s"))


def cases(kind: type) -> list[Any]:
    """Parts with their fields that have a range, as their annotations say."""
    ruled = [(part, name, rule) for part in PARTS for name, rule, _ in _rules(type(part)) if isinstance(rule, Number)]
    others: list[Any] = [(BOARD, "square_px", Whole("", 1)), *((part, name, Number("", 0)) for part, name in OTHERS)]
    found = [(part, name) for part, name, rule in [*ruled, *others] if type(rule) is kind]
    return [pytest.param(part, name, id=f"{type(part).__name__}.{name}") for part, name in found]


def limits(part: Any, name: str) -> tuple[Any, Any]:
    return LIMITS.get(f"{type(part).__name__}.{name}") or LIMITS[name]


def refused(part: Any, name: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"^{name} is .*: give [^\n]*\Z"):
        replace(part, **{name: value})


@pytest.mark.parametrize(("part", "name"), cases(Number))
def test_a_number_is_taken_within_its_limits_only(part: Any, name: str) -> None:
    least, most = limits(part, name)
    for value in (least, most):
        kept = getattr(replace(part, **{name: value}), name)
        assert kept in (value, (value,))
    beyond = (np.nextafter(least, -np.inf), np.nextafter(most, np.inf), -np.inf, np.inf, np.nan, 10**400)
    for value in (*beyond, "1", True, [[1.0]]):
        refused(part, name, value)


@pytest.mark.parametrize(("part", "name"), cases(Whole))
def test_a_whole_number_is_taken_within_its_limits_only(part: Any, name: str) -> None:
    least, most = limits(part, name)
    for value in {least, most} - {ENDLESS}:
        assert getattr(replace(part, **{name: value}), name) == value
    for value in (least - 1, *({most + 1} - {ENDLESS + 1}), float(least), 2.5, np.nan, "3", True, None):
        refused(part, name, value)


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
