"""Spreadsheets give the numbers of the same table as text, and what they lack is said with the cell's name."""

import zipfile
from io import BytesIO

import openpyxl
import pytest
import xlsxwriter
from hypothesis import given
from hypothesis import strategies as st
from openpyxl.utils import get_column_letter, quote_sheetname

from labcdp.core.disk.spreadsheets import cell_name, number_text, sheets_of
from labcdp.core.disk.tables import read_table
from labcdp.core.errors import InputError


def book_of(**sheets):
    """Bytes of a workbook with rows by the names of its sheets."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    file = BytesIO()
    book.save(file)
    return file.getvalue()


def changed(data, *replacements):
    """Bytes of a workbook with other text in its parts; each text must be there."""
    file = BytesIO()
    with zipfile.ZipFile(BytesIO(data)) as parts, zipfile.ZipFile(file, "w") as other:
        texts = {name: parts.read(name) for name in parts.namelist()}
        for old, new in replacements:
            assert any(old in text for text in texts.values())
            texts = {name: text.replace(old, new) for name, text in texts.items()}
        for name, text in texts.items():
            other.writestr(name, text)
    return file.getvalue()


def read(folder, data):
    (folder / "a.xlsx").write_bytes(data)
    return read_table(folder / "a.xlsx", "a table with x and y", lambda names: {"x", "y"} <= set(names))


def test_the_table_is_found_below_a_title_beside_notes_and_on_the_sheet_that_has_it(tmp_path):
    rows = [["Readings of May"], [], [None, "x", "n", "y", None], [None] * 5, [None, 1, "", 2.5, "note"],
            [None, None, None, None, "aside"], [None, "p", None, 3, None]]  # fmt: skip
    table = read(tmp_path, book_of(About=[["text"]], Data=rows))
    assert table.header.cells == ("x", "n", "y")
    assert [(row.number, row.cells) for row in table.rows] == [(5, ("1", "", "2.5")), (7, ("p", "", "3"))]
    assert table.rows[0].raw == "1\t\t2.5"
    assert table.rows[1].place(2) == "Data!D7"
    with pytest.raises(InputError, match=r"several sheets with such a table \(A, B\)"):
        read(tmp_path, book_of(A=rows, B=rows))
    with pytest.raises(InputError, match=r"no such table in its sheets \(A, B\): give a table with x and y"):
        read(tmp_path, book_of(A=[["x"]], B=[["y"]]))


def test_a_wrong_statement_of_size_cuts_nothing(tmp_path):
    """Some programs state A1 as the size of each sheet."""
    data = changed(book_of(Data=[["x", "y"], [1, 2]]), (b'<dimension ref="A1:B2"', b'<dimension ref="A1"'))
    assert read(tmp_path, data).rows[0].cells == ("1", "2")


def test_formulas_have_their_stored_value_and_without_one_are_named(tmp_path):
    file = BytesIO()
    with xlsxwriter.Workbook(file) as book:
        sheet = book.add_worksheet("Data")
        sheet.write_row(0, 0, ["x", "y"])
        sheet.write_formula(1, 0, "=1+1", None, 2)
        sheet.write_formula(1, 1, "=1/0", None, "#DIV/0!")
        sheet.write_formula(2, 0, '=IF(A9="","","")', None, "")
    # An empty text is stored with its type, as Excel does it.
    table = read(tmp_path, changed(file.getvalue(), (b'<c r="A3">', b'<c r="A3" t="str">')))
    assert [row.cells for row in table.rows] == [("2", "#DIV/0!")]
    assert table.rows[0].number_text(0) == "2"
    with pytest.raises(InputError, match=r"has the error '#DIV/0!' there: correct it"):
        table.rows[0].text(1)
    table = read(tmp_path, book_of(Data=[["x", "y"], ["=1+1", 1]]))
    with pytest.raises(InputError, match="a formula whose value is not stored: save the file in a spreadsheet program"):
        table.rows[0].text(0)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"PK\x03\x04", "cannot be read as a spreadsheet .*: save it again as .xlsx"),
        (book_of(A=[["x", "y"]])[:-200], "cannot be read as a spreadsheet .*: save it again as .xlsx"),
        (b"\xd0\xcf\x11\xe0" + bytes(600), "an old format: save it as .xlsx, or as CSV"),
        (b"\xd0\xcf\x11\xe0" + "EncryptedPackage".encode("utf-16-le"), "is encrypted: save it without a password"),
    ],
)
def test_what_is_no_spreadsheet_is_one_clear_line(tmp_path, data, message):
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, data)
    assert "\n" not in str(caught.value)


def test_a_file_that_unpacks_to_much_is_not_unpacked(tmp_path):
    file = BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as parts, parts.open("xl/workbook.xml", "w") as part:
        for _ in range(257):
            part.write(bytes(2**20))
    with pytest.raises(InputError, match=r"unpacks to more than 256 MiB"):
        read(tmp_path, file.getvalue())


def test_rows_without_end_end(tmp_path):
    """A row number far beyond the last that a sheet can have; the library would yield all rows before it."""
    data = changed(book_of(Data=[["x", "y"], [1, 2]]), (b'<row r="2"', b'<row r="99999999999"'))
    with pytest.raises(InputError, match="a sheet has more than 1048576 rows"):
        sheets_of(data)


@given(st.integers(0, 10**9), st.integers(0, 9))
def test_a_number_is_the_stored_one_with_the_zeros_shown(number, places):
    """As Python formats the decimal number of so many places, which the cell shows."""
    shown = f"{number / 10**places:.{places}f}"
    form = "0" + ("." + "0" * places if places else "")
    assert number_text(float(shown), form) == shown
    assert number_text(float(shown), f'#,##{form}" cd/m²";[Red]-{form}') == shown
    assert float(number_text(float(shown), "General")) == float(shown)


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [(0.1 + 0.2, "General", "0.3"), (12.0, "General", "12"), (12, "0.00", "12.00"), (12.34, "0.0", "12.34"),
     (0.5, "0%", "0.5"), (1200.0, "0.00E+00", "1.20e+3"), (1e-05, "General", "0.00001"), (3, "@", "3")],
)  # fmt: skip
def test_numbers_of_cells(value, form, text):
    assert number_text(value, form) == text


@pytest.mark.parametrize("title", ["Data", "It's 1", "May 2"])
def test_names_of_cells_are_those_of_openpyxl(title):
    for column in (0, 25, 26, 701, 702, 16383):
        name = f"{get_column_letter(column + 1)}3"
        assert cell_name(title, 3, column) == f"{title if title == 'Data' else quote_sheetname(title)}!{name}"
