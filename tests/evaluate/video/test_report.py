"""Tables, pages, sheets and NetCDF of a video say what its dataset says; of an archive, what became of each."""

import json
import re
from itertools import groupby
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import xarray as xr

from labcdp.evaluate.video import page as video_page
from labcdp.evaluate.video.annotated import AnnotatedVideo
from labcdp.evaluate.video.archive import ArchiveResult, VideoOutcome, archive_tasks
from labcdp.evaluate.video.archive_page import archive_files, archive_result
from labcdp.evaluate.video.figure import drawn_contrasts
from labcdp.evaluate.video.page import write_video
from labcdp.evaluate.video.result import video_result
from labcdp.report.files import envelope
from labcdp.report.layout import ReportFigure

from ...conftest import valid
from ...output.test_results_folder import write


@pytest.fixture(scope="module")
def written(followed: xr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("video") / "results"
    write_video(followed, folder)
    return folder


@pytest.mark.parametrize("name", ["followed", "near"])
def test_netcdf_comes_back_equal_and_sheets_have_a_column_a_frame(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    data = request.getfixturevalue(name)
    monkeypatch.setattr(video_page, "MOST_COLUMNS", 10)
    write_video(data, tmp_path)
    # Also by those who do not have labcdp.
    with xr.open_dataset(tmp_path / "results.nc") as opened:
        xr.testing.assert_identical(opened.load(), data)
    # A column a frame, in as many sheets as it takes.
    book = openpyxl.load_workbook(tmp_path / "results.xlsx")
    sheets = [np.array(list(book[name].iter_rows(values_only=True))) for name in ("CDP", "CDP (2)", "CDP (3)")]
    cells = np.hstack([sheet[1:, 1:] for sheet in sheets]).astype(float)
    np.testing.assert_allclose(cells, data["cdp"].values.T, rtol=1e-14)
    assert sheets[2][0, -1] == "Frame number 23"
    assert "<fog>" not in (tmp_path / "report.html").read_text()


def test_json_counts_detected_and_lost_frames(followed: xr.Dataset, written: Path) -> None:
    values = json.loads((written / "results.json").read_text())
    valid(values)
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    lost = followed["lost"].values.any(axis=1)
    ends = ("", "_low", "_high")
    for number, row in enumerate(tables["contrasts"]):
        name = "cdp" if number else "reference_cdp"
        cdp, low, high = (followed[f"{name}{end}"] for end in ends)
        if number:
            cdp, low, high = (one.isel(contrast=number - 1) for one in (cdp, low, high))
        known = cdp.values[np.isfinite(cdp)]
        is_open = np.isfinite(cdp.values) & ~((low.values >= 0.9) | (high.values < 0.9))
        assert row["undecided_share"] == is_open.sum() / known.size
        assert (row["n_evaluated"], row["n_detected"]) == (known.size, (known >= 0.9).sum())
        assert row["detected_share"] == row["n_detected"] / known.size
        assert row["n_lost"] == (lost & ~np.isfinite(cdp.values)).sum() > 0
        assert row["n_evaluated"] + row["n_lost"] + row["n_other"] == 24
        assert (row["mean_cdp"], row["lowest_cdp"]) == (pytest.approx(known.mean()), known.min())
        assert cdp.values[row["lowest_frame"]] == known.min()
    gone = followed["lost"].sel(region="moving").values
    stretches = [list(frames) for lost, frames in groupby(range(24), gone.__getitem__) if lost]
    found = [(row["first_frame"], row["last_frame"], row["n_frames"]) for row in tables["lost"]]
    assert found == [(one[0], one[-1], len(one)) for one in stretches]


def test_the_limit_of_the_settings_decides_and_cards_show_where_the_answer_changes() -> None:
    shares = [0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0]
    cdp = np.stack([np.where(np.arange(24) < 24 * share, 0.8, 0.1) for share in shares], axis=1)
    cdp[3] = np.nan
    contrasts, axes = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8], ("frame", "contrast")
    others = ("cdp_low", "cdp_high", "u_cdp", "below", "above", "undefined")
    asked = json.dumps({"cdp_limit": 0.7, "contrasts": contrasts})
    dataset = xr.Dataset(
        {"cdp": (axes, cdp), **dict.fromkeys(others, (axes, 0 * cdp))},
        {"contrast": contrasts, "frame": np.arange(24)},
        {"mode": "neighbours", "configuration": asked},
    )
    result = video_result(dataset)
    rows = list(result.table("contrasts").rows())
    assert [row["detected_share"] for row in rows] == pytest.approx([0, 0, 0, 0, 11 / 23, 1, 1, 1])
    assert {(row["n_evaluated"], row["n_lost"], row["n_other"]) for row in rows} == {(23, 0, 1)}
    cards = video_page.video_page(dataset, result, ReportFigure("a.png", b"", "", "")).cards
    assert [card.title for card in cards] == ["Contrast 40 %", "Contrast 50 %", "Contrast 60 %"]
    assert [card.state for card in cards] == ["bad", "open", "good"]
    # A curve has no other contrasts than the cards, and one more.
    drawn = [contrasts[place] for place in drawn_contrasts(dataset, result)]
    assert {0.4, 0.5, 0.6} < set(drawn) < set(contrasts)
    assert len(drawn) == 4


def test_a_row_for_each_frame_and_contrast(followed: xr.Dataset, written: Path) -> None:
    head, *cells = openpyxl.load_workbook(written / "results.xlsx")["Frames"].iter_rows(values_only=True)
    columns = {name: list(values) for name, values in zip(head, zip(*cells, strict=True), strict=True)}
    assert columns["frame"] == np.repeat(range(24), 3).tolist()
    assert columns["contrast (%)"] == [7.0, 100.0, 1000.0] * 24
    for name, values, step in (
        ("CDP", followed["cdp"].values.ravel(), 1),
        ("measured contrast (%)", 100 * followed["measured_contrast"], 3),
        ("moving: mean", followed["mean"].sel(region="moving"), 3),
        ("moving: corner 4 x (pixel)", followed["corner_x"].sel(region="moving")[:, 3], 3),
    ):
        np.testing.assert_allclose(np.array(columns[name][::step], float), values, rtol=1e-14)


def test_page_and_json_of_an_archive_say_what_became_of_each_video(
    tmp_path: Path, followed: xr.Dataset, near: xr.Dataset
) -> None:
    tasks = archive_tasks([tmp_path / name for name in ("a.avi", "b.avi", "c & d.avi", "e #1.avi")], tmp_path)
    nothing = near.assign(cdp=near["cdp"] * float("nan"))
    values = [envelope(video_result(one)) for one in (followed, near, nothing)]
    errors = ["", "", "no video <at all>", ""]
    outcomes = zip(tasks, (*values[:2], None, values[2]), errors, (True, False, False, False), strict=True)
    write(tmp_path, archive_files(archive_result(ArchiveResult(tuple(VideoOutcome(*one) for one in outcomes), ()))))
    page = (tmp_path / "archive.html").read_text()
    assert "c &amp; d.avi: no video &lt;at all&gt;" in page
    links = re.findall(r'<a href="([^"]*)">', page)
    assert links == ["a/report.html", "b/report.html", "e%20%231/report.html"]
    found = json.loads((tmp_path / "archive.json").read_text())
    valid(found)
    a, _, c, e = found["tables"]["videos"]["rows"]
    first = values[0]["tables"]["contrasts"]["rows"][0]
    assert {name: a[name] for name in first} == first
    lost = followed["lost"].mean("frame").max().item()
    assert (a["video"], a["n_frames"], a["lost_share"], a["resumed"]) == ("a", 24, pytest.approx(lost), True)
    assert (c["error"], c["n_frames"]) == ("no video <at all>", None)
    assert (e["n_detected"], e["n_evaluated"], e["mean_cdp"]) == (0, 0, None)


def test_nothing_stays_of_an_annotated_video_after_an_error(tmp_path: Path) -> None:
    def interrupted() -> None:
        with AnnotatedVideo(tmp_path / "annotated.mp4") as video:
            video(0, np.full((121, 161), 90, np.uint8), (), {"time_s": 0.4, "cdp": np.array([0.5, 0.25])})
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []
