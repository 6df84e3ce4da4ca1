from dataclasses import replace
from datetime import UTC, datetime

import pytest

from labcdp.acquire.checks import check_darkness, check_flicker, check_levels, check_meter_drift, check_scatter
from labcdp.acquire.live import PatchNumbers
from labcdp.core.reading import MeterIdentity, Reading

NUMBERS = PatchNumbers(
    patch="P01",
    exposure_s=0.01,
    frames=10,
    pixels=900,
    mean_dn=1064.0,
    black_dn=64.0,
    saturation_dn=4095.0,
    saturated_share=0.0,
    temporal_noise_dn=10.0,
    flicker_dn=0.3,
    drift_dn=0.0,
)


def reading(value, unit="cd/m2", repeatability_rel=0.002, resolution=0.01):
    return Reading(
        value=value,
        unit=unit,
        resolution=resolution,
        scale_half_width_rel=0.02,
        digits_half_width=2 * resolution,
        repeatability_rel=repeatability_rel,
        peak=False,
        correction="preset",
        held=False,
        meter=MeterIdentity("LS-110", "1"),
        timestamp=datetime(2026, 3, 2, tzinfo=UTC),
        raw=f"OK,{value}",
    )


def readings(*values, **fields):
    return [reading(value, **fields) for value in values]


def test_good_frames_have_no_findings():
    numbers = [NUMBERS, replace(NUMBERS, exposure_s=0.04, mean_dn=4095.0, saturated_share=1.0)]
    assert check_levels(numbers) == []
    assert check_flicker(numbers, 0.01) == []


def test_a_patch_saturated_at_every_exposure_is_named_with_the_best_of_them():
    numbers = [replace(NUMBERS, exposure_s=t, saturated_share=s) for t, s in ((0.01, 0.25), (0.04, 1.0))]
    (finding,) = check_levels([*numbers, replace(NUMBERS, patch="P02")])
    assert (finding.check, finding.value, finding.limit) == ("saturation", 0.25, 0.001)
    assert str(finding) == (
        "patch 'P01' is saturated at every exposure, 25.0% of it even at 0.01 s: add a shorter exposure, or dim the "
        "light"
    )


@pytest.mark.parametrize(("dark_dn", "found"), [(563.0, False), (565.0, True)])
def test_dark_frames_half_as_bright_as_the_light_ones_were_taken_without_the_cap(dark_dn, found):
    # A black level of 64 DN, by two exposures.
    light = [NUMBERS, replace(NUMBERS, patch="P02", mean_dn=164.0), replace(NUMBERS, exposure_s=0.005, mean_dn=564.0)]
    # The darker patch says nothing: dark current may well be half of its signal.
    dark = [replace(NUMBERS, mean_dn=dark_dn), replace(NUMBERS, patch="P02", mean_dn=160.0)]
    findings = check_darkness(dark, light)
    assert [f.check for f in findings] == (["light in the dark"] if found else [])
    if found:
        assert str(findings[0]) == (
            "in the dark frames at 0.01 s patch 'P01' is 50% as bright as in the light frames: cover the lens"
        )
        assert not findings[0].passing


@pytest.mark.parametrize(("signal_dn", "found"), [(29.9, ["darkness"]), (30.1, [])])
def test_a_patch_within_three_times_its_noise_is_too_dark(signal_dn, found):
    numbers = [replace(NUMBERS, mean_dn=64.0 + signal_dn), replace(NUMBERS, exposure_s=1.0, saturated_share=0.5)]
    assert [finding.check for finding in check_levels(numbers)] == found


@pytest.mark.parametrize(
    ("flicker_dn", "noise_dn", "found"),
    [
        (20.0, 10.0, True),
        (9.0, 10.0, False),
        # 2 % flicker, but 700 / sqrt(900) DN is what such noise does to the mean.
        (20.0, 700.0, False),
    ],
)
def test_flicker_counts_above_the_limit_and_above_the_noise(flicker_dn, noise_dn, found):
    numbers = [replace(NUMBERS, flicker_dn=flicker_dn, temporal_noise_dn=noise_dn)]
    assert bool(check_flicker(numbers, 0.01)) is found


def test_a_meter_that_drifted_is_reported_with_both_values():
    (finding,) = check_meter_drift("P01", readings(100.0, 100.2), readings(97.0, 97.2), 0.01)
    assert finding.check == "meter drift"
    assert finding.value == pytest.approx(97.1 / 100.1 - 1)
    assert "went from 100.1 to 97.1 cd/m^2 (-3.0%)" in str(finding)


def test_drift_within_limit_or_within_the_readings_own_uncertainty_is_none():
    assert check_meter_drift("P01", readings(100.0), readings(99.1), 0.01) == []
    # Half width 0.02 of the last digit: 0.0115 each, 3 sigma of the difference are 0.049 of 0.5.
    assert (
        check_meter_drift("P01", readings(0.50, repeatability_rel=0.0), readings(0.54, repeatability_rel=0.0), 0.01)
        == []
    )
    assert check_meter_drift("P01", readings(0.50, repeatability_rel=0.0), readings(0.56, repeatability_rel=0.0), 0.01)


def test_scatter_beyond_limit_and_data_sheet_is_reported():
    (finding,) = check_scatter("P01", readings(100.0, 104.0, 96.0), 0.01)
    assert finding.value == pytest.approx(0.04)
    assert str(finding).startswith("the 3 readings of patch 'P01' scatter by 4.0%: is the meter pointed at")
    assert check_scatter("P01", readings(100.0, 100.5), 0.01) == []
    assert check_scatter("P01", readings(100.0, 104.0, 96.0, repeatability_rel=0.02), 0.01) == []
    assert check_scatter("P01", readings(100.0), 0.01) == []
