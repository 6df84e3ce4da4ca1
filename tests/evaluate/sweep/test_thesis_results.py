import json
from io import BytesIO

import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.evaluate.sweep.thesis import reproduce_thesis
from labcdp.evaluate.sweep.thesis_report import thesis_result, write_thesis
from labcdp.report.files import schema


@pytest.fixture(scope="module")
def reproduction():
    return reproduce_thesis(2)


def test_result_holds_published_values_and_ours(reproduction):
    found = thesis_result(reproduction)
    rows = list(found.table("table_5_3").rows())
    assert [row["mean"] for row in rows] == [row.mean for row in reproduction.table]
    assert (rows[7]["published_cdp"], rows[7]["z"], rows[7]["all_pairs_mean"]) == (0.99834205, 0.0, 1.0)
    assert (rows[6]["contrast"], rows[6]["exposure_s"], rows[6]["pixel_pitch_um"]) == (0.3, 0.015, pytest.approx(3.0))
    assert len(found.table("figure_3_10")) == 2
    assert len(found.table("intensity_sweep")) == 200
    assert ("thesis-unfilled-slots", "8") in [(one.code, one.subject) for one in found.findings]


def test_files_agree(reproduction, tmp_path):
    paths = write_thesis(thesis_result(reproduction), tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in paths}
    assert names == {"results.json", "report.html", "results.xlsx", "figures/intensity-sweep.png"}
    values = json.loads((tmp_path / "results.json").read_text())
    Draft202012Validator(schema()).validate(values)
    sheet = openpyxl.load_workbook(BytesIO((tmp_path / "results.xlsx").read_bytes()))["table_5_3"]
    rows = values["tables"]["table_5_3"]["rows"]
    for row, cells in zip(rows, sheet.iter_rows(min_row=2, values_only=True), strict=True):
        assert cells[1:] == pytest.approx(list(row.values())[1:], rel=1e-12)
    page = (tmp_path / "report.html").read_text()
    assert page.index("of 8") < page.index("0.82872")
    assert "418/252119" in page
