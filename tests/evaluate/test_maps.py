"""Maps of CDP: isolines, usable ranges and dips against closed forms and brute force."""

import json
from dataclasses import asdict

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from labcdp.errors import InputError
from labcdp.evaluate.map_axes import map_axis, map_layout
from labcdp.evaluate.map_dips import find_dips
from labcdp.evaluate.map_isolines import isolines
from labcdp.evaluate.map_ranges import UsableInterval, usable_ranges, widest_range
from labcdp.evaluate.map_snr import known_values
from labcdp.evaluate.maps import analyse_map
from labcdp.json_text import results_json

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


@pytest.mark.parametrize(
    ("values", "log"),
    [
        (np.geomspace(0.1, 1e4, 7), True),
        ([1.0, 2.0, 5.0, 10.0, 20.0, 50.0], True),
        (np.linspace(1, 100, 7), False),
        ([0.0, 1.0, 10.0, 100.0], False),
        ([1.0, 100.0], False),
    ],
)
def test_an_axis_is_logarithmic_if_its_ratios_are_the_more_even(values: ArrayLike, log: bool) -> None:
    assert map_axis(curve(values, cdp=np.zeros(len(np.asarray(values)))), LUMINANCE).log == log


def test_the_luminance_is_across_and_an_axis_of_one_value_is_none() -> None:
    dataset = plane().expand_dims({"exposure.method": ["short", "long"], "optics.f_number": [2.0]})
    layout = map_layout(dataset)
    assert (layout.x.name, layout.y and layout.y.name, layout.others) == (LUMINANCE, CONTRAST, ("exposure.method",))


def test_an_axis_of_texts_is_across_if_there_is_no_other() -> None:
    layout = map_layout(xr.Dataset({"cdp": ("stage", [0.9, 0.8])}, coords={"stage": ["sensor", "isp"]}))
    assert (layout.x.name, layout.x.numeric, layout.y) == ("stage", False, None)


def test_isolines_of_a_plane_are_its_straight_lines() -> None:
    lines = isolines(plane(), LUMINANCE, CONTRAST, (0.5, 0.75))
    assert [(line.level, line.closed) for line in lines] == [(0.5, False), (0.75, False)]
    for line in lines:
        product = 10 ** ((line.level - 0.5) / 0.2)
        np.testing.assert_allclose(np.multiply(line.x, line.y), product, rtol=1e-12)
        assert max(line.x) == pytest.approx(min(1e3, product / 0.01), rel=1e-12)


def test_isolines_are_linear_in_a_linear_axis() -> None:
    values = np.add.outer(np.linspace(0, 0.5, 6), np.linspace(0, 0.5, 5))
    dataset = xr.Dataset({"cdp": (("a", "b"), values)}, coords={"a": np.arange(6.0), "b": np.arange(5.0)})
    (line,) = isolines(dataset, "b", "a", (0.3,))
    np.testing.assert_allclose(np.divide(line.x, 8) + np.divide(line.y, 10), 0.3, rtol=1e-12)


def test_isolines_leave_out_cells_beside_a_missing_value() -> None:
    dataset = plane()
    dataset["cdp"][4, 4:8] = np.nan
    lines = isolines(dataset, LUMINANCE, CONTRAST, (0.5,))
    assert len(lines) == 2
    for line in lines:
        np.testing.assert_allclose(np.multiply(line.x, line.y), 1.0, rtol=1e-12)


def test_an_isoline_around_a_summit_is_closed() -> None:
    a = np.linspace(-1, 1, 21)
    dataset = xr.Dataset({"cdp": (("a", "b"), 1 - np.add.outer(a**2, a**2))}, coords={"a": a, "b": a})
    (line,) = isolines(dataset, "b", "a", (0.75,))
    assert line.closed
    # The chord of a parabola over a step h deviates by at most h^2 / 4, of a slope of 1 at this circle.
    np.testing.assert_allclose(np.hypot(line.x, line.y), 0.5, atol=0.1**2 / 4)


def test_isolines_are_found_in_each_section() -> None:
    lines = isolines(plane().expand_dims({"stage": ["sensor", "isp"]}), LUMINANCE, CONTRAST, (0.5,))
    assert [line.at for line in lines] == [{"stage": "sensor"}, {"stage": "isp"}]


def test_usable_range_of_a_plane_in_closed_form() -> None:
    ranges = usable_ranges(plane(), LUMINANCE, 0.8)
    assert len(ranges) == 9
    for one in ranges:
        low = 10**1.5 / one.at[CONTRAST]  # type: ignore[operator]
        if low > 1e3:
            assert one.intervals == ()
            assert one.widest is None
        else:
            (interval,) = one.intervals
            assert interval.low == pytest.approx(low, rel=1e-12)
            assert (interval.high, interval.low_open, interval.high_open) == (1e3, False, True)
            assert interval.decades == pytest.approx(np.log10(1e3 / low), rel=1e-12)
            assert interval.range_db == pytest.approx(20 * np.log10(1e3 / low), rel=1e-12)
    widest = widest_range(ranges)
    assert widest is not None
    assert widest.at == {CONTRAST: 1.0}


def test_usable_range_is_split_by_a_dip_and_open_beside_a_missing_value() -> None:
    cdp = [0.85, 1.0, 1.0, 0.8, 1.0, np.nan, 1.0]
    (one,) = usable_ranges(curve(np.arange(1.0, 8.0), cdp=cdp), LUMINANCE, 0.9)
    ends = [(i.low, i.high, i.low_open, i.high_open) for i in one.intervals]
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
    for interval in one.intervals:
        for end, is_open, resolved, bracket in (
            (interval.low, interval.low_open, interval.low_resolved, interval.low_bracket),
            (interval.high, interval.high_open, interval.high_resolved, interval.high_bracket),
        ):
            if not is_open:
                low, high = np.interp(bracket, luminance, cdp)
                assert min(low, high) < level <= max(low, high)
                assert resolved == (abs(high - low) <= 0.2)
                assert bracket[0] <= end <= bracket[1]
                found = level if resolved else max(low, high)
                assert np.interp(end, luminance, cdp) == pytest.approx(found, abs=1e-9)


def usable_of_a_step(n_points: int, start: float, stop: float, **attributes: str) -> UsableInterval:
    """Usable interval of a CDP that is 1 between two luminances and 0 elsewhere, on a grid from 0.1 to 1000."""
    luminance = np.geomspace(0.1, 1e3, n_points)
    (one,) = usable_ranges(curve(luminance, cdp=(luminance > start) & (luminance < stop), **attributes), LUMINANCE)
    assert one.widest is not None
    return one.widest


@pytest.mark.parametrize("stop", [38.0, 99.0, 124.0, 700.0])
def test_of_a_step_no_grid_claims_more_than_there_is(stop: float) -> None:
    widths = []
    for n_points in (9, 17, 33, 65, 129):  # each grid holds all points of the one before
        found = usable_of_a_step(n_points, 0.5, stop)
        assert 0.5 < found.low < found.high < stop
        assert found.low_bracket[0] < 0.5 < found.low_bracket[1] == found.low
        assert found.high == found.high_bracket[0] < stop < found.high_bracket[1]
        assert (found.low_resolved, found.high_resolved) == (False, False)
        assert found.decades == pytest.approx(np.log10(found.high / found.low), rel=1e-12)
        widths.append(found.decades)
    assert widths == sorted(widths)
    assert widths[-1] == pytest.approx(np.log10(stop / 0.5), abs=2 * 4 / 128)


@given(st.integers(5, 60), st.floats(20, 900))
def test_of_a_step_any_grid_keeps_within(n_points: int, stop: float) -> None:
    found = usable_of_a_step(n_points, 0.05, stop)
    assert found.high <= stop
    assert found.high_open or found.high_bracket[0] <= stop <= found.high_bracket[1]


def test_the_widest_range_counts_no_more_than_the_grid_shows() -> None:
    # Interpolated, the first would reach to 3.2; the second reaches to 3.0 for certain.
    cdp = np.array([[1.0, 1.0, 0.4, 0.4], [1.0, 1.0, 0.9, 0.8]])
    dataset = xr.Dataset({"cdp": (("stage", LUMINANCE), cdp)}, coords={LUMINANCE: [1.0, 2.0, 3.0, 4.0]})
    widest = widest_range(usable_ranges(dataset.assign_coords(stage=["a", "b"]), LUMINANCE))
    assert widest is not None
    assert widest.at == {"stage": "b"}


@pytest.mark.parametrize(
    ("name", "unit", "values", "whole", "ratios"),
    [
        (LUMINANCE, "cd/m^2", [1.0, 2.0, 3.0], False, True),
        (CONTRAST, "1", [0.01, 0.1, 1.0], False, True),
        (CONTRAST, "1", [1.0, 2.0, 3.0], False, False),
        ("exposure.exposure_s", "s", [0.001, 0.01, 0.1], False, True),
        ("sensor.bits", "1", [8.0, 10.0, 12.0], True, False),
        ("optics.f_number", "1", [1.4, 2.0, 2.8, 4.0], False, False),
        ("sensor.temperature_c", "degC", [10.0, 20.0, 40.0, 80.0], False, False),
        ("isp.gain_db", "dB", [1.0, 10.0, 100.0], False, False),
    ],
)
def test_what_lies_between_values_and_what_their_ratio_tells(
    name: str, unit: str, values: list[float], whole: bool, ratios: bool
) -> None:
    dataset = xr.Dataset({"cdp": (name, np.zeros(len(values)))}, coords={name: values})
    dataset[name].attrs["unit"] = unit
    axis = map_axis(dataset, name)
    assert (axis.is_whole, axis.of_ratios) == (whole, ratios)


def test_whole_numbers_end_at_a_whole_number_and_have_no_decades() -> None:
    dataset = xr.Dataset({"cdp": ("bits", [0.8, 0.88, 0.95, 0.97])}, coords={"bits": [8, 9, 10, 12]})
    (interval,) = usable_ranges(dataset, "bits")[0].intervals
    assert (interval.low, interval.low_bracket, interval.low_resolved) == (10.0, (9.0, 10.0), True)
    assert np.isnan([interval.decades, interval.range_db]).all()


def test_parameters_in_any_order_give_the_same_ranges() -> None:
    dataset = plane()
    assert usable_ranges(dataset.isel({LUMINANCE: slice(None, None, -1)}), LUMINANCE) == usable_ranges(
        dataset, LUMINANCE
    )


def sawtooth(luminance: NDArray[np.float64], falls: dict[float, float]) -> NDArray[np.float64]:
    """SNR by shot noise, sqrt(L), that is divided by a ratio beyond each luminance of change."""
    snr = np.sqrt(luminance)
    for place, ratio in falls.items():
        snr = np.where(luminance > place, snr / ratio, snr)
    return snr


def test_dip_of_a_change_of_exposure_in_closed_form() -> None:
    luminance = 2.0 ** np.arange(0, 15)
    cdp = np.linspace(0.5, 0.99, luminance.size)
    cdp[7] = 0.3
    dataset = curve(luminance, cdp=cdp, snr_dark=sawtooth(luminance, {64.0: 2.0}))
    (dip,) = find_dips(dataset, LUMINANCE, expected=[5.0, 70.0])
    # sqrt(128) / 2 against sqrt(64); half of sqrt(256) is 8 again.
    assert (dip.start, dip.position, dip.recovery, dip.expected) == (64.0, 128.0, pytest.approx(256.0), 70.0)
    assert dip.depth_ratio == pytest.approx(np.sqrt(2), rel=1e-12)
    assert dip.depth_db == pytest.approx(10 * np.log10(2), rel=1e-12)
    assert (dip.highest, dip.lowest_cdp, dip.lowest_cdp_at) == (8.0, 0.3, 128.0)


def test_each_change_of_exposure_explains_one_dip() -> None:
    luminance = np.geomspace(1, 1e6, 121)
    dataset = curve(
        luminance, cdp=np.ones_like(luminance), snr_dark=sawtooth(luminance, {100.0: 3.0, 2000.0: 3.0, 5e4: 3.0})
    )
    dips = find_dips(dataset, LUMINANCE, expected=[2010.0, 99.0, 101.0])
    assert [dip.expected for dip in dips[:2]] == [101.0, 2010.0]
    assert np.isnan(dips[2].expected)
    # A third of the square root is as high again at nine times the luminance.
    np.testing.assert_allclose([dip.recovery / dip.start for dip in dips], 9.0, rtol=1e-3)
    step = luminance[1] / luminance[0]
    for dip, place in zip(dips, (100.0, 2000.0, 5e4), strict=True):
        assert place / step < dip.start <= place * (1 + 1e-12)
        assert place < dip.position < place * step * (1 + 1e-12)


def test_a_shallow_fall_is_no_dip() -> None:
    luminance = 2.0 ** np.arange(0, 12)
    dataset = curve(luminance, cdp=np.ones(12), snr_dark=sawtooth(luminance, {64.0: 1.5}))
    assert len(find_dips(dataset, LUMINANCE, min_fall=0.05)) == 1  # sqrt(2) / 1.5 is a fall by 5.7 %
    assert find_dips(dataset, LUMINANCE, min_fall=0.06) == ()


def test_the_final_saturation_is_no_dip_unless_a_change_of_exposure_explains_it() -> None:
    luminance = 2.0 ** np.arange(0, 8)
    dataset = curve(luminance, cdp=np.ones(8), snr_dark=sawtooth(luminance, {64.0: 8.0}))
    assert find_dips(dataset, LUMINANCE) == ()
    (dip,) = find_dips(dataset, LUMINANCE, expected=[70.0])
    assert (dip.start, dip.position, dip.expected) == (64.0, 128.0, 70.0)
    assert np.isnan(dip.recovery)


def test_what_follows_the_saturation_of_the_bright_region_is_left_out() -> None:
    luminance = 2.0 ** np.arange(0, 12)
    snr = sawtooth(luminance, {64.0: 4.0})
    saturated = luminance > 64.0
    assert len(find_dips(curve(luminance, cdp=np.ones(12), snr_dark=snr), LUMINANCE)) == 1
    assert find_dips(curve(luminance, cdp=np.ones(12), snr_dark=snr, saturated_share=saturated), LUMINANCE) == ()


def test_infinite_and_missing_snr_are_passed_over() -> None:
    luminance = 2.0 ** np.arange(0, 12)
    snr = sawtooth(luminance, {64.0: 4.0})
    snr[[0, 3, 9]] = [np.inf, np.nan, np.inf]
    (dip,) = find_dips(curve(luminance, cdp=np.ones(12), snr_dark=snr), LUMINANCE)
    assert (dip.start, dip.position) == (64.0, 128.0)


@pytest.mark.parametrize("stated", [True, False])
def test_noise_makes_no_dip_and_hides_none(stated: bool) -> None:
    luminance = np.geomspace(1, 1e4, 60)
    flat, fallen = np.full(60, 30.0), sawtooth(luminance, {100.0: 3.0})
    for seed in range(50):
        noise = 1 + 0.05 * np.random.default_rng(seed).normal(size=60)
        for snr, n_dips in ((flat, 0), (fallen, 1)):
            errors = {"snr_dark_standard_error": 0.05 * snr} if stated else {}
            dataset = curve(luminance, method="simulated", cdp=np.ones(60), snr_dark=snr * noise, **errors)
            dips = find_dips(dataset, LUMINANCE, expected=[100.0])
            assert len(dips) == n_dips
            assert all(dip.expected == 100.0 for dip in dips)


def measured_snr(luminance: NDArray[np.float64], n_pixels: int, seed: int) -> xr.Dataset:
    """SNR of normal pixels with shot noise and read noise of 1.5, and its standard error, as a sweep gives them."""
    rng = np.random.default_rng(seed)
    spread = np.sqrt(luminance + 1.5**2)[:, None]
    pixels = luminance[:, None] + spread * rng.normal(size=(luminance.size, n_pixels))
    snr = pixels.mean(axis=1) / pixels.std(axis=1, ddof=1)
    errors = np.sqrt((1 + snr**2 / 2) / n_pixels)
    cdp = np.linspace(0.1, 1, luminance.size)
    return curve(luminance, method="simulated", cdp=cdp, snr_dark=snr, snr_dark_standard_error=errors)


@pytest.mark.parametrize("stated", [True, False])
def test_noise_of_a_simulated_sweep_makes_no_dip(stated: bool) -> None:
    luminance = np.geomspace(0.02, 2e3, 400)
    for seed in range(60):
        dataset = measured_snr(luminance, 512, seed)
        if not stated:
            dataset = dataset.drop_vars("snr_dark_standard_error")
        assert find_dips(dataset, LUMINANCE) == ()


def test_noise_of_a_flat_snr_makes_no_dip_in_a_map_of_many_sections() -> None:
    luminance = np.geomspace(1, 1e3, 200)
    rng = np.random.default_rng(0)
    snr = 30 * (1 + rng.normal(size=(200, 200)) / np.sqrt(2 * 512))
    dataset = xr.Dataset(
        {"cdp": (("seed", LUMINANCE), np.ones_like(snr)), "snr_dark": (("seed", LUMINANCE), snr)},
        coords={"seed": np.arange(200.0), LUMINANCE: luminance},
        attrs={"method": "simulated"},
    )
    dataset["snr_dark_standard_error"] = dataset["snr_dark"] / np.sqrt(2 * 512)
    assert find_dips(dataset, LUMINANCE, min_fall=0.001) == ()


def test_pixels_that_are_not_independent_make_no_dip() -> None:
    luminance = np.geomspace(0.1, 1e3, 300)
    for seed in range(20):
        dataset = measured_snr(luminance, 64, seed)
        dataset["snr_dark_standard_error"] /= 4  # as if 1024 pixels were independent, of which 64 are
        assert find_dips(dataset, LUMINANCE) == ()


def test_noise_hides_no_deep_dip_of_a_simulated_sweep() -> None:
    luminance = np.geomspace(0.1, 1e4, 400)
    for seed in range(20):
        dataset = measured_snr(luminance, 512, seed)
        dataset["snr_dark"] = dataset["snr_dark"].where(luminance <= 100, dataset["snr_dark"] / 4)
        (dip,) = find_dips(dataset, LUMINANCE)
        assert 80 < dip.start < dip.position < 130


def test_a_dip_within_another_is_told_once() -> None:
    snr = [10.0, 20.0, 8.0, 12.0, 6.0, 15.0, 30.0, 20.0, 40.0]
    dataset = curve(np.arange(1.0, 10.0), cdp=np.ones(9), snr_dark=snr)
    outer, later = find_dips(dataset, LUMINANCE)
    assert (outer.start, outer.position, outer.highest) == (2.0, 5.0, 20.0)
    assert outer.recovery == pytest.approx(6 + 1 / 3)
    assert (later.start, later.position) == (7.0, 8.0)


def test_a_final_fall_is_not_explained_by_a_shallow_one_before_it() -> None:
    cdp = [0.5, 1.0, 0.95, 0.96, 0.97, 0.98, 0.0, 0.0]
    assert find_dips(curve(np.arange(1.0, 9.0), cdp=cdp), LUMINANCE, "cdp", expected=[2.5]) == ()
    (dip,) = find_dips(curve(np.arange(1.0, 9.0), cdp=cdp), LUMINANCE, "cdp", expected=[6.5])
    assert (dip.start, dip.position, dip.expected) == (2.0, 7.0, 6.5)


def test_two_changes_of_exposure_are_two_dips_though_the_first_has_not_recovered() -> None:
    snr = [10.0, 20.0, 8.0, 12.0, 6.0, 15.0, 30.0]
    dataset = curve(np.arange(1.0, 8.0), cdp=np.ones(7), snr_dark=snr)
    assert [dip.expected for dip in find_dips(dataset, LUMINANCE, expected=[2.5, 4.5])] == [2.5, 4.5]
    (dip,) = find_dips(dataset, LUMINANCE, expected=[4.5])
    assert (dip.start, dip.position, dip.expected) == (2.0, 5.0, 4.5)


def test_snr_without_noise_is_no_number() -> None:
    values = np.array([1.0, 1e6, 1.1e6, np.inf, np.nan, -np.inf])
    np.testing.assert_array_equal(known_values("snr_dark", values), [1.0, 1e6, *[np.nan] * 4])
    np.testing.assert_array_equal(known_values("below", values), values)


def test_saturation_without_noise_makes_no_dip() -> None:
    luminance = 2.0 ** np.arange(0, 12)
    snr = np.where(np.arange(12) % 5 == 4, 1e42, np.sqrt(luminance))
    assert find_dips(curve(luminance, cdp=np.ones(12), snr_dark=snr), LUMINANCE) == ()


def test_analysis_is_json_and_names_what_it_looked_at() -> None:
    analysis = analyse_map(plane().assign(csnr=plane()["cdp"]))
    assert (analysis.x, analysis.y, analysis.dip_variables) == (LUMINANCE, CONTRAST, ("csnr", "cdp"))
    read = json.loads(results_json(asdict(analysis)))
    assert read["widest"]["at"] == {CONTRAST: 1.0}
    assert read["widest"]["widest"]["low"] == pytest.approx(100.0)
    assert {line["level"] for line in read["isolines"]} == {0.5, 0.9, 0.95}


def test_dips_of_cdp_count_where_something_was_detected() -> None:
    cdp = [0.01, 0.09, 0.01, 0.8, 0.5, 0.9, 1.0]
    analysis = analyse_map(curve(np.arange(1.0, 8.0), cdp=cdp, snr_dark=np.arange(1.0, 8.0)))
    (dip,) = analysis.dips
    assert (dip.variable, dip.start, dip.position, dip.highest, dip.lowest_cdp) == ("cdp", 4.0, 5.0, 0.8, 0.5)
    assert dip.depth_ratio == pytest.approx(1.6, rel=1e-12)


def test_a_map_of_texts_alone_has_nothing_to_analyse() -> None:
    analysis = analyse_map(xr.Dataset({"cdp": ("stage", [0.9, 0.8])}, coords={"stage": ["sensor", "isp"]}))
    assert (analysis.usable_ranges, analysis.widest, analysis.dips, analysis.isolines) == ((), None, (), ())


def test_faults_of_a_map_are_named() -> None:
    dataset = plane()
    with pytest.raises(InputError, match=r"has no variable cdp, only \['csnr'\]: give a map"):
        analyse_map(dataset.rename(cdp="csnr"))
    with pytest.raises(InputError, match=r"has no axis: vary at least one parameter"):
        analyse_map(xr.Dataset({"cdp": 0.5}))
    with pytest.raises(InputError, match=r"axis scene\.contrast of the map has no coordinates: give its values"):
        analyse_map(dataset.drop_vars(CONTRAST))
    with pytest.raises(InputError, match=r"axis scene\.contrast of the map is empty"):
        analyse_map(dataset.isel({CONTRAST: slice(0, 0)}))
    with pytest.raises(InputError, match=r"axis scene\.contrast are not finite or not distinct"):
        analyse_map(dataset.assign_coords({CONTRAST: [0.1] * 9}))
    with pytest.raises(InputError, match=r"variable text of the map is of type <U1 over \[\]: give numbers"):
        analyse_map(dataset.assign(text="a"))
    with pytest.raises(InputError, match=r"no axis 'gain': choose one of scene\.contrast, scene\.luminance_cd_m2"):
        usable_ranges(dataset, "gain")


def test_faults_of_the_arguments_are_named() -> None:
    dataset = plane().expand_dims({"stage": ["sensor", "isp"]})
    with pytest.raises(InputError, match=r"axis stage has no isolines: choose an axis of at least two numbers"):
        isolines(dataset, LUMINANCE, "stage")
    with pytest.raises(InputError, match=r"no variable 'snr': choose one of \['cdp'\]"):
        isolines(dataset, LUMINANCE, CONTRAST, variable="snr")
    with pytest.raises(InputError, match=r"levels are \[nan\]: give finite numbers"):
        isolines(dataset, LUMINANCE, CONTRAST, (np.nan,))
    with pytest.raises(InputError, match=r"axis stage has no range: choose an axis of numbers"):
        usable_ranges(dataset, "stage")
    with pytest.raises(InputError, match=r"level is 0: give a CDP above 0, up to 1"):
        usable_ranges(dataset, LUMINANCE, 0)
    with pytest.raises(InputError, match=r"axis stage has no dips: choose an axis of numbers"):
        find_dips(dataset, "stage", "cdp")
    with pytest.raises(InputError, match=r"no variable 'snr_dark'"):
        find_dips(dataset, LUMINANCE)
    with pytest.raises(InputError, match=r"min_fall is 1: give a fraction above 0 and below 1"):
        find_dips(dataset, LUMINANCE, "cdp", min_fall=1)
