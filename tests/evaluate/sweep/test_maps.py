"""Maps of CDP: isolines, usable ranges and dips against closed forms and brute force."""

import numpy as np
import openpyxl
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from labcdp.core.errors import InputError
from labcdp.evaluate.sweep.maps.axes import CdpMap
from labcdp.evaluate.sweep.maps.dips import find_dips
from labcdp.evaluate.sweep.maps.map import analyse_map
from labcdp.evaluate.sweep.maps.page import map_files
from labcdp.evaluate.sweep.maps.ranges import isolines, usable_ranges, widest_range
from labcdp.evaluate.sweep.maps.result import result
from labcdp.report.files import dataset_bytes, read_dataset

from ...conftest import valid
from ...output.test_results_folder import write

LUMINANCE, CONTRAST = "scene.luminance_cd_m2", "scene.contrast"


def curve(luminance, unit="cd/m^2", method="exact", **variables):
    """Map over the luminance alone."""
    values = {name: (LUMINANCE, np.asarray(value, dtype=np.float64)) for name, value in variables.items()}
    dataset = xr.Dataset(values, coords={LUMINANCE: np.asarray(luminance, dtype=np.float64)})
    dataset[LUMINANCE].attrs["unit"] = unit
    dataset.attrs["method"] = method
    return dataset


def plane():
    """Map whose CDP is linear in both logarithms: 0.5 + 0.2 log10(L C), not clipped to 0 and 1."""
    luminance, contrast = np.geomspace(1, 1e3, 13), np.geomspace(0.01, 1, 9)
    cdp = 0.5 + 0.2 * (np.log10(contrast)[:, None] + np.log10(luminance))
    dataset = xr.Dataset({"cdp": ((CONTRAST, LUMINANCE), cdp)}, coords={LUMINANCE: luminance, CONTRAST: contrast})
    dataset[LUMINANCE].attrs["unit"] = "cd/m^2"
    return dataset


def test_isolines_of_a_plane_are_its_straight_lines():
    lines = isolines(CdpMap.of(plane()), LUMINANCE, CONTRAST, (0.5, 0.75))
    assert [(line.level, line.closed) for line in lines] == [(0.5, False), (0.75, False)]
    for line in lines:
        product = 10 ** ((line.level - 0.5) / 0.2)
        np.testing.assert_allclose(np.multiply(line.x, line.y), product, rtol=1e-12)
        assert max(line.x) == pytest.approx(min(1e3, product / 0.01), rel=1e-12)


def test_usable_range_of_a_plane_in_closed_form():
    ranges = usable_ranges(CdpMap.of(plane()), LUMINANCE, 0.77)
    assert len(ranges) == 9
    for one in ranges:
        low = 10**1.35 / one.at[CONTRAST]
        assert len(one.intervals) == (low <= 1e3)
        for interval in one.intervals:
            ends = interval.low, interval.decades, interval.range_db
            assert ends == pytest.approx((low, np.log10(1e3 / low), 20 * np.log10(1e3 / low)), rel=1e-12)
            assert (interval.high, *(end.is_open for end in interval.ends)) == (1e3, False, True)
    widest = widest_range(ranges)
    assert widest is not None
    assert widest.at == {CONTRAST: 1.0}


@given(st.lists(st.floats(0, 1), min_size=2, max_size=12), st.floats(0.01, 1))
def test_usable_range_holds_exactly_the_points_that_are_high_enough(cdp, level):
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


def sawtooth(luminance, place, ratio):
    """SNR by shot noise, sqrt(L), that is divided by a ratio beyond a luminance of change."""
    return np.sqrt(luminance) / np.where(luminance > place, ratio, 1)


def test_dip_of_a_change_of_exposure_in_closed_form():
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


def test_the_final_saturation_is_not_a_dip_unless_a_change_of_exposure_explains_it():
    luminance = 2.0 ** np.arange(0, 8)
    dataset = curve(luminance, cdp=np.ones(8), snr_dark=sawtooth(luminance, 64.0, 8.0))
    assert find_dips(CdpMap.of(dataset), LUMINANCE) == ()
    (dip,) = find_dips(CdpMap.of(dataset), LUMINANCE, expected=[70.0])
    assert (dip.start, dip.position, dip.expected) == (64.0, 128.0, 70.0)
    assert np.isnan(dip.recovery)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("fall", [1.0, 3.0])
def test_noise_of_a_simulated_sweep_makes_no_dip_and_hides_none(stated, fall):
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


def test_faults_of_a_map_are_named():
    for damaged, message in (
        (plane().rename(cdp="csnr"), r"has no variable cdp, only \['csnr'\]: give a map"),
        (plane().assign_coords({CONTRAST: [0.1] * 9}), r"axis scene\.contrast are not finite or not distinct"),
    ):
        with pytest.raises(InputError, match=message):
            analyse_map(damaged)


# A map as result, picture, page, spreadsheet and files; damage of a NetCDF file is an error that says so

HOSTILE = "</script><b>bold</b> =1+1 $x_{$ {{ 7 }}"


def shot_noise_map(n_luminance=24, n_contrast=8):
    """CDP of two patches with shot noise alone, in closed form, with a change of exposure at 500 cd/m^2."""
    luminance, contrast = np.geomspace(0.1, 1e4, n_luminance), np.geomspace(0.02, 1, n_contrast)
    light, k = np.meshgrid(luminance, contrast, indexing="ij")
    dark = np.where(light > 500, 1.0, 10.0) * light
    bright = (1 + k) * dark
    below, up_to = (
        norm.cdf((ratio * dark - bright) / np.sqrt(ratio**2 * dark + bright)) for ratio in (1 + k / 2, 1 + 1.5 * k)
    )
    data = {"cdp": up_to - below, "standard_error": 0 * light + 0.0123, "below": below, "snr_dark": np.sqrt(dark)}
    attributes = {"title": "Shot noise", "contrast": np.nan, "epsilon": 0.5, "method": "simulated", "seed": 3}
    axes = {
        LUMINANCE: (LUMINANCE, luminance, {"unit": "cd/m^2", "long_name": "scene luminance"}),
        CONTRAST: (CONTRAST, contrast, {"unit": "1", "long_name": "Weber contrast"}),
    }
    attributes |= {"chain": "[scene]\nluminance_cd_m2 = 1.0\n"}
    return xr.Dataset({name: ((LUMINANCE, CONTRAST), values) for name, values in data.items()}, axes, attributes)


def test_files_hold_each_cell_of_the_dataset_and_escape_names(tmp_path):
    staged = shot_noise_map(12, 6).expand_dims({"stage": ["sensor", HOSTILE]}).assign_attrs(title=f"=1+1{HOSTILE}")
    analysis = analyse_map(staged)
    write(tmp_path, map_files(result(staged, analysis), staged, analysis))
    assert "<b>bold" not in (tmp_path / "report.html").read_text()
    values = valid((tmp_path / "results.json").read_text())
    rows = values["tables"]["map"]["rows"]
    expected = staged.stack(row=("stage", LUMINANCE, CONTRAST))
    for name in ("stage", LUMINANCE, CONTRAST, "cdp", "standard_error", "snr_dark"):
        assert [row[name] for row in rows] == expected[name].values.tolist()
    book = openpyxl.load_workbook(tmp_path / "results.xlsx")
    np.testing.assert_allclose([cell.value for cell in book["map"]["D"][1:]], expected["cdp"].values, rtol=1e-14)
    # Luminance across, contrast down.
    (_, *heads), *lines = ([cell.value for cell in row] for row in book["cdp_1"].iter_rows())
    np.testing.assert_allclose([float(head) for head in heads], staged[LUMINANCE].values, rtol=1e-5)
    np.testing.assert_allclose([line[0] for line in lines], 100 * staged[CONTRAST].values)
    np.testing.assert_allclose([line[1:] for line in lines], staged["cdp"].values[0].T, rtol=1e-14)


def test_tables_and_findings_are_the_analysis():
    dataset = shot_noise_map()
    analysis = analyse_map(dataset, expected=[500.0])
    found = result(dataset, analysis)
    ranges = [(one.at[CONTRAST], i.low, i.high, i.range_db) for one in analysis.usable_ranges for i in one.intervals]
    rows = [row for row in found.table("usable_ranges").rows() if row["low"] is not None]
    assert [tuple(row[name] for name in (CONTRAST, "low", "high", "range_db")) for row in rows] == ranges
    dips = [(row["position"], row["depth_db"], row["expected"]) for row in found.table("dips").rows()]
    assert dips == [(dip.position, dip.depth_db, 500.0) for dip in analysis.dips]
    dim = dataset.assign(cdp=0.8 * dataset["cdp"])
    (finding,) = result(dim, analyse_map(dim)).findings
    assert (finding.code, finding.values["usable_cdp"]) == ("map-nowhere-usable", 0.9)


def test_what_is_written_is_read_again_and_damage_is_noticed(tmp_path):
    axes = ("scene.luminance_cd_m2", "stage")
    cdp = np.where(np.arange(600) == 10, np.nan, np.random.default_rng(0).random(600)).reshape(200, 3)
    data = {"cdp": (axes, cdp, {"long_name": "CDP", "unit": "1"}), "snr_dark": (axes, cdp * np.inf)}
    luminance = (axes[0], np.geomspace(0.1, 1e4, 200), {"unit": "cd/m^2"})
    attributes = {"title": "Ein Füllstand", "contrast": np.nan, "seed": 7, "chain": '[scene]\nname = "ü"\n'}
    dataset = xr.Dataset(data, {axes[0]: luminance, axes[1]: ["sensor", "hdr", "köln"]}, attributes)
    path, whole = tmp_path / "map.nc", dataset_bytes(dataset, "map")
    path.write_bytes(whole)
    xr.testing.assert_identical(read_dataset(path, "map"), dataset)
    altered = bytearray(whole)
    altered[whole.index(b"\x78\x5e") + 1000] ^= 1  # in the first stream of zlib at this level
    for content in (b"CDP;0.5\n", whole[:5000], altered):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"map\.nc (cannot be read as NetCDF|is not a NetCDF file)"):
            read_dataset(path, "map")
