import json
from datetime import UTC, datetime
from io import BytesIO

import cv2
import numpy as np
import pytest
import xarray as xr
from openpyxl import load_workbook

from labcdp.evaluate.contrast_map import ContrastMapSettings, contrast_map
from labcdp.evaluate.contrast_map_edges import EdgeKind
from labcdp.luminance import Invalid, LuminanceMap
from labcdp.report.contrast_map_figure import overlay
from labcdp.report.contrast_map_page import contrast_map_page
from labcdp.report.contrast_map_results import write_contrast_map
from labcdp.report.contrast_map_sheets import contrast_map_workbook
from labcdp.report.contrast_map_wording import KIND_NAMES, MapSource, result_text, weakest_table

SOURCE = MapSource("a <b>scene</b>.png", "0" * 64, "cd/m^2", "calibration of a camera", False, ("mind the light",))


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
    write_contrast_map(found, SOURCE, folder)
    return folder


def test_the_first_sentence_tells_what_is_detected(found):
    seen, lost = found.count(EdgeKind.SEEN), found.count(EdgeKind.LOST)
    assert seen > 5
    assert lost > 5
    first, second, *_ = result_text(found)
    assert (
        f"of the {seen + lost} edges with a contrast of at least 10 % are detected with a CDP of at least 0.9" in first
    )
    assert f"{lost} are lost" in first
    assert f"{found.count(EdgeKind.SATURATED)} touch a region with more than 1 % of its pixels saturated" in second


def test_a_map_of_noise_says_so(nothing):
    assert result_text(nothing)[0] == "No edge of the image with a contrast of at least 10 % could be judged."
    assert weakest_table(nothing, SOURCE).rows == ()


def test_the_overlay_has_the_colours_of_the_edges(found):
    drawn = overlay(found)
    # Three drawn pixels for one, so that lines stay fine.
    assert drawn.rgb.shape == (900, 1260, 3)
    assert drawn.extent_px == (420.0, 300.0)
    coloured = np.ptp(drawn.rgb.astype(int), axis=2) > 0
    # Detected at 130 and lost at 250, each within a pixel of the step; saturated from 340 on.
    for x, cold in ((130, True), (250, False)):
        at = coloured[:, 3 * x - 4 : 3 * x + 4]
        near = drawn.rgb[:, 3 * x - 4 : 3 * x + 4].astype(int)[at]
        assert at.any(axis=1).mean() > 0.95
        assert (near[:, 2] > near[:, 0]).mean() == (1.0 if cold else pytest.approx(0.0, abs=0.1))
    assert not coloured[:, 60:330].any()
    assert not coloured[:, 450:690].any()
    assert coloured[:, 1035:].any()


def test_a_large_image_is_drawn_smaller_with_all_its_edges():
    image = np.full((300, 3300), 100.0)
    image[:, 1700:] = 200.0
    image += np.random.default_rng(0).normal(size=image.shape)
    drawn = overlay(contrast_map(LuminanceMap(image, image, (), np.zeros(image.shape, dtype=np.uint8))))
    assert drawn.rgb.shape == (100, 1100, 3)
    assert drawn.extent_px == (3300.0, 300.0)
    assert (np.ptp(drawn.rgb[:, 564:569].astype(int), axis=2) > 0).any(axis=1).all()


def test_the_spreadsheet_holds_the_edges_as_numbers(found):
    time = datetime(2026, 1, 2, tzinfo=UTC)
    data = contrast_map_workbook(found, SOURCE, time)
    assert data == contrast_map_workbook(found, SOURCE, time)
    book = load_workbook(BytesIO(data))
    head, *rows = book["Edges"].iter_rows(values_only=True)
    assert len(rows) == found.edges.kind.size - found.count(EdgeKind.NOISE, EdgeKind.SMALL)
    assert rows[0][0] == "lost"
    columns = {name: [row[i] for row in rows] for i, name in enumerate(head)}
    lost = found.of_kind(EdgeKind.LOST)
    n = int(lost.sum())
    order = np.argsort(found.edges.cdp[lost], kind="stable")
    assert columns["CDP"][:n] == pytest.approx(found.edges.cdp[lost][order], rel=1e-14)
    assert columns["contrast"][:n] == pytest.approx(found.edges.contrast[lost][order], rel=1e-14)
    bright = found.regions.mean[found.edges.bright[lost]][order]
    assert columns["bright mean in cd/m^2"][:n] == pytest.approx(bright, rel=1e-14)
    assert {type(one) for one in columns["x in pixels"]} <= {int, float}
    assert ("Warning", "mind the light") in list(book["About"].iter_rows(values_only=True))


def test_netcdf_holds_everything(found, written):
    with xr.open_dataset(written / "contrast-map.nc") as read:
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
    page = contrast_map_page(found, overlay(found), SOURCE)
    assert "a &lt;b&gt;scene&lt;/b&gt;.png" in page
    assert "<b>scene" not in page
    assert "default-src &#39;none&#39;" in page or "default-src 'none'" in page
    assert result_text(found)[0] in page
    assert "mind the light" in page
    assert page.count("data:image/png;base64,") == 1
    hover = page.split('"hovertemplate":"')[1:]
    assert len(hover) >= 3
    for part in hover:
        shown = part.split('"', 1)[0]
        assert "bright side" in shown
        assert "dark side" in shown
        assert "contrast" in shown
    assert "CDP %{customdata[4]" in hover[0]


def test_files_are_written_together(found, written):
    names = {f"contrast-map.{end}" for end in ("png", "html", "xlsx", "nc", "json")}
    assert {path.name for path in written.iterdir()} == names
    picture = cv2.imread(str(written / "contrast-map.png"))
    assert min(picture.shape[:2]) > 500
    values = json.loads((written / "contrast-map.json").read_text())
    assert values["edges"] == {name: found.count(kind) for kind, name in KIND_NAMES.items()}
    assert values["detected_share"] == found.detected_share
    assert len(values["weakest"]) == 10
    assert values["weakest"][0]["cdp"] == found.edges.cdp[found.weakest(1)[0]]


def test_files_of_a_map_without_edges(nothing, tmp_path):
    write_contrast_map(nothing, SOURCE, tmp_path)
    values = json.loads((tmp_path / "contrast-map.json").read_text())
    assert (values["detected_share"], values["weakest"]) == (None, [])
