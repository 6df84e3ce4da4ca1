"""Readings of a spreadsheet are those of the same table as text; what is not a number is named by its cell."""

from datetime import date, datetime, time

import openpyxl
import pytest

from labcdp.core.errors import InputError
from labcdp.core.reading import MeterIdentity
from labcdp.core.spectra import read_spectral_file
from labcdp.drivers.file_meter import FileMeter
from labcdp.drivers.manual import MeterAccuracy

METER, ACCURACY = MeterIdentity("Other", "1"), MeterAccuracy(0.03, 0.005, 2)
TAKEN = datetime(2026, 3, 2, 14, 5, 30)


def readings(folder, rows, form="General", title="Readings"):
    """Write rows as a workbook, luminances in a number format, and read them."""
    book = openpyxl.Workbook()
    book.active.title = title
    for row in rows:
        book.active.append(row)
    for row in book.active.iter_rows():
        for cell in row:
            if isinstance(cell.value, float):
                cell.number_format = form
    book.save(folder / "a.xlsx")
    return of_file(folder / "a.xlsx")


def of_file(path):
    with FileMeter(path, METER, ACCURACY) as meter:
        return [
            (patch, one.value, one.unit, one.resolution, one.digits_half_width, meter.has_times and one.timestamp)
            for patch, found in meter.readings.items()
            for one in found
        ]


@pytest.mark.parametrize(
    ("head", "cells", "head_of_text", "text"),
    [
        (["patch", "luminance (cd/m²)"], [["a", 12.5], ["b", 0.75]], "patch;luminance_cd_m2", "a;12,50\nb;0,75"),
        (["Patch", "Luminance [fL]", "time"], [["a", 12.5, TAKEN]], "patch;luminance_fL;time",
         "a;12,50;2026-03-02 14:05:30"),
        (["date", "time", "patch", "L in cd/m2"], [[date(2026, 3, 2), time(14, 5, 30), 7, 12.25]],
         "date;time;patch;L in cd/m2", "2026-03-02;14:05:30;7;12,25"),
        (["patch", "luminance", "unit"], [["a", 12.5, "cd/m²"], ["a", 3.5, "fL"]], "patch;luminance;unit",
         "a;12,50;cd/m²\na;3,50;fL"),
    ],
)  # fmt: skip
def test_a_spreadsheet_has_the_readings_of_the_same_table_as_text(tmp_path, head, cells, head_of_text, text):
    (tmp_path / "a.csv").write_text(f"{head_of_text}\n{text}\n")
    written = [["Measured in May"], [], head, *cells]
    assert readings(tmp_path, written, "0.00") == of_file(tmp_path / "a.csv")


def test_the_row_is_kept_for_the_record(tmp_path):
    readings(tmp_path, [["patch", "luminance_cd_m2", "time"], ["a", 12.5, TAKEN]])
    with FileMeter(tmp_path / "a.xlsx", METER, ACCURACY) as meter:
        (one,) = meter.readings["a"]
    assert one.raw == "a\t12.5\t2026-03-02 14:05:30"
    assert one.timestamp == TAKEN.astimezone()


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (["a", "12,5"], r"Readings!B3: '12,5' is text, not a number"),
        (["a", "12.5"], r"Readings!B3: '12\.5' is text, not a number"),
        (["a", "12"], r"Readings!B3: '12' is text, not a number"),
        (["a", TAKEN], r"Readings!B3: '2026-03-02 14:05:30' is a date or time, not a number"),
        (["a", "=6+6"], r"Readings!B3: there is a formula whose value is not stored"),
        (["a", None], r"Readings!B3: '' is not a number"),
        ([None, 12.5], r"Readings!A3: the patch has no name"),
        (["a", -1.5], r"Readings!B3: -1\.5 is negative"),
    ],
)
def test_a_wrong_cell_is_named(tmp_path, row, message):
    with pytest.raises(InputError, match=rf"a\.xlsx, {message}") as caught:
        readings(tmp_path, [["patch", "luminance_cd_m2"], ["a", 1.5], row])
    assert "\n" not in str(caught.value)


def test_a_time_that_is_none_is_named_by_its_own_cell(tmp_path):
    with pytest.raises(InputError, match=r"'May 2'!C2: the time 'noon' is not known"):
        readings(tmp_path, [["patch", "luminance_cd_m2", "time"], ["a", 1.5, "noon"]], title="May 2")
    with pytest.raises(InputError, match=r"'May 2'!C2: the unit 'lx' is not known"):
        readings(tmp_path, [["patch", "luminance", "unit"], ["a", 1.5, "lx"]], title="May 2")


def test_a_unit_in_the_head_that_is_not_known_or_contradicts_is_refused(tmp_path):
    for head, message in (("luminance (lx)", "the unit 'lx' is not known"), ("luminance_fL (cd/m2)", "two units")):
        with pytest.raises(InputError, match=rf"Readings!B1: .*{message}"):
            readings(tmp_path, [["patch", head], ["a", 1.5]])


def test_lightness_beside_the_luminance_is_no_luminance(tmp_path):
    (tmp_path / "a.csv").write_text("patch,L,a,b,luminance_cd_m2\nwhite,95,0,0,12.5\n")
    assert [one[:3] for one in of_file(tmp_path / "a.csv")] == [("white", 12.5, "cd/m2")]


def test_spectra_are_read_from_a_spreadsheet(tmp_path):
    rows = [["wavelength (nm)", "R", "G", "B"], [380, 0, 0, 0], [500, 0.5, 1, 0], [600, 1, 0.25, 0.1], [780, 0, 0, 0]]
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(tmp_path / "s.xlsx")
    (tmp_path / "s.csv").write_text("\n".join(",".join(map(str, row)) for row in rows))
    assert read_spectral_file(tmp_path / "s.xlsx").columns == read_spectral_file(tmp_path / "s.csv").columns
    book.active["C3"] = "1,0"
    book.save(tmp_path / "s.xlsx")
    with pytest.raises(InputError, match=r"Sheet!C3: '1,0' is text, not a number"):
        read_spectral_file(tmp_path / "s.xlsx")
