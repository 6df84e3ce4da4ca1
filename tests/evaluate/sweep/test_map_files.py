"""A map as result, picture, page, spreadsheet and files."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import xarray as xr
from jsonschema import Draft202012Validator
from scipy.stats import norm

from labcdp.core.result import Result
from labcdp.evaluate.sweep.maps.map import analyse_map
from labcdp.evaluate.sweep.maps.page import write_map
from labcdp.evaluate.sweep.maps.result import result
from labcdp.report.files import envelope, schema

CHROMIUM = shutil.which("chromium")

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


@pytest.fixture(scope="module")
def staged() -> xr.Dataset:
    """A map after two stages, one of a hostile name."""
    return shot_noise_map(12, 6).expand_dims({"stage": ["sensor", HOSTILE]}).assign_attrs(title=f"=1+1{HOSTILE}")


@pytest.fixture(scope="module")
def folder(staged: xr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(staged, tmp_path_factory.mktemp("map"))


def write(dataset: xr.Dataset, folder: Path) -> Path:
    analysis = analyse_map(dataset)
    write_map(result(dataset, analysis), dataset, analysis, folder)
    return folder


def result_of(dataset: xr.Dataset, *expected: float) -> Result:
    return result(dataset, analyse_map(dataset, expected=expected))


def test_of_many_sections_some_are_drawn_and_the_tables_hold_all(staged: xr.Dataset, tmp_path: Path) -> None:
    curves = (write(staged.isel({CONTRAST: [5]}), tmp_path / "curves") / "report.html").read_text()
    assert "<b>bold" not in curves
    many = shot_noise_map(6, 6).expand_dims({"seed": [str(i) for i in range(14)]})
    page = (write(many, tmp_path / "many") / "report.html").read_text()
    assert "12 of 14 sections" in page
    assert len(result_of(many).table("map")) == many["cdp"].size


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_browser_draws_isolines_and_hostile_names_and_loads_nothing(folder: Path, tmp_path: Path) -> None:
    path = folder / "report.html"
    text = path.read_text()
    assert "default-src 'none'; " in text
    # No button that sends the map away.
    assert '"showSendToCloud": false' in text.rpartition("Plotly.newPlot(")[2]
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--virtual-time-budget=5000"]
    run = subprocess.run(
        [str(CHROMIUM), *options, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", path.as_uri()],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    assert not [line for line in run.stderr.splitlines() if "CONSOLE" in line and path.name in line]
    drawn = run.stdout.partition('<div id="figure"')[2]
    for text in ("CDP 0.5", "CDP 0.9", "CDP 0.95", "scene luminance in cd/m²", "stage sensor"):
        assert f">{text}<" in drawn
    assert drawn.count('class="heatmaplayer') >= 1
    assert "<b>bold" not in drawn


def test_json_and_sheets_hold_each_cell_of_the_dataset(staged: xr.Dataset, folder: Path) -> None:
    values = envelope(result_of(staged))
    Draft202012Validator(schema()).validate(values)
    rows = values["tables"]["map"]["rows"]
    expected = staged.stack(row=("stage", LUMINANCE, CONTRAST))
    for name in ("stage", LUMINANCE, CONTRAST, "cdp", "standard_error", "snr_dark"):
        assert [row[name] for row in rows] == expected[name].values.tolist()
    assert (values["seed"], values["configuration"]["epsilon"], values["configuration"]["contrast"]) == (3, 0.5, None)
    book = openpyxl.load_workbook(folder / "results.xlsx")
    assert book.sheetnames == ["usable_ranges", "dips", "map", "cdp_1", "cdp_2", "isolines", "about"]
    sheet = book["map"]
    assert [cell.value for cell in sheet[1]][:4] == ["stage", "scene luminance (cd/m²)", "Weber contrast (%)", "CDP"]
    np.testing.assert_allclose([cell.value for cell in sheet["D"][1:]], expected["cdp"].values, rtol=1e-14)
    assert {cell.number_format[-1] for cell in sheet["C"][1:]} == {"%"}
    # Luminance across, contrast down, and a colour scale.
    (_, *heads), *lines = ([cell.value for cell in row] for row in book["cdp_1"].iter_rows())
    np.testing.assert_allclose([float(head) for head in heads], staged[LUMINANCE].values, rtol=1e-5)
    np.testing.assert_allclose([line[0] for line in lines], staged[CONTRAST].values)
    np.testing.assert_allclose([line[1:] for line in lines], staged["cdp"].values[0].T, rtol=1e-14)
    (scale,) = book["cdp_1"].conditional_formatting
    assert (str(scale.sqref), [rule.type for rule in scale.rules]) == ("B2:M7", ["colorScale"])


def test_tables_of_ranges_dips_and_isolines_are_the_analysis() -> None:
    dataset = shot_noise_map()
    analysis = analyse_map(dataset, expected=[500.0])
    found = result(dataset, analysis)
    names = ("low", "high", "decades", "range_db")
    expected = [
        (one.at[CONTRAST], *i.ends[0].bracket, *i.ends[1].bracket, *(getattr(i, name) for name in names))
        for one in analysis.usable_ranges
        for i in one.intervals
    ]
    names = (CONTRAST, "low_below", "low_above", "high_below", "high_above", *names)
    rows = [row for row in found.table("usable_ranges").rows() if row["low"] is not None]
    assert [tuple(row[name] for name in names) for row in rows] == expected
    assert [row["low"] for row in rows if row["widest"]] == [analysis.widest.widest.low]  # type: ignore[union-attr]
    dips = [(row["position"], row["depth_db"], row["expected"]) for row in found.table("dips").rows()]
    assert dips == [(dip.position, dip.depth_db, 500.0) for dip in analysis.dips]
    points = [(row["level"], row[LUMINANCE], row[CONTRAST]) for row in found.table("isolines").rows()]
    assert points == [(line.level, x, y) for line in analysis.isolines for x, y in zip(line.x, line.y, strict=True)]


def test_a_map_that_is_nowhere_usable_and_one_too_large_for_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = shot_noise_map()
    (finding,) = result_of(dataset.assign(cdp=0.8 * dataset["cdp"])).findings
    assert (finding.code, finding.values["usable_cdp"]) == ("map-nowhere-usable", 0.9)
    monkeypatch.setattr("labcdp.evaluate.sweep.maps.result._MOST_CELLS", dataset["cdp"].size - 1)
    found = result_of(dataset)
    assert [(one.code, one.values["n_cells"]) for one in found.findings] == [("map-in-netcdf-only", 192)]
    assert {"map", "cdp"}.isdisjoint(table.name for table in found.tables)
