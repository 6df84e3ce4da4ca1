"""A video's tables, page, spreadsheet and NetCDF say the same."""

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import openpyxl
import pytest
import xarray as xr
from jsonschema import Draft202012Validator

from labcdp.evaluate.video import dataset as video_dataset
from labcdp.evaluate.video import page as video_page
from labcdp.evaluate.video.page import write_video
from labcdp.evaluate.video.result import video_result
from labcdp.output import LIST_FILE
from labcdp.regions import RectangleShape, save_regions
from labcdp.report.files import read_dataset, schema

from .synthetic_results import synthetic_video


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("video") / "results"
    write_video(synthetic_video(reference=10.0), folder)
    return folder


@pytest.fixture(scope="module")
def book(written: Path) -> Any:
    with (written / "results.xlsx").open("rb") as file:
        return openpyxl.load_workbook(file)


def rows(data: xr.Dataset, table: str) -> list[dict[str, Any]]:
    return list(video_result(data).table(table).rows())


def test_files(written: Path) -> None:
    names = {path.relative_to(written).as_posix() for path in written.rglob("*") if path.is_file()}
    assert names == {"results.nc", "results.json", "results.xlsx", "report.html", "figures/over-time.png", LIST_FILE}


@pytest.mark.parametrize(
    ("data", "block"), [(synthetic_video(reference=10.0), 7), (synthetic_video(30, regions=()), 1000)]
)
def test_netcdf_comes_back_equal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: xr.Dataset, block: int) -> None:
    monkeypatch.setattr(video_dataset, "BLOCK", block)
    write_video(data, tmp_path)
    xr.testing.assert_identical(read_dataset(tmp_path / "results.nc", "result"), data)
    # Also by those who do not have labcdp.
    with xr.open_dataset(tmp_path / "results.nc") as opened:
        xr.testing.assert_identical(opened.load(), data)


def test_the_page_answers_first_and_escapes_text(written: Path) -> None:
    page = (written / "report.html").read_text().replace("\u00a0", " ")
    assert "<h1>rain &amp; &lt;fog&gt;.mp4</h1>" in page
    # 0.95 falls to 0.85 over the frames: 0.9 at the end of the first half, of which 25 have no result.
    places = [
        page.index(text)
        for text in (
            "transfer characteristic 8 of",
            "Measured contrast",
            "29.2 %",
            "data:image/png",
            "<h2>Regions",
            "<pre>",
        )
    ]
    assert places == sorted(places)
    assert "<wrong>" not in page


def test_json_follows_the_schema(written: Path) -> None:
    values = json.loads((written / "results.json").read_text())
    Draft202012Validator(schema()).validate(values)
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    kinds = [(one["kind"], one["contrast"]) for one in tables["contrasts"]]
    assert kinds == [("reference", 10.0), ("asked", 0.07), ("asked", 1.0), ("asked", 10.0)]
    assert tables["contrasts"][0]["n_detected"] == 35
    assert [one["region"] for one in tables["regions"]] == ["bright", "dark"]
    assert tables["lost"][0] == {
        "region": "dark",
        "first_frame": 40,
        "last_frame": 59,
        "n_frames": 20,
        "start_s": 1.6,
        "duration_s": pytest.approx(0.8),
        "reason": "it has left the image",
        "code": "tracking-region-gone",
    }
    # The last one ends with the video.
    assert tables["lost"][1]["duration_s"] == pytest.approx(0.04)
    # Those that differ in their values only are one.
    assert [(one["code"], one["n_frames"]) for one in tables["notes"]] == [
        ("tracking-region-gone", 21),
        ("frame-broken", 5),
    ]
    assert [one["code"] for one in values["findings"]] == ["video-transfer-unknown", "relative-luminance"]


def test_shares_by_hand() -> None:
    data = synthetic_video(10, contrasts=(1.0,), regions=())
    data["cdp"][:, 0] = [1, 0.9, 0.8999, np.nan, np.nan, 0.5, 0.95, 0.5, 1, 1]
    (one,) = rows(data, "contrasts")
    assert (one["n_evaluated"], one["n_detected"], one["detected_share"]) == (8, 5, 0.5)
    assert (one["lowest_cdp"], one["lowest_frame"]) == (0.5, 5)
    assert one["mean_cdp"] == pytest.approx((1 + 0.9 + 0.8999 + 0.5 + 0.95 + 0.5 + 1 + 1) / 8)


def test_a_column_a_frame(book: Any) -> None:
    head, *cells = book["CDP"].iter_rows(values_only=True)
    assert (head[0], head[1], head[-1]) == ("Contrasts (%)", "Frame number 0", "Frame number 119")
    assert [row[0] for row in cells] == [0.07, 1.0, 10.0]
    values = np.array([[np.nan if cell is None else cell for cell in row[1:]] for row in cells])
    np.testing.assert_array_equal(values, synthetic_video()["cdp"].values.T)
    assert [str(one.sqref) for one in book["CDP"].conditional_formatting] == ["B2:DQ4"]


def test_a_row_for_each_frame_and_contrast(book: Any) -> None:
    data = synthetic_video()
    head, *cells = book["Frames"].iter_rows(values_only=True)
    assert len(cells) == 120 * 3
    columns = {name: list(values) for name, values in zip(head, zip(*cells, strict=True), strict=True)}
    assert columns["frame"][:4] == [0, 0, 0, 1]
    assert columns["contrast (%)"][:4] == [0.07, 1.0, 10.0, 0.07]
    assert columns["CDP"][3:6] == data["cdp"].values[1].tolist()
    assert columns["measured contrast (%)"][4] == pytest.approx(9.51)
    assert columns["bright: mean (cd/m²)"][0] == 400.0
    assert columns["dark: lost"][3 * 40] == 1.0
    assert columns["dark: corner 4 x (pixel)"][0] == 140.0
    assert columns["CDP"][3 * 40] is None
    assert columns["note"][3 * 40] == "dark: it has left the image"


def test_more_frames_than_columns_continue_in_further_sheets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_page, "MOST_COLUMNS", 51)
    write_video(synthetic_video(120, contrasts=(0.5, 1.0), regions=()), tmp_path)
    with (tmp_path / "results.xlsx").open("rb") as file:
        book = openpyxl.load_workbook(file)
        heads = [[cell.value for cell in book[name][1]] for name in ("CDP", "CDP (2)", "CDP (3)")]
    assert [len(head) for head in heads] == [51, 51, 21]
    assert heads[2][-1] == "Frame number 119"


def test_documentation_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = Path(__file__).parents[3] / "docs" / "howto" / "video.md"
    (code,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    frame = np.full((64, 96), 90, np.uint8)
    frame[20:40, 20:40], frame[20:40, 40:60] = 220, 20
    writer = cv2.VideoWriter("drive.mp4", cv2.VideoWriter.fourcc(*"mp4v"), 25, (96, 64))
    for _ in range(3):
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    save_regions("rois.json", [RectangleShape("bright", 22, 22, 16, 16), RectangleShape("dark", 42, 22, 16, 16)])
    exec(code, {})
    assert capsys.readouterr().out.startswith("1.0\n")
