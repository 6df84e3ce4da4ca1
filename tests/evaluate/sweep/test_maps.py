"""Maps of CDP: isolines, usable ranges and dips against closed forms and brute force."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from labcdp.core.errors import InputError
from labcdp.evaluate.sweep.maps.axes import CdpMap
from labcdp.evaluate.sweep.maps.dips import find_dips
from labcdp.evaluate.sweep.maps.map import analyse_map
from labcdp.evaluate.sweep.maps.ranges import isolines, usable_ranges, widest_range

LUMINANCE, CONTRAST = "scene.luminance_cd_m2", "scene.contrast"


def curve(luminance: ArrayLike, unit: str = "cd/m^2", method: str = "exact", **variables: ArrayLike) -> xr.Dataset:
    """Map over the luminance alone."""
    values = {name: (LUMINANCE, np.asarray(value, dtype=np.float64)) for name, value in variables.items()}
    dataset = xr.Dataset(values, coords={LUMINANCE: np.asarray(luminance, dtype=np.float64)})
    dataset[LUMINANCE].attrs["unit"] = unit
    dataset.attrs["method"] = method
    return dataset


def plane() -> xr.Dataset:
    """Map whose CDP is linear in both logarithms: 0.5 + 0.2 log10(L C), not clipped to 0 and 1."""
    luminance, contrast = np.geomspace(1, 1e3, 13), np.geomspace(0.01, 1, 9)
    cdp = 0.5 + 0.2 * (np.log10(contrast)[:, None] + np.log10(luminance))
    dataset = xr.Dataset({"cdp": ((CONTRAST, LUMINANCE), cdp)}, coords={LUMINANCE: luminance, CONTRAST: contrast})
    dataset[LUMINANCE].attrs["unit"] = "cd/m^2"
    return dataset


def test_isolines_of_a_plane_are_its_straight_lines() -> None:
    lines = isolines(CdpMap.of(plane()), LUMINANCE, CONTRAST, (0.5, 0.75))
    assert [(line.level, line.closed) for line in lines] == [(0.5, False), (0.75, False)]
    for line in lines:
        product = 10 ** ((line.level - 0.5) / 0.2)
        np.testing.assert_allclose(np.multiply(line.x, line.y), product, rtol=1e-12)
        assert max(line.x) == pytest.approx(min(1e3, product / 0.01), rel=1e-12)


def test_usable_range_of_a_plane_in_closed_form() -> None:
    ranges = usable_ranges(CdpMap.of(plane()), LUMINANCE, 0.77)
    assert len(ranges) == 9
    for one in ranges:
        low = 10**1.35 / one.at[CONTRAST]  # type: ignore[operator]
        assert len(one.intervals) == (low <= 1e3)
        for interval in one.intervals:
            ends = interval.low, interval.decades, interval.range_db
            assert ends == pytest.approx((low, np.log10(1e3 / low), 20 * np.log10(1e3 / low)), rel=1e-12)
            assert (interval.high, *(end.is_open for end in interval.ends)) == (1e3, False, True)
    widest = widest_range(ranges)
    assert widest is not None
    assert widest.at == {CONTRAST: 1.0}


@given(st.lists(st.floats(0, 1), min_size=2, max_size=12), st.floats(0.01, 1))
def test_usable_range_holds_exactly_the_points_that_are_high_enough(cdp: list[float], level: float) -> None:
    luminance = np.arange(1.0, len(cdp) + 1)
    (one,) = usable_ranges(CdpMap.of(curve(luminance, cdp=cdp)), LUMINANCE, level)
    inside = [any(i.low <= place <= i.high for i in one.intervals) for place in luminance]
    assert inside == [value >= level for value in cdp]
    for end in (end for interval in one.intervals for end in interval.ends if not end.is_open):
        low, high = np.interp(end.bracket, luminance, cdp)
        assert min(low, high) < level <= max(low, high)
        assert end.resolved == (abs(high - low) <= 0.2)
        assert end.bracket[0] <= end.place <= end.bracket[1]
        found = level if end.resolved else max(low, high)
        assert np.interp(end.place, luminance, cdp) == pytest.approx(found, abs=1e-9)


def sawtooth(luminance: NDArray[np.float64], place: float, ratio: float) -> NDArray[np.float64]:
    """SNR by shot noise, sqrt(L), that is divided by a ratio beyond a luminance of change."""
    return np.sqrt(luminance) / np.where(luminance > place, ratio, 1)


def test_dip_of_a_change_of_exposure_in_closed_form() -> None:
    luminance = 2.0 ** np.arange(0, 15)
    cdp = np.linspace(0.5, 0.99, luminance.size)
    cdp[7] = 0.3
    dataset = curve(luminance, cdp=cdp, snr_dark=sawtooth(luminance, 64.0, 2.0))
    (dip,) = find_dips(CdpMap.of(dataset), LUMINANCE, expected=[5.0, 70.0])
    # sqrt(128) / 2 against sqrt(64); half of sqrt(256) is 8 again.
    assert (dip.start, dip.position, dip.recovery, dip.expected) == (64.0, 128.0, pytest.approx(256.0), 70.0)
    assert dip.depth_ratio == pytest.approx(np.sqrt(2), rel=1e-12)
    assert dip.depth_db == pytest.approx(10 * np.log10(2), rel=1e-12)
    assert (dip.highest, dip.lowest_cdp, dip.lowest_cdp_at) == (8.0, 0.3, 128.0)


def test_the_final_saturation_is_not_a_dip_unless_a_change_of_exposure_explains_it() -> None:
    luminance = 2.0 ** np.arange(0, 8)
    dataset = curve(luminance, cdp=np.ones(8), snr_dark=sawtooth(luminance, 64.0, 8.0))
    assert find_dips(CdpMap.of(dataset), LUMINANCE) == ()
    (dip,) = find_dips(CdpMap.of(dataset), LUMINANCE, expected=[70.0])
    assert (dip.start, dip.position, dip.expected) == (64.0, 128.0, 70.0)
    assert np.isnan(dip.recovery)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("fall", [1.0, 3.0])
def test_noise_of_a_simulated_sweep_makes_no_dip_and_hides_none(stated: bool, fall: float) -> None:
    """SNR of 512 normal pixels with shot noise and read noise of 1.5, and its standard error, as a sweep gives them."""
    luminance = np.geomspace(0.02, 2e3, 400)
    spread = np.sqrt(luminance + 1.5**2) * np.where(luminance > 100, fall, 1)
    for seed in range(15):
        pixels = luminance[:, None] + spread[:, None] * np.random.default_rng(seed).normal(size=(400, 512))
        snr = pixels.mean(axis=1) / pixels.std(axis=1, ddof=1)
        errors = {"snr_dark_standard_error": np.sqrt((1 + snr**2 / 2) / 512)} if stated else {}
        dataset = curve(luminance, method="simulated", cdp=np.linspace(0.1, 1, 400), snr_dark=snr, **errors)
        expected = [100.0] if fall > 1 else []
        assert [dip.expected for dip in find_dips(CdpMap.of(dataset), LUMINANCE, expected=expected)] == expected


def test_faults_of_a_map_are_named() -> None:
    for damaged, message in (
        (plane().rename(cdp="csnr"), r"has no variable cdp, only \['csnr'\]: give a map"),
        (plane().assign_coords({CONTRAST: [0.1] * 9}), r"axis scene\.contrast are not finite or not distinct"),
    ):
        with pytest.raises(InputError, match=message):
            analyse_map(damaged)
