import json
from io import BytesIO

import openpyxl
import pytest

from labcdp.evaluate import reproduce_thesis
from labcdp.report import figure_table, thesis_table, write_thesis


@pytest.fixture(scope="module")
def result():
    return reproduce_thesis(2)


def test_table_shows_setting_published_value_and_ours(result):
    table = thesis_table(result)
    assert len(table.rows) == 8
    assert table.rows[6][:2] == ("7: 30 %, 1 cd/m², 50 °C, 15 ms, 3 µm", "0.84205")
    assert table.rows[7][1:5] == ("0.99834205", "0.99834205", "0.00", "1.00000")
    assert len(figure_table(result).rows) == 2


def test_files_agree(result, tmp_path):
    paths = write_thesis(result, tmp_path)
    assert {path.relative_to(tmp_path).as_posix() for path in paths} == {
        "results.json",
        "report.html",
        "results.xlsx",
        "figures/intensity-sweep.png",
    }
    values = json.loads((tmp_path / "results.json").read_text())
    book = openpyxl.load_workbook(BytesIO((tmp_path / "results.xlsx").read_bytes()))
    sheet = book["Table 5.3"]
    heads = [cell.value for cell in sheet[1]]
    for number, row in enumerate(values["table_5_3"], start=2):
        cells = {head: cell.value for head, cell in zip(heads, sheet[number], strict=True)}
        assert cells["Thesis"] == row["published"]["published_cdp"]
        assert cells["z"] == pytest.approx(row["z"], rel=1e-12)
        assert cells["Correct physics, region to region, exact"] == pytest.approx(row["corrected_exact"], rel=1e-12)
    assert "418/252119" in sheet.cell(9, len(heads)).value
    assert book["Intensity sweep"].max_row == 201
    assert "418/252119" in (tmp_path / "report.html").read_text()
