import csv
import re
import resource
import shutil
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest

from labcdp.report import video_sheets
from labcdp.report.video_sheets import write_video_spreadsheet

from .synthetic_results import synthetic_video

SOFFICE = shutil.which("soffice")
TIME = datetime(2026, 1, 2, tzinfo=UTC)


@pytest.fixture(scope="module")
def spreadsheet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sheets") / "results.xlsx"
    write_video_spreadsheet(synthetic_video(), path, TIME)
    return path


@pytest.fixture(scope="module")
def book(spreadsheet: Path) -> Any:
    with open(spreadsheet, "rb") as file:
        return openpyxl.load_workbook(file)


def test_a_column_a_frame(book: Any) -> None:
    data = synthetic_video()
    head, *rows = book["CDP"].iter_rows(values_only=True)
    assert head[:3] == ("Contrasts in %", "Frame number 0", "Frame number 1")
    assert head[-1] == "Frame number 119"
    assert [row[0] for row in rows] == [7.0, 100.0, 1000.0]
    values = np.array([[np.nan if cell is None else cell for cell in row[1:]] for row in rows])
    np.testing.assert_array_equal(values, data["cdp"].values.T)


def test_a_row_for_each_frame_and_contrast(book: Any) -> None:
    data = synthetic_video()
    head, *rows = book["Frames"].iter_rows(values_only=True)
    assert len(rows) == 120 * 3
    columns = {name: list(values) for name, values in zip(head, zip(*rows, strict=True), strict=True)}
    assert columns["frame"][:4] == [0, 0, 0, 1]
    assert columns["contrast in %"][:4] == [7.0, 100.0, 1000.0, 7.0]
    assert columns["CDP"][3:6] == data["cdp"].values[1].tolist()
    assert columns["measured contrast in %"][4] == pytest.approx(951.0)
    assert columns["bright: mean in cd/m²"][0] == 400.0
    assert columns["dark: lost (1) or not (0)"][3 * 40] == 1.0
    assert columns["dark: centre x in pixels"][0] == 150.0
    assert columns["dark: corner 4 x in pixels"][0] == 140.0
    assert columns["CDP"][3 * 40] is None
    assert columns["note"][3 * 40] == "region 'dark' is lost: it left the image"
    assert {"CDP, low end of 95 %", "share below", "CSNR", "bright: SNR (mean / standard deviation)"} <= set(head)


def test_looks_as_other_sheets(book: Any) -> None:
    page = book["CDP"]
    assert page.freeze_panes == "B2"
    assert page["DQ4"].number_format == "0.0000"
    assert page["A1"].font.bold
    assert [str(one.sqref) for one in page.conditional_formatting] == ["B2:DQ4"]
    assert page.dimensions == "A1:DQ4"
    assert book["Frames"].freeze_panes == "A2"
    assert book["Frames"]["D2"].number_format == "0.0000"


def test_summary_in_plain_words(book: Any) -> None:
    text = "\n".join(f"{name}: {value}" for name, value in book["Summary"].iter_rows(values_only=True))
    assert "Region “dark” was lost twice, in 18 % of the frames (0.84 s in all), longest in frames 40 to 59" in text
    assert "Lost: region “dark” in frames 40 to 59, from 1.60 s for 0.80 s" in text
    assert "SHA-256 of the file: abab" in text


def test_equal_results_give_equal_bytes(spreadsheet: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.xlsx"
    write_video_spreadsheet(synthetic_video(), again, TIME)
    assert again.read_bytes() == spreadsheet.read_bytes()


def test_pixel_to_pixel_has_no_regions(tmp_path: Path) -> None:
    path = tmp_path / "results.xlsx"
    write_video_spreadsheet(synthetic_video(30, regions=()), path, TIME)
    with open(path, "rb") as file:
        head = next(openpyxl.load_workbook(file)["Frames"].iter_rows(values_only=True))
    assert head == (
        *("frame", "time in s", "contrast in %", "CDP", "standard uncertainty of CDP", "CDP, low end of 95 %"),
        *("CDP, high end of 95 %", "share below", "share above", "note"),
    )


def test_text_that_looks_like_a_formula_stays_text(tmp_path: Path) -> None:
    path = tmp_path / "results.xlsx"
    data = synthetic_video(30, regions=())
    data["note"][3] = "=1+1 \x07<&>"
    write_video_spreadsheet(data, path, TIME)
    with open(path, "rb") as file:
        cell = openpyxl.load_workbook(file)["Frames"]["J11"]
    assert (cell.value, cell.data_type, cell.quotePrefix) == ("=1+1 \N{REPLACEMENT CHARACTER}<&>", "s", True)


def test_goes_on_in_further_sheets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "results.xlsx"
    monkeypatch.setattr(video_sheets, "MOST_ROWS", 10_001)
    write_video_spreadsheet(synthetic_video(16_500, contrasts=(0.5, 1.0), regions=()), path, TIME)
    with open(path, "rb") as file:
        book = openpyxl.load_workbook(file, read_only=True)
        assert book.sheetnames[:3] == ["CDP (1 of 2)", "CDP (2 of 2)", "Frames (1 of 4)"]
        first, second = (list(book[name].iter_rows(values_only=True)) for name in book.sheetnames[:2])
        # A head and 5000 frames of two contrasts: no frame is torn apart.
        assert book["Frames (1 of 4)"].max_row == 10_001
        rows = [row for number in range(1, 5) for row in book[f"Frames ({number} of 4)"].iter_rows(2, values_only=True)]
        text = "\n".join(str(row) for row in book["Summary"].iter_rows(values_only=True))
    assert len(first[0]) == 16_384
    assert first[0][-1] == "Frame number 16382"
    assert second[0][:2] == ("Contrasts in %", "Frame number 16383")
    assert len(second[0]) == 1 + 16_500 - 16_383
    assert [row[0] for row in rows] == np.repeat(np.arange(16_500), 2).tolist()
    assert "('Sheet CDP', 'goes on over 2 sheets, as one sheet has 16384 columns at the most')" in text


def test_memory_does_not_grow_with_the_rows(tmp_path: Path) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    data = synthetic_video(8_000, contrasts=(0.5, 1.0, 2.0))
    with_data = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    write_video_spreadsheet(data, tmp_path / "results.xlsx", TIME)
    grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - max(before, with_data)
    # 1.1 million cells: as objects of openpyxl they would take hundreds of MiB.
    assert grown_kib < 60 * 1024


@pytest.mark.skipif(SOFFICE is None, reason="soffice (LibreOffice) is not installed")
def test_libreoffice_reads_numbers_as_numbers(spreadsheet: Path, tmp_path: Path) -> None:
    assert SOFFICE is not None
    # Filter options: comma, quote, UTF-8, from line 1; text in quotes, numbers without; all sheets.
    options = "44,34,76,1,,0,true,true,false,false,false,-1"
    subprocess.run(
        [
            *(SOFFICE, f"-env:UserInstallation={(tmp_path / 'profile').as_uri()}", "--headless"),
            *("--convert-to", f"csv:Text - txt - csv (StarCalc):{options}", "--outdir", str(tmp_path)),
            str(spreadsheet),
        ],
        capture_output=True,
        timeout=120,
        check=True,
    )
    data = synthetic_video()
    head, *rows = _csv(tmp_path / "results-CDP.csv")
    assert head[-1] == "Frame number 119"
    values = np.array(rows)
    assert values.dtype == np.float64
    np.testing.assert_allclose(values[:, 1:], data["cdp"].values.T, rtol=1e-12)
    np.testing.assert_allclose(values[:, 0], [7, 100, 1000])
    head, *rows = _csv(tmp_path / "results-Frames.csv")
    for name, expected in (("CDP", data["cdp"].values.ravel()), ("frame", np.repeat(data["frame"].values, 3))):
        np.testing.assert_allclose([row[head.index(name)] for row in rows], expected, rtol=1e-12)


def _csv(path: Path) -> list[list[Any]]:
    """Rows of a file in which only text is in quotes; what is empty is nan, and other text without them an error."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return list(csv.reader((re.sub(r"(?<=,)(?=,|$)", "nan", line) for line in lines), quoting=csv.QUOTE_NONNUMERIC))
