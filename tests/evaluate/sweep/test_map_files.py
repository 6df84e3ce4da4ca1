"""A map as result, picture, page, spreadsheet and files."""

import shutil
import subprocess
from datetime import UTC, datetime
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import xarray as xr
from jsonschema import Draft202012Validator
from numpy.typing import NDArray
from scipy.stats import norm

from labcdp.core.result import Result
from labcdp.evaluate.sweep.maps.map import analyse_map
from labcdp.evaluate.sweep.maps.page import write_map
from labcdp.evaluate.sweep.maps.result import result
from labcdp.evaluate.sweep.maps.view import MapView
from labcdp.report.files import envelope, schema
from labcdp.report.sheets import result_workbook

CHROMIUM = shutil.which("chromium")

LUMINANCE, CONTRAST = "scene.luminance_cd_m2", "scene.contrast"
HOSTILE = "</script><b>bold</b> =1+1 $x_{$ {{ 7 }}"
TIME = datetime(2026, 3, 2, tzinfo=UTC)


def shot_noise_map(n_luminance: int = 24, n_contrast: int = 8) -> xr.Dataset:
    """CDP of two patches with shot noise alone, in closed form, with a change of exposure at 500 cd/m^2."""
    luminance, contrast = np.geomspace(0.1, 1e4, n_luminance), np.geomspace(0.02, 1, n_contrast)
    light, k = np.meshgrid(luminance, contrast, indexing="ij")
    dark = np.where(light > 500, 1.0, 10.0) * light
    bright = (1 + k) * dark

    def share_below(ratio: NDArray[np.float64]) -> NDArray[np.float64]:
        return norm.cdf((ratio * dark - bright) / np.sqrt(ratio**2 * dark + bright))

    below, above = share_below(1 + k / 2), 1 - share_below(1 + 1.5 * k)
    data = {"cdp": 1 - below - above, "standard_error": 0 * light + 0.0123, "below": below, "snr_dark": np.sqrt(dark)}
    attributes = {"title": "Shot noise", "contrast": np.nan, "epsilon": 0.5, "method": "simulated", "seed": 3}
    dataset = xr.Dataset(
        {name: ((LUMINANCE, CONTRAST), values) for name, values in data.items()},
        coords={LUMINANCE: luminance, CONTRAST: contrast},
        attrs=attributes | {"labcdp_version": "0.1.0", "chain": "[scene]\nluminance_cd_m2 = 1.0\n"},
    )
    dataset[LUMINANCE].attrs.update(unit="cd/m^2", long_name="scene luminance")
    dataset[CONTRAST].attrs.update(unit="1", long_name="Weber contrast")
    return dataset


@pytest.fixture
def dataset() -> xr.Dataset:
    return shot_noise_map()


@pytest.fixture
def staged() -> xr.Dataset:
    """A map after two stages, one of a hostile name."""
    return shot_noise_map(12, 6).expand_dims({"stage": ["sensor", HOSTILE]})


def one_contrast(dataset: xr.Dataset, index: int = 5) -> xr.Dataset:
    return dataset.isel({CONTRAST: [index]})


def view(dataset: xr.Dataset) -> MapView:
    return MapView.of(dataset, analyse_map(dataset))


def result_of(dataset: xr.Dataset, expected: tuple[float, ...] = ()) -> Result:
    return result(dataset, analyse_map(dataset, expected=expected))


def page(dataset: xr.Dataset, folder: Path) -> Path:
    analysis = analyse_map(dataset)
    write_map(result(dataset, analysis), dataset, analysis, folder)
    return folder / "report.html"


def test_of_many_sections_some_are_drawn_and_the_tables_hold_all(tmp_path: Path) -> None:
    many = shot_noise_map(6, 6).expand_dims({"seed": [str(i) for i in range(14)]})
    panels, curves = view(many), view(one_contrast(many))
    assert (len(panels.parts), panels.left_out, len(curves.parts), curves.left_out) == (12, 2, 8, 6)
    assert [panels.parts[place][0]["seed"] for place in (0, -1)] == ["0", "13"]
    assert "12 of 14 sections" in page(many, tmp_path).read_text()
    assert len(result_of(many).table("map")) == many["cdp"].size


class _Links(HTMLParser):
    """Everything a page would load, and its security policy."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.policy = ""
        self.bold = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.loaded += [str(values[name]) for name in ("src", "href") if name in values]
        self.bold += tag == "b"
        if values.get("http-equiv") == "Content-Security-Policy":
            self.policy = str(values["content"])


@pytest.mark.parametrize("curves", [False, True])
def test_page_loads_nothing_and_may_not(staged: xr.Dataset, curves: bool, tmp_path: Path) -> None:
    links = _Links()
    text = page((one_contrast(staged) if curves else staged).assign_attrs(title=HOSTILE), tmp_path).read_text()
    links.feed(text)
    assert (links.loaded, links.bold) == ([], 0)
    assert links.policy.startswith("default-src 'none'; ")
    assert "http" not in links.policy
    # No button that sends the map away.
    assert '"showSendToCloud": false' in text.rpartition("Plotly.newPlot(")[2]


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_browser_draws_isolines_and_hostile_names(staged: xr.Dataset, tmp_path: Path) -> None:
    path = page(staged, tmp_path / "map")
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


def test_json_and_sheets_hold_each_cell_of_the_dataset(staged: xr.Dataset) -> None:
    found = result_of(staged.assign_attrs(title="=1+1"))
    values = envelope(found)
    Draft202012Validator(schema()).validate(values)
    rows = values["tables"]["map"]["rows"]
    expected = staged.stack(row=("stage", LUMINANCE, CONTRAST))
    for name in ("stage", LUMINANCE, CONTRAST, "cdp", "standard_error", "snr_dark"):
        assert [row[name] for row in rows] == expected[name].values.tolist()
    book = openpyxl.load_workbook(BytesIO(result_workbook(found, TIME)))
    assert book.sheetnames == ["usable_ranges", "dips", "map", "cdp_1", "cdp_2", "isolines", "about"]
    sheet = book["map"]
    assert [cell.value for cell in sheet[1]][:4] == ["stage", "scene luminance (cd/m²)", "Weber contrast (%)", "CDP"]
    np.testing.assert_allclose([cell.value for cell in sheet["D"][1:]], expected["cdp"].values, rtol=1e-14)
    assert {cell.number_format[-1] for cell in sheet["C"][1:]} == {"%"}
    assert sheet["A2"].data_type == "s"
    configuration = values["configuration"]
    assert (values["seed"], configuration["epsilon"], configuration["contrast"]) == (3, 0.5, None)


def test_matrix_has_its_axes_and_a_colour_scale(dataset: xr.Dataset) -> None:
    sheet = openpyxl.load_workbook(BytesIO(result_workbook(result_of(dataset), TIME)))["cdp"]
    heads = [float(cell.value) for cell in sheet[1][1:]]
    np.testing.assert_allclose(heads, dataset[LUMINANCE].values, rtol=1e-5)
    np.testing.assert_allclose([row[0].value for row in sheet.iter_rows(min_row=2)], dataset[CONTRAST].values)
    cells = [[cell.value for cell in row[1:]] for row in sheet.iter_rows(min_row=2)]
    np.testing.assert_allclose(cells, dataset["cdp"].values.T, rtol=1e-14)
    (scale,) = sheet.conditional_formatting
    assert (str(scale.sqref), [rule.type for rule in scale.rules]) == ("B2:Y9", ["colorScale"])


def test_tables_of_ranges_dips_and_isolines_are_the_analysis(dataset: xr.Dataset) -> None:
    analysis = analyse_map(dataset, expected=[500.0])
    found = result(dataset, analysis)
    expected = [
        (one.at[CONTRAST], i.low, i.high, *i.ends[0].bracket, *i.ends[1].bracket, i.decades, i.range_db)
        for one in analysis.usable_ranges
        for i in one.intervals
    ]
    names = (CONTRAST, "low", "high", "low_below", "low_above", "high_below", "high_above", "decades", "range_db")
    rows = [row for row in found.table("usable_ranges").rows() if row["low"] is not None]
    assert [tuple(row[name] for name in names) for row in rows] == expected
    assert [row["low"] for row in rows if row["widest"]] == [analysis.widest.widest.low]  # type: ignore[union-attr]
    dips = list(found.table("dips").rows())
    assert [(row["position"], row["depth_db"], row["expected"]) for row in dips] == [
        (dip.position, dip.depth_db, dip.expected) for dip in analysis.dips
    ]
    assert {row["expected"] for row in dips} == {500.0}
    points = [(row["level"], row[LUMINANCE], row[CONTRAST]) for row in found.table("isolines").rows()]
    assert points == [(line.level, x, y) for line in analysis.isolines for x, y in zip(line.x, line.y, strict=True)]


def test_map_that_is_nowhere_usable_says_so(dataset: xr.Dataset) -> None:
    dataset["cdp"] *= 0.8
    (finding,) = result_of(dataset).findings
    assert (finding.code, finding.values["usable_cdp"]) == ("map-nowhere-usable", 0.9)


def test_a_map_too_large_for_tables_is_left_to_netcdf(monkeypatch: pytest.MonkeyPatch, dataset: xr.Dataset) -> None:
    monkeypatch.setattr("labcdp.evaluate.sweep.maps.result._MOST_CELLS", dataset["cdp"].size - 1)
    found = result_of(dataset)
    assert [(one.code, one.values["n_cells"]) for one in found.findings] == [("map-in-netcdf-only", 192)]
    assert {"map", "cdp"}.isdisjoint(table.name for table in found.tables)
