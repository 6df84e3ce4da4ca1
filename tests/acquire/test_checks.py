"""Each check on both sides of its limit, and that it names what it found."""

from dataclasses import replace

import pytest

from labcdp.acquire.checks import check_darkness, check_flicker, check_levels, check_meter_drift, check_scatter
from labcdp.acquire.live import PatchNumbers

NUMBERS = PatchNumbers(
    patch="P01", exposure_s=0.01, frames=10, pixels=900, mean_dn=1064.0, black_dn=64.0, saturation_dn=4095.0,
    saturated_share=0.0, temporal_noise_dn=10.0, flicker_dn=0.3, drift_dn=0.0,
)  # fmt: skip
FULL = replace(NUMBERS, exposure_s=1.0, mean_dn=4095.0, saturated_share=1.0)


@pytest.mark.parametrize(
    ("seen", "found"),
    [
        ([NUMBERS, FULL], []),
        # Named with the best of its exposures.
        ([replace(NUMBERS, saturated_share=0.25), FULL, replace(NUMBERS, patch="P02")], [("saturation", 0.25, 0.001)]),
        # Within three times the noise of a pixel.
        ([replace(NUMBERS, mean_dn=64 + 30.1), FULL], []),
        ([replace(NUMBERS, mean_dn=64 + 29.9), FULL], [("darkness", pytest.approx(29.9), 30)]),
    ],
)
def test_a_patch_needs_an_exposure_between_black_and_saturation(seen, found):
    assert [(f.check, f.value, f.limit) for f in check_levels(seen)] == found


@pytest.mark.parametrize(("dark_dn", "found"), [(563.0, 0), (565.0, 1)])
def test_dark_frames_half_as_bright_as_the_light_ones_were_taken_without_the_cap(dark_dn, found):
    # A black level of 64 DN, by two exposures.
    light = [NUMBERS, replace(NUMBERS, patch="P02", mean_dn=164.0), replace(NUMBERS, exposure_s=0.005, mean_dn=564.0)]
    # The darker patch says nothing: dark current may well be half of its signal.
    findings = check_darkness([replace(NUMBERS, mean_dn=dark_dn), replace(light[1], mean_dn=160.0)], light)
    assert len(findings) == found


@pytest.mark.parametrize(
    ("flicker_dn", "noise_dn", "found"),
    # The last: 2 % flicker, but 700 / sqrt(900) DN is what such noise does to the mean.
    [(0.3, 10.0, 0), (9.0, 10.0, 0), (20.0, 10.0, 1), (20.0, 700.0, 0)],
)
def test_flicker_counts_above_the_limit_and_above_the_noise(flicker_dn, noise_dn, found):
    numbers = [replace(NUMBERS, flicker_dn=flicker_dn, temporal_noise_dn=noise_dn), FULL]
    assert len(check_flicker(numbers, 0.01)) == found


@pytest.mark.parametrize(
    ("before", "after", "repeatability_rel", "change"),
    [
        ((100.0, 100.2), (97.0, 97.2), 0.002, 97.1 / 100.1 - 1),
        ((100.0,), (99.1,), 0.002, None),
        # Half width 0.02 of the last digit: 0.0115 each, 3 sigma of the difference are 0.049 of 0.5.
        ((0.50,), (0.54,), 0.0, None),
        ((0.50,), (0.56,), 0.0, 0.12),
    ],
)
def test_a_drift_beyond_its_limit_and_the_readings_uncertainty_is_found(
    new_reading, before, after, repeatability_rel, change
):
    own = {"repeatability_rel": repeatability_rel, "digits_half_width": 0.02}
    series = ([new_reading(value, **own) for value in values] for values in (before, after))
    assert [f.value for f in check_meter_drift("P01", *series, 0.01)] == (
        [] if change is None else [pytest.approx(change)]
    )


@pytest.mark.parametrize(
    ("values", "repeatability_rel", "scatter"),
    [
        ((100.0, 104.0, 96.0), 0.002, 0.04),
        ((100.0, 104.0, 96.0), 0.02, None),
        ((100.0, 100.5), 0.002, None),
        ((100.0,), 0.002, None),
    ],
)
def test_scatter_beyond_its_limit_and_the_data_sheet_is_found(new_reading, values, repeatability_rel, scatter):
    readings = [new_reading(value, repeatability_rel=repeatability_rel) for value in values]
    assert [f.value for f in check_scatter("P01", readings, 0.01)] == (
        [] if scatter is None else [pytest.approx(scatter)]
    )
