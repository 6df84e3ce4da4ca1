"""A map as result, picture, page, spreadsheet and files; damage of a NetCDF file is an error that says so."""

import json
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import xarray as xr
from jsonschema import Draft202012Validator
from scipy.stats import norm

from labcdp.core.errors import InputError
from labcdp.evaluate.sweep.maps.map import analyse_map
from labcdp.evaluate.sweep.maps.page import write_map
from labcdp.evaluate.sweep.maps.result import result
from labcdp.report.files import dataset_bytes, read_dataset, schema

LUMINANCE, CONTRAST = "scene.luminance_cd_m2", "scene.contrast"
HOSTILE = "</script><b>bold</b> =1+1 $x_{$ {{ 7 }}"


def shot_noise_map(n_luminance: int = 24, n_contrast: int = 8) -> xr.Dataset:
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


def test_files_hold_each_cell_of_the_dataset_and_escape_names(tmp_path: Path) -> None:
    staged = shot_noise_map(12, 6).expand_dims({"stage": ["sensor", HOSTILE]}).assign_attrs(title=f"=1+1{HOSTILE}")
    analysis = analyse_map(staged)
    write_map(result(staged, analysis), staged, analysis, tmp_path)
    assert "<b>bold" not in (tmp_path / "report.html").read_text()
    values = json.loads((tmp_path / "results.json").read_text())
    Draft202012Validator(schema()).validate(values)
    rows = values["tables"]["map"]["rows"]
    expected = staged.stack(row=("stage", LUMINANCE, CONTRAST))
    for name in ("stage", LUMINANCE, CONTRAST, "cdp", "standard_error", "snr_dark"):
        assert [row[name] for row in rows] == expected[name].values.tolist()
    book = openpyxl.load_workbook(tmp_path / "results.xlsx")
    np.testing.assert_allclose([cell.value for cell in book["map"]["D"][1:]], expected["cdp"].values, rtol=1e-14)
    # Luminance across, contrast down.
    (_, *heads), *lines = ([cell.value for cell in row] for row in book["cdp_1"].iter_rows())
    np.testing.assert_allclose([float(head) for head in heads], staged[LUMINANCE].values, rtol=1e-5)
    np.testing.assert_allclose([line[0] for line in lines], staged[CONTRAST].values)
    np.testing.assert_allclose([line[1:] for line in lines], staged["cdp"].values[0].T, rtol=1e-14)


def test_tables_and_findings_are_the_analysis() -> None:
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


def test_what_is_written_is_read_again_and_damage_is_noticed(tmp_path: Path) -> None:
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
        with pytest.raises(InputError, match=r"map\.nc is (damaged or no|no) NetCDF file"):
            read_dataset(path, "map")
