"""A video's tables, page, spreadsheet and NetCDF say what its dataset says."""

import json
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest
import xarray as xr
from jsonschema import Draft202012Validator

from labcdp.evaluate.video import dataset as video_dataset
from labcdp.evaluate.video import page as video_page
from labcdp.evaluate.video.page import write_video
from labcdp.output import LIST_FILE
from labcdp.report.files import read_dataset, schema


@pytest.fixture(scope="module")
def written(followed: xr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("video") / "results"
    write_video(followed, folder)
    return folder


@pytest.fixture(scope="module")
def book(written: Path) -> Any:
    return openpyxl.load_workbook(written / "results.xlsx")


@pytest.mark.parametrize("name", ["followed", "near"])
def test_netcdf_written_in_blocks_comes_back_equal(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    data = request.getfixturevalue(name)
    monkeypatch.setattr(video_dataset, "BLOCK", 7)
    write_video(data, tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert names == {"results.nc", "results.json", "results.xlsx", "report.html", "figures/over-time.png", LIST_FILE}
    xr.testing.assert_identical(read_dataset(tmp_path / "results.nc", "result"), data)
    # Also by those who do not have labcdp.
    with xr.open_dataset(tmp_path / "results.nc") as opened:
        xr.testing.assert_identical(opened.load(), data)


def test_the_page_answers_first_and_escapes_text(followed: xr.Dataset, written: Path) -> None:
    page = (written / "report.html").read_text().replace("\u00a0", " ")
    assert "<h1>rain &amp; &lt;fog&gt;</h1>" in page
    assert "<fog>" not in page
    detected = 100 * (followed["reference_cdp"] >= 0.9).mean().item()
    parts = ("Measured contrast", f"{detected:.1f} %", "data:image/png", "<h2>Regions", "<pre")
    assert sorted(parts, key=page.index) == list(parts)


def test_json_counts_detected_and_lost_frames(followed: xr.Dataset, written: Path) -> None:
    values = json.loads((written / "results.json").read_text())
    Draft202012Validator(schema()).validate(values)
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    assert [one["region"] for one in tables["regions"]] == ["moving", "still"]
    kinds = [(one["kind"], one["contrast"]) for one in tables["contrasts"]]
    reference = followed["reference_contrast"].values[0]
    assert kinds == [("reference", reference), ("asked", 0.07), ("asked", 1.0), ("asked", 10.0)]
    for row, cdp in zip(tables["contrasts"], [followed["reference_cdp"], *followed["cdp"].T], strict=True):
        known = cdp.values[np.isfinite(cdp)]
        assert (row["n_evaluated"], row["n_detected"]) == (known.size, (known >= 0.9).sum())
        assert row["detected_share"] == row["n_detected"] / 24
        assert (row["mean_cdp"], row["lowest_cdp"]) == (pytest.approx(known.mean()), known.min())
        assert cdp.values[row["lowest_frame"]] == known.min()
    assert 0 < tables["contrasts"][0]["n_detected"] < 24
    gone = followed["lost"].sel(region="moving").values
    stretches = [list(frames) for lost, frames in groupby(range(24), gone.__getitem__) if lost]
    assert gone[-3:].all()
    assert not gone[:10].any()
    found = [(row["first_frame"], row["last_frame"], row["n_frames"]) for row in tables["lost"]]
    assert found == [(one[0], one[-1], len(one)) for one in stretches]
    assert {(row["region"], row["code"][:9]) for row in tables["lost"]} == {("moving", "tracking-")}
    # Those that differ in their values only are one.
    notes = {row["code"]: row["n_frames"] for row in tables["notes"]}
    assert sum(count for code, count in notes.items() if code.startswith("tracking-")) == gone.sum()
    assert notes["frame-broken"] == 1


def test_a_column_a_frame(followed: xr.Dataset, book: Any) -> None:
    head, *cells = book["CDP"].iter_rows(values_only=True)
    assert (head[0], head[1], head[-1]) == ("Contrasts (%)", "Frame number 0", "Frame number 23")
    assert [row[0] for row in cells] == [0.07, 1.0, 10.0]
    values = np.array([[np.nan if cell is None else cell for cell in row[1:]] for row in cells])
    np.testing.assert_allclose(values, followed["cdp"].values.T, rtol=1e-14)
    assert [str(one.sqref) for one in book["CDP"].conditional_formatting] == ["B2:Y4"]


def test_a_row_for_each_frame_and_contrast(followed: xr.Dataset, book: Any) -> None:
    head, *cells = book["Frames"].iter_rows(values_only=True)
    columns = {name: list(values) for name, values in zip(head, zip(*cells, strict=True), strict=True)}
    assert columns["frame"] == np.repeat(range(24), 3).tolist()
    assert columns["contrast (%)"] == [0.07, 1.0, 10.0] * 24
    assert columns["CDP"][3:6] == pytest.approx(followed["cdp"].values[1], rel=1e-14)
    assert columns["CDP"][15] is None
    for name, values in (
        ("measured contrast (%)", followed["measured_contrast"]),
        ("moving: mean", followed["mean"].sel(region="moving")),
        ("still: lost", followed["lost"].sel(region="still").astype(float)),
        ("moving: corner 4 x (pixel)", followed["corner_x"].sel(region="moving")[:, 3]),
    ):
        cells = [np.nan if cell is None else cell for cell in columns[name][::3]]
        np.testing.assert_allclose(cells, values, rtol=1e-14)
    assert columns["note"][3 * 23].startswith("moving: ")


def test_more_frames_than_columns_continue_in_further_sheets(
    near: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video_page, "MOST_COLUMNS", 10)
    write_video(near, tmp_path)
    book = openpyxl.load_workbook(tmp_path / "results.xlsx")
    heads = [[cell.value for cell in book[name][1]] for name in ("CDP", "CDP (2)", "CDP (3)")]
    assert [len(head) for head in heads] == [10, 10, 7]
    assert heads[2][-1] == "Frame number 23"
