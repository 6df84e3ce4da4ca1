"""Maps of CDP: isolines, usable ranges and dips against closed forms and brute force."""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from labcdp.core.errors import InputError
from labcdp.evaluate.sweep.maps.axes import map_axis, map_layout
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


def test_the_luminance_is_across_and_an_axis_of_one_value_is_none() -> None:
    dataset = plane().expand_dims({"exposure.method": ["short", "long"], "optics.f_number": [2.0]})
    layout = map_layout(dataset)
    assert (layout.x.name, layout.y and layout.y.name, layout.others) == (LUMINANCE, CONTRAST, ("exposure.method",))


def test_isolines_of_a_plane_are_its_straight_lines() -> None:
    lines = isolines(plane(), LUMINANCE, CONTRAST, (0.5, 0.75))
    assert [(line.level, line.closed) for line in lines] == [(0.5, False), (0.75, False)]
    for line in lines:
        product = 10 ** ((line.level - 0.5) / 0.2)
        np.testing.assert_allclose(np.multiply(line.x, line.y), product, rtol=1e-12)
        assert max(line.x) == pytest.approx(min(1e3, product / 0.01), rel=1e-12)


def test_an_isoline_around_a_summit_is_closed() -> None:
    a = np.linspace(-1, 1, 21)
    dataset = xr.Dataset({"cdp": (("a", "b"), 1 - np.add.outer(a**2, a**2))}, coords={"a": a, "b": a})
    (line,) = isolines(dataset, "b", "a", (0.75,))
    assert line.closed
    # The chord of a parabola over a step h deviates by at most h^2 / 4, of a slope of 1 at this circle.
    np.testing.assert_allclose(np.hypot(line.x, line.y), 0.5, atol=0.1**2 / 4)


def test_usable_range_of_a_plane_in_closed_form() -> None:
    ranges = usable_ranges(plane(), LUMINANCE, 0.8)
    assert len(ranges) == 9
    for one in ranges:
        low = 10**1.5 / one.at[CONTRAST]  # type: ignore[operator]
        assert len(one.intervals) == (low <= 1e3)
        for interval in one.intervals:
            ends = interval.low, interval.decades, interval.range_db
            assert ends == pytest.approx((low, np.log10(1e3 / low), 20 * np.log10(1e3 / low)), rel=1e-12)
            assert (interval.high, *(end.is_open for end in interval.ends)) == (1e3, False, True)
    widest = widest_range(ranges)
    assert widest is not None
    assert widest.at == {CONTRAST: 1.0}


def test_usable_range_is_split_by_a_dip_and_open_next_to_a_missing_value() -> None:
    cdp = [0.85, 1.0, 1.0, 0.8, 1.0, np.nan, 1.0]
    (one,) = usable_ranges(curve(np.arange(1.0, 8.0), cdp=cdp), LUMINANCE, 0.9)
    ends = [(i.low, i.high, *(end.is_open for end in i.ends)) for i in one.intervals]
    expected = [(4 / 3, 3.5, False, False), (4.5, 5.0, False, True), (7.0, 7.0, True, True)]
    assert [end[2:] for end in ends] == [end[2:] for end in expected]
    np.testing.assert_allclose([end[:2] for end in ends], [end[:2] for end in expected], rtol=1e-12)
    assert one.widest == one.intervals[0]


@given(st.lists(st.floats(0, 1), min_size=2, max_size=12), st.floats(0.01, 1))
def test_usable_range_holds_exactly_the_points_that_are_high_enough(cdp: list[float], level: float) -> None:
    luminance = np.arange(1.0, len(cdp) + 1)
    (one,) = usable_ranges(curve(luminance, cdp=cdp), LUMINANCE, level)
    inside = [any(i.low <= place <= i.high for i in one.intervals) for place in luminance]
    assert inside == [value >= level for value in cdp]
    for end in (end for interval in one.intervals for end in interval.ends if not end.is_open):
        low, high = np.interp(end.bracket, luminance, cdp)
        assert min(low, high) < level <= max(low, high)
        assert end.resolved == (abs(high - low) <= 0.2)
        assert end.bracket[0] <= end.place <= end.bracket[1]
        found = level if end.resolved else max(low, high)
        assert np.interp(end.place, luminance, cdp) == pytest.approx(found, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "unit", "values", "log", "whole", "ratios"),
    [
        (LUMINANCE, "cd/m^2", [1.0, 2.0, 5.0, 10.0, 20.0, 50.0], True, False, True),
        (CONTRAST, "1", [0.01, 0.1, 1.0], True, False, True),
        (CONTRAST, "1", [0.0, 1.0, 10.0, 100.0], False, False, False),
        ("sensor.bits", "1", [8.0, 10.0, 12.0], False, True, False),
        ("sensor.temperature_c", "degC", [10.0, 20.0, 40.0, 80.0], True, False, False),
    ],
)
def test_scale_of_an_axis_what_lies_between_its_values_and_what_their_ratio_tells(
    name: str, unit: str, values: list[float], log: bool, whole: bool, ratios: bool
) -> None:
    dataset = xr.Dataset({"cdp": (name, np.zeros(len(values)))}, coords={name: values})
    dataset[name].attrs["unit"] = unit
    axis = map_axis(dataset, name)
    assert (axis.log, axis.is_whole, axis.of_ratios) == (log, whole, ratios)


def sawtooth(luminance: NDArray[np.float64], place: float, ratio: float) -> NDArray[np.float64]:
    """SNR by shot noise, sqrt(L), that is divided by a ratio beyond a luminance of change."""
    return np.sqrt(luminance) / np.where(luminance > place, ratio, 1)


def test_dip_of_a_change_of_exposure_in_closed_form() -> None:
    luminance = 2.0 ** np.arange(0, 15)
    cdp = np.linspace(0.5, 0.99, luminance.size)
    cdp[7] = 0.3
    dataset = curve(luminance, cdp=cdp, snr_dark=sawtooth(luminance, 64.0, 2.0))
    (dip,) = find_dips(dataset, LUMINANCE, expected=[5.0, 70.0])
    # sqrt(128) / 2 against sqrt(64); half of sqrt(256) is 8 again.
    assert (dip.start, dip.position, dip.recovery, dip.expected) == (64.0, 128.0, pytest.approx(256.0), 70.0)
    assert dip.depth_ratio == pytest.approx(np.sqrt(2), rel=1e-12)
    assert dip.depth_db == pytest.approx(10 * np.log10(2), rel=1e-12)
    assert (dip.highest, dip.lowest_cdp, dip.lowest_cdp_at) == (8.0, 0.3, 128.0)


def test_the_final_saturation_is_not_a_dip_unless_a_change_of_exposure_explains_it() -> None:
    luminance = 2.0 ** np.arange(0, 8)
    dataset = curve(luminance, cdp=np.ones(8), snr_dark=sawtooth(luminance, 64.0, 8.0))
    assert find_dips(dataset, LUMINANCE) == ()
    (dip,) = find_dips(dataset, LUMINANCE, expected=[70.0])
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
        assert [dip.expected for dip in find_dips(dataset, LUMINANCE, expected=expected)] == expected


@pytest.mark.parametrize(
    ("damaged", "message"),
    [
        (lambda one: one.rename(cdp="csnr"), r"has no variable cdp, only \['csnr'\]: give a map"),
        (lambda one: xr.Dataset({"cdp": 0.5}), "has no axis: vary at least one parameter"),
        (lambda one: one.drop_vars(CONTRAST), r"axis scene\.contrast of the map has no coordinates: give its values"),
        (lambda one: one.assign_coords({CONTRAST: [0.1] * 9}), r"axis scene\.contrast are not finite or not distinct"),
    ],
)
def test_faults_of_a_map_are_named(damaged: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        analyse_map(damaged(plane()))
