"""The result of a contrast map, its page and its files."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from io import BytesIO

import cv2
import numpy as np
import pytest
import xarray as xr
from jsonschema import Draft202012Validator
from openpyxl import load_workbook

from labcdp.core.luminance import Invalid, LuminanceMap
from labcdp.core.result import warning
from labcdp.evaluate.picture.edges.edges import ContrastMapSettings, EdgeKind
from labcdp.evaluate.picture.edges.figure import overlay
from labcdp.evaluate.picture.edges.map import contrast_map
from labcdp.evaluate.picture.edges.page import map_page, write_contrast_map
from labcdp.evaluate.picture.edges.result import KINDS, MapSource, edge_table, map_result
from labcdp.report.files import schema
from labcdp.report.sheets import result_workbook

SOURCE = MapSource(
    "a <b>scene</b>.png", "0" * 64, "cd/m²", "calibration of a camera", False, (warning("srgb-assumed"),)
)


def _image(shape=(300, 420)):
    image = np.full(shape, 100.0)
    image[:, 130:] = 200.0
    image[:, 250:] = 260.0
    image[:, 340:] = 3000.0
    noise = np.where(np.arange(shape[1]) < 250, 4.0, 25.0) * np.random.default_rng(0).normal(size=shape)
    return image + noise


@pytest.fixture(scope="module")
def found():
    image = _image()
    invalid = np.where(image > 2500, Invalid.SATURATED, 0).astype(np.uint8)
    luminance = LuminanceMap(np.minimum(image, 2950), np.full(image.shape, 0.01), (), invalid)
    return contrast_map(luminance, ContrastMapSettings(30))


@pytest.fixture(scope="module")
def nothing():
    """Map of noise alone."""
    image = np.random.default_rng(0).normal(100, 5, (120, 160))
    return contrast_map(LuminanceMap(image, np.zeros(image.shape), (), np.zeros(image.shape, dtype=np.uint8)))


@pytest.fixture(scope="module")
def written(found, tmp_path_factory):
    """Folder with the files of `found`."""
    folder = tmp_path_factory.mktemp("map")
    write_contrast_map(found, SOURCE, map_result(found, SOURCE), folder)
    return folder


def _quantities(found):
    return {row["quantity"]: row["value"] for row in map_result(found, SOURCE).table("summary").rows()}


def test_the_result_counts_the_edges(found):
    values = _quantities(found)
    seen, lost = found.count(EdgeKind.SEEN), found.count(EdgeKind.LOST)
    assert min(seen, lost) > 5
    assert values["detected edges"] == found.detected_share == seen / (seen + lost)
    for kind, (name, _) in KINDS.items():
        assert values[f"edges: {name}"] == found.count(kind)
    weakest = map_result(found, SOURCE).table("weakest")
    assert list(weakest["cdp"]) == sorted(found.edges.cdp[found.of_kind(EdgeKind.SEEN, EdgeKind.LOST)])[:10]


def test_the_spreadsheet_holds_the_edges_as_numbers(found):
    result = replace(map_result(found, SOURCE), tables=(edge_table(found, SOURCE),))
    book = load_workbook(BytesIO(result_workbook(result, datetime(2026, 1, 2, tzinfo=UTC))))
    head, *rows = book["edges"].iter_rows(values_only=True)
    assert len(rows) == found.edges.kind.size - found.count(EdgeKind.NOISE, EdgeKind.SMALL)
    assert rows[0][0] == "lost"
    columns = {name: [row[i] for row in rows] for i, name in enumerate(head)}
    lost = found.of_kind(EdgeKind.LOST)
    n = int(lost.sum())
    order = np.argsort(found.edges.cdp[lost], kind="stable")
    assert columns["CDP"][:n] == pytest.approx(found.edges.cdp[lost][order], rel=1e-14)
    assert columns["contrast (%)"][:n] == pytest.approx(found.edges.contrast[lost][order], rel=1e-14)
    bright = found.regions.mean[found.edges.bright[lost]][order]
    assert columns["bright side (cd/m²)"][:n] == pytest.approx(bright, rel=1e-14)


def test_netcdf_holds_everything(found, written):
    with xr.open_dataset(written / "results.nc") as read:
        assert np.array_equal(read["label"], found.regions.labels)
        for name, values in (
            ("cdp", found.edges.cdp),
            ("contrast", found.edges.contrast),
            ("region_mean", found.regions.mean),
            ("kind", found.edges.kind),
        ):
            assert np.array_equal(read[name], values, equal_nan=True)
        meanings = read["kind"].attrs["flag_meanings"].split()
        flags = dict(zip(read["kind"].attrs["flag_values"].tolist(), meanings, strict=True))
        assert flags[EdgeKind.UNEVEN] == "not_uniform"
        assert read["cdp"].encoding["fletcher32"]


def test_the_page_needs_nothing_else_and_escapes_names(found):
    page = map_page(found, overlay(found), SOURCE, map_result(found, SOURCE))
    assert "a &lt;b&gt;scene&lt;/b&gt;.png" in page
    assert "<b>scene" not in page
    assert "default-src &#39;none&#39;" in page or "default-src 'none'" in page
    assert page.index("Detected edges") < page.index("Plotly.newPlot") < page.index("The weakest edges")
    assert "Values are decoded by a standard curve" in page
    assert page.count("data:image/png;base64,") == 1
    hover = page.split('"hovertemplate":"')[1:]
    assert len(hover) >= 3
    for part in hover:
        shown = part.split('"', 1)[0]
        assert all(name in shown for name in ("bright side", "dark side", "contrast"))
    assert "CDP %{customdata[4]" in hover[0]


@pytest.mark.parametrize("which", ["found", "nothing"])
def test_files_are_written_together(which, request, tmp_path):
    found = request.getfixturevalue(which)
    result = map_result(found, SOURCE)
    write_contrast_map(found, SOURCE, result, tmp_path)
    names = {"report.html", "contrast-map.png", "results.xlsx", "results.nc", "results.json", "labcdp-files.json"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert min(cv2.imread(str(tmp_path / "contrast-map.png")).shape[:2]) > 500
    values = json.loads((tmp_path / "results.json").read_text())
    Draft202012Validator(schema()).validate(values)
    assert len(values["tables"]["weakest"]["rows"]) == (10 if which == "found" else 0)
    assert values["findings"][0]["code"] == "srgb-assumed"
