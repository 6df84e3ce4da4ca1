"""The history of cameras as page, table and sheet: planes of one camera together, in their colours."""

from dataclasses import replace
from io import BytesIO

import pytest
from openpyxl import load_workbook

from labcdp.calibration.history import HistoryPoint, histories
from labcdp.errors import InputError
from labcdp.frame import PLANES
from labcdp.report.history import by_camera, change_text, history_table, history_title, write_history


@pytest.fixture(scope="module")
def mono(evaluation):
    return histories({"c.json": evaluation.calibration}, {})


@pytest.fixture(scope="module")
def planes(mono):
    """Two measurements of four planes; blue lost a tenth, and the second one found nothing of red."""
    (one,) = mono
    first = replace(one.points[0], meter="LS-110 1")
    made = []
    for plane, weight in zip(PLANES, (0.2, 0.45, 0.45, -0.1), strict=True):
        second: HistoryPoint = replace(
            first,
            kind="verification",
            source="v.json",
            measured=first.measured.replace(year=first.measured.year + 1),
            verdict="doubtful",
            weight=None,
            k_dn_per_e=None,
            responsivity_dn_s_cd_m2=first.responsivity_dn_s_cd_m2 * (0.9 if plane == "B" else 1.0),
        )
        if plane == "R":
            second = replace(second, responsivity_dn_s_cd_m2=None, random_half_width_rel=None, half_width_95_rel=None)
        made.append(replace(one, plane=plane, points=(replace(first, weight=weight), second)))
    return made


def test_planes_of_a_camera_are_one_table(planes, mono):
    (camera,) = by_camera(planes)
    assert [one.plane for one in camera] == list(PLANES)
    assert "plane" not in history_title(camera)
    table = history_table(camera)
    assert table.columns[1:5] == ("by", "plane", "weight", "responsivity (DN s⁻¹ / (cd m⁻²))")
    assert "meter" not in table.columns
    assert [row[1:4] for row in table.rows] == [
        *(("calibration", p, w) for p, w in zip(PLANES, ("+0.200", "+0.450", "+0.450", "-0.100"), strict=True)),
        *(("verification: doubtful", p, "-") for p in PLANES),
    ]
    assert table.rows[4][4] == table.rows[4][5] == "-"
    assert all(len(row) == len(table.columns) for row in table.rows)
    # A monochrome camera of the same name is another one.
    assert len(by_camera([*planes, *mono])) == 2


def test_two_meters_are_told_in_the_table(planes):
    other = [replace(one, points=(one.points[0], replace(one.points[1], meter="LS-100 2"))) for one in planes]
    table = history_table(tuple(other))
    assert table.columns[-1] == "meter"
    assert {row[-1] for row in table.rows} == {"LS-110 1", "LS-100 2"}
    assert "another meter was used, so both scales count" in change_text(tuple(other))


def test_change_names_the_planes_that_changed(planes):
    text = change_text(tuple(planes))
    assert "in plane R" not in text
    assert "-10.0" in text
    assert "in plane B (95 %), which is more than its uncertainty in B; the meter LS-110 1 is the same" in text
    assert "nothing to compare it with yet" in change_text((planes[0],))


def test_page_picture_and_sheet(planes, mono, tmp_path):
    for name in ("h.html", "h.png", "h.xlsx"):
        write_history(planes, tmp_path / name)
    page = (tmp_path / "h.html").read_text()
    assert page.count("data:image/png;base64,") == 1
    assert "History of one camera" in page
    rows = list(load_workbook(BytesIO((tmp_path / "h.xlsx").read_bytes()))["Camera 1"].iter_rows(values_only=True))
    assert [row[3] for row in rows[1:9]] == [*PLANES, *PLANES]
    assert [row[4] for row in rows[1:5]] == [0.2, 0.45, 0.45, -0.1]
    assert rows[5][5:8] == (None, None, None)
    with pytest.raises(InputError, match="a picture shows one camera and setting, these are 2"):
        write_history([*planes, *mono], tmp_path / "two.png")
