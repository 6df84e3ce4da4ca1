"""The spreadsheet: numbers are numbers, text is text, and LibreOffice agrees."""

import csv
import shutil
import subprocess
from pathlib import Path
from typing import Any

import openpyxl
import pytest

from labcdp.evaluate import SessionEvaluation
from labcdp.report.workbook import Number, Sheet, workbook

SOFFICE = shutil.which("soffice")


@pytest.fixture(scope="module")
def book(written: Path) -> Any:
    with open(written / "results.xlsx", "rb") as file:
        return openpyxl.load_workbook(file)


def columns(sheet: Any) -> dict[str, list[Any]]:
    return {column[0]: list(column[1:]) for column in zip(*sheet.iter_rows(values_only=True), strict=True)}


def close(values: list[float]) -> Any:
    """Equal within the 16 digits the file holds."""
    return pytest.approx(values, rel=1e-14, abs=0)


def test_sheets_and_frozen_heads(book: Any) -> None:
    assert book.sheetnames == [
        "Summary",
        "Patches",
        "Contrasts",
        "Residuals",
        "Contrast distribution",
        "Provenance",
    ]
    for sheet in book:
        assert sheet.freeze_panes == "A2"
        assert all(cell.font.bold for cell in sheet[1])
        assert all(5 < dimension.width < 70 for dimension in sheet.column_dimensions.values())


def test_patches_are_those_of_the_evaluation(book: Any, evaluation: SessionEvaluation) -> None:
    found = columns(book["Patches"])
    rows = evaluation.patches
    assert found["patch"] == [row.region.name for row in rows]
    assert found["measured in cd/m²"] == close([row.measured_cd_m2 for row in rows])
    assert found["calculated (guessed) in cd/m²"] == close([row.calculated_cd_m2 for row in rows])
    assert found["calibrated in cd/m²"] == close([row.calibrated.luminance_cd_m2 for row in rows])
    assert found["deviation in %"] == close([100 * row.deviation_rel for row in rows])
    low, high = zip(*(row.calibrated.interval_95_cd_m2 for row in rows), strict=True)
    assert found["lower end of 95 % interval in cd/m²"] == close(list(low))
    assert found["upper end of 95 % interval in cd/m²"] == close(list(high))


def test_contrasts_are_those_of_the_evaluation(book: Any, evaluation: SessionEvaluation) -> None:
    found = columns(book["Contrasts"])
    rows = evaluation.contrasts
    assert found["bright patch"] == [row.bright for row in rows]
    assert found["contrast asked in %"] == close([100 * row.cdp.contrast for row in rows])
    assert found["CDP"] == close([row.cdp.cdp for row in rows])
    assert found["standard error of CDP"] == close([row.cdp.standard_error for row in rows])
    assert found["below"] == close([row.cdp.below for row in rows])
    assert found["above"] == close([row.cdp.above for row in rows])
    assert found["exposure in ms"] == close([1e3 * row.exposure_s for row in rows])


def test_residuals_are_those_of_the_calibration(book: Any, evaluation: SessionEvaluation) -> None:
    found = columns(book["Residuals"])
    rows = evaluation.calibration.residuals
    assert found["patch"] == [row.patch for row in rows]
    assert found["residual / its standard deviation"] == close([row.standardised_residual for row in rows])


def test_distribution_holds_each_pair_at_its_own_contrasts(book: Any, evaluation: SessionEvaluation) -> None:
    edges, *curves = columns(book["Contrast distribution"]).values()
    assert book["Contrast distribution"]["A1"].value == "Contrasts in %"
    assert edges == sorted(set(edges))
    assert len(curves) == len(evaluation.contrasts)
    for curve, row in zip(curves, evaluation.contrasts, strict=True):
        points = [(edge, value) for edge, value in zip(edges, curve, strict=True) if value is not None]
        assert [edge for edge, _ in points] == close([100 * edge for edge in row.distribution.edges])
        assert [value for _, value in points] == close(list(row.distribution.cumulative))


def test_what_looks_like_a_formula_stays_text(book: Any) -> None:
    cells = [cell for sheet in book for row in sheet.iter_rows() for cell in row]
    assert not [cell for cell in cells if cell.data_type == "f"]
    texts = [cell for cell in cells if isinstance(cell.value, str) and cell.value.startswith("=")]
    assert {cell.value for cell in texts} == {"=1+1", "=cmd()"}
    assert all(cell.quotePrefix for cell in texts)


@pytest.mark.skipif(SOFFICE is None, reason="soffice (LibreOffice) is not installed")
def test_libreoffice_reads_numbers_as_numbers(written: Path, evaluation: SessionEvaluation, tmp_path: Path) -> None:
    assert SOFFICE is not None
    # Filter options: comma, quote, UTF-8, from line 1; text in quotes, numbers without; all sheets.
    options = "44,34,76,1,,0,true,true,false,false,false,-1"
    subprocess.run(
        [
            *(SOFFICE, f"-env:UserInstallation={(tmp_path / 'profile').as_uri()}", "--headless"),
            *("--convert-to", f"csv:Text - txt - csv (StarCalc):{options}", "--outdir", str(tmp_path)),
            str(written / "results.xlsx"),
        ],
        capture_output=True,
        timeout=120,
        check=True,
    )
    with open(tmp_path / "results-Patches.csv", encoding="utf-8", newline="") as file:
        # A field without quotes becomes a float, and one that is no number is an error.
        _, *rows = csv.reader(file, quoting=csv.QUOTE_NONNUMERIC)
    assert [row[0] for row in rows] == [row.region.name for row in evaluation.patches]
    assert [row[4] for row in rows] == pytest.approx(
        [row.calibrated.luminance_cd_m2 for row in evaluation.patches], rel=1e-12
    )


def test_number_that_is_not_finite_and_odd_text(tmp_path: Path, evaluation: SessionEvaluation) -> None:
    time = evaluation.calibration.provenance.measured
    rows = [("\x07a\ud800", Number(float("nan"), 2)), ("+1", Number(1.25, 1)), ("@x", None)]
    (tmp_path / "x.xlsx").write_bytes(workbook([Sheet("Odd", ("text", "number"), rows)], "t\x00", time))
    with open(tmp_path / "x.xlsx", "rb") as file:
        sheet = openpyxl.load_workbook(file)["Odd"]
    assert list(sheet.iter_rows(values_only=True)) == [
        ("text", "number"),
        ("\ufffda\ufffd", None),
        ("+1", 1.25),
        ("@x", None),
    ]
    assert sheet["B3"].number_format == "0.0"
