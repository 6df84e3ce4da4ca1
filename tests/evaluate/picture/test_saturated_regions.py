"""Saturated regions: a bound and no uncertainty, in all that is made of a picture and of a video."""

import io
import json
from datetime import UTC, datetime
from math import isnan

import cv2
import numpy as np
import openpyxl
import pytest

import labcdp
from labcdp.core.errors import InputError
from labcdp.core.luminance import Invalid, LuminanceMap
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.converter import make_converter
from labcdp.evaluate.picture.result import evaluate_picture
from labcdp.evaluate.picture.settings import ImageSettings
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.page import frame_sheets
from labcdp.evaluate.video.result import video_result
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.files.read import read_picture
from labcdp.metrics.pair import evaluate_pair, evaluate_regions
from labcdp.report.files import envelope_json
from labcdp.report.sheets import result_workbook
from labcdp.report.text import bounded, cell_text, text_table
from labcdp.web.bench.pair import pair_points
from labcdp.web.regions.page_image import PageImage

FULL, DARK = Roi.rectangle("lamp", 5, 5, 20, 20), Roi.rectangle("road", 35, 5, 20, 20)
OTHER = Roi.rectangle("second lamp", 65, 5, 20, 20)
RELATIVE = make_converter()


@pytest.fixture
def path(tmp_path):
    """Picture of two lamps, most of whose pixels are at the end of the scale, and a dark road."""
    dn = np.random.default_rng(2).normal(60, 3, (30, 90))
    dn[:, :30] = dn[:, 60:] = np.random.default_rng(3).normal(262, 6, (30, 30))
    (tmp_path / "frames").mkdir()
    cv2.imwrite(str(tmp_path / "frames" / "0.png"), np.clip(np.rint(dn), 0, 255).astype(np.uint8))
    return tmp_path / "frames" / "0.png"


@pytest.mark.parametrize(
    ("value", "bound", "expected"),
    [(128.37, ">", "> 128 cd/m²"), (128.97, ">", "> 128 cd/m²"), (0.99951, ">", "> 0.999 cd/m²"),
     (1.231, "<", "< 1.24 cd/m²"), (250.0, ">", "> 250 cd/m²"), (12345, ">", "> 12300 cd/m²"),
     (1.0, "?", "unknown"), (0.3, ">", "> 0.3 cd/m²")],
)  # fmt: skip
def test_a_bound_stays_one_when_it_is_rounded(value, bound, expected):
    assert bounded(value, bound, "cd/m²").replace("0.300", "0.3") == expected
    if bound in "<>":
        number = float(bounded(value, bound)[2:])
        assert number <= value if bound == ">" else number >= value


def test_contrasts_are_bounds_by_the_region_that_is_saturated(path):
    seen = RELATIVE.luminance(read_picture(path))
    found = evaluate_pair(seen, FULL, DARK)
    assert (found.bound, found.a.bound, found.b.bound) == (">", ">", "")
    assert found.a.mean > 0.99
    assert all(map(isnan, (found.a.u, found.contrast.u, found.a.snr.value)))
    assert found.b.u > 0
    both = evaluate_pair(seen, FULL, OTHER)
    assert both.bound == "?"
    # A dark region with a saturated part is brighter than its mean.
    mixed, bright = Roi.rectangle("mixed", 26, 5, 20, 20), Roi.rectangle("bright", 5, 5, 4, 4)
    assert evaluate_pair(seen, Roi.rectangle("road", 47, 5, 12, 20), mixed).bound == ">"
    light = np.where(np.arange(90) < 30, 0.9, 0.3)[None, :] * np.ones((30, 1))
    flags = np.zeros((30, 90), np.uint8)
    flags[:, 31:34] = Invalid.SATURATED
    partly = evaluate_pair(
        LuminanceMap(light, np.zeros_like(light), (), flags), bright, Roi.rectangle("c", 30, 5, 9, 9)
    )
    assert (partly.bound, partly.contrast.value) == ("<", pytest.approx(2))


def test_tables_sheets_json_and_page_say_more_than(path):
    rois = (FULL, DARK, OTHER)
    settings = ImageSettings(rois=rois)
    _, result, files = evaluate_picture(settings, path, pages=True, surface=False)
    heads, rows = text_table(result.table("regions"))
    means = {row[0]: row[heads.index(next(h for h in heads if h.startswith("mean")))] for row in rows}
    assert means["lamp"] == means["second lamp"] == "> 0.994"
    assert "±" in means["road"]
    heads, rows = text_table(result.table("cdp"))
    at = next(i for i, head in enumerate(heads) if head.startswith("measured contrast"))
    contrasts = {row[0]: row[at] for row in rows}
    assert contrasts["lamp / road"].startswith("> 3")
    assert contrasts["lamp / second lamp"] == "unknown" or contrasts["second lamp / lamp"] == "unknown"
    assert "contrast measured &gt; 3" in files["report.html"].decode()
    document = json.loads(envelope_json(result))
    for name, value in (("regions", "mean"), ("cdp", "measured_contrast")):
        for row in document["tables"][name]["rows"]:
            if row[f"{value}_bound"]:
                assert row[f"expanded_{value}"] is row[f"u_{value}"] is None
            else:
                assert row[f"expanded_{value}"] > 0
    book = openpyxl.load_workbook(io.BytesIO(result_workbook(result, datetime.now(UTC))))
    sheet = book["regions"]
    heads = [cell.value for cell in sheet[1]]
    for row in sheet.iter_rows(min_row=2):
        saturated = "lamp" in str(row[0].value)
        cell = row[next(i for i, head in enumerate(heads) if head.startswith("mean"))]
        # A number with a format, which programs can use.
        assert isinstance(cell.value, float)
        assert cell.number_format.startswith('"> "') == saturated


def test_videos_and_python_have_no_uncertainty_either(path):
    found = evaluate_video(path.parent, VideoSettings((3.0,), (FULL, DARK), "fixed"))
    assert np.isnan(found.u_measured_contrast).all()
    u = found.u_mean.isel(frame=0)
    assert np.isnan(u.sel(region="lamp"))
    assert u.sel(region="road") > 0
    heads, rows = text_table(video_result(found).table("regions"))
    assert rows[0][heads.index("mean")].startswith("> 0.99")
    assert not rows[1][heads.index("mean")].startswith(">")
    sheet = next(table for table in frame_sheets(found) if table.name == "Frames")
    (row,) = sheet.rows()
    shown = {column.label: cell_text(column, row) for column in sheet.columns}
    assert shown["lamp: mean"].startswith("> 0.99")
    assert shown["measured contrast"].startswith("> 3")
    assert not shown["road: mean"].startswith(">")
    in_python = labcdp.read_image(path).regions([FULL, DARK]).cdp()
    assert np.isnan(in_python.u_measured_contrast).all()
    assert np.isnan(in_python.u_mean.sel(side="bright")).all()


def test_no_path_answers_a_saturated_pair(path):
    # The clipped pixels show 300 %, and 1.000 would be counted, whatever the lamp was.
    settings = ImageSettings((3.0, 8.0), rois=(FULL, DARK))
    _, result, files = evaluate_picture(settings, path, pages=True, surface=False)
    rows = list(result.table("cdp").rows())
    assert [row["contrast"] for row in rows] == [3, 8]
    assert [row["verdict"] for row in rows] == ["saturated"] * 2
    numbers = ("cdp", "cdp_low", "cdp_high", "u_cdp", "below", "above", "csnr", "u_measured_contrast")
    assert np.isnan([[row[name] for name in numbers] for row in rows]).all()
    assert "saturated" in files["report.html"].decode()
    assert len(evaluate_pair(RELATIVE.luminance(read_picture(path)), FULL, DARK).cdp) == 0
    video = evaluate_video(path.parent, VideoSettings((3.0, 8.0), (FULL, DARK), "fixed"))
    assert np.isnan(video[["cdp", "cdp_low", "cdp_high", "u_cdp", "below", "above", "csnr"]].to_array()).all()
    assert [row["n_evaluated"] for row in video_result(video).table("contrasts").rows()] == [0, 0]
    for in_python in (
        labcdp.read_image(path).regions([FULL, DARK]).cdp([3, 8]),
        labcdp.open_video(path.parent).track([FULL, DARK], method="fixed").cdp([3, 8]),
    ):
        assert np.isnan(in_python[["cdp", "cdp_low", "cdp_high", "u_cdp"]].to_array()).all()
    live = evaluate_regions(*map(PageImage.of(read_picture(path), RELATIVE).pixels, (FULL, DARK)), (3.0,), 0.5)
    assert np.isnan([live.cdp[0].cdp, *live.cdp[0].interval]).all()
    assert pair_points(live, 0.0)[0].verdict == "saturated"


def test_a_saturated_frame_gives_no_target_contrast(path):
    dn = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    dn[:, :30] = 180 + dn[:, 30:60] % 3
    cv2.imwrite(str(path.with_name("1.png")), dn)
    found = evaluate_video(path.parent, VideoSettings(None, (FULL, DARK), "fixed"))
    assert found.contrast.item() == pytest.approx(found.measured_contrast.isel(frame=1).item())
    assert np.isnan(found.cdp.isel(frame=0)).all()
    assert np.isfinite(found.cdp.isel(frame=1)).all()
    path.with_name("1.png").unlink()
    with pytest.raises(
        InputError, match=r"no frame could be evaluated; frame 0: region 'lamp' is .*: specify a contrast"
    ):
        evaluate_video(path.parent, VideoSettings(None, (FULL, DARK), "fixed"))


def test_the_viewer_shows_a_bound_at_a_saturated_pixel(path):
    image = PageImage.of(read_picture(path), RELATIVE)
    y, x = np.argwhere(read_picture(path).frame.dn[:, :30] == 255)[0]
    assert "light > 0.99" in image.readout(float(x), float(y))
    assert ">" not in image.readout(45.0, 15.0)
