"""What is read from disk stays within its limits, and whatever is wrong becomes one short line."""

import json
import tracemalloc

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from labcdp.core.disk import parse_json, read_bytes, read_json, read_toml
from labcdp.core.disk.journal import LineJournal
from labcdp.core.disk.tables import read_table
from labcdp.core.disk.tiff import read_in_child
from labcdp.core.errors import InputError

VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(1 - 10**40, 10**40 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda children: st.lists(children, max_size=4) | st.dictionaries(st.text(), children, max_size=4),
    max_leaves=20,
)


@given(VALUES)
@example(1 - 10**40)
def test_json_is_read_as_the_standard_library_reads_it(value):
    assert parse_json(json.dumps(value)) == value


READERS = {
    "json": lambda path: read_json(path, "a document"),
    "toml": lambda path: read_toml(path, "a configuration"),
    "csv": lambda path: read_table(path, "a table", bool),
}


def test_a_large_file_is_not_loaded(tmp_path):
    with (tmp_path / "large").open("wb") as file:
        file.truncate(2**40)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"cannot be read \(it is larger than 1000 bytes\)"):
            read_bytes(tmp_path / "large", "a file", 1000)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        ("json", "{" + ",".join(f'"{i}": 1' for i in range(100_000)) + ', "7": 1}', "the key '7' is given twice"),
        ("json", "[1e999]", "'1e999' is not a number"),
        ("json", "9" * 5000, "a number has 5000 digits"),
        ("json", "[" * 100_000, "nested more than 64 levels deep"),
        ("json", "[" + "1," * 4_000_001 + "1]", "more than 4000000 values"),
        ("toml", 'name = "a"\nplan = 5 ms\n', r"not valid TOML: .* \(at line 2, column 10\): correct it there"),
        ("toml", "a = 1\nb_m = -2,05 # m\n", r"column 9\): write -2\.05 with a decimal point, not -2,05$"),
        ("toml", "a = 1\nb = ", r": correct it there$"),
        ("toml", "x = " + "[" * 1000, "nested too deep"),
        ("toml", "a." * 100_000 + "b = 1", "is a key of more than 16 parts"),
        ("csv", "a,b\n1\n", "line 2: it has 1 cells, the header has 2: '1'"),
        ("csv", "a,b\n" + "1,2\n" * 200_001, "more than 1000 columns or 200000 rows"),
    ],
)
def test_text_that_is_refused(tmp_path, read, text, message):
    path = tmp_path / "a"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        READERS[read](path)
    assert len(str(caught.value)) < 250 + len(str(path))


#: What a library may do with a damaged file.
READERS_IN_A_CHILD = """
import os

def length(data):
    print("what libraries print does not come between")
    return {"length": len(data)}

def loops(data):
    while True:
        pass

def crashes(data):
    os.abort()

def takes_all(data):
    return bytes(2**42)

def raises(data):
    raise OSError(-101, "NetCDF: HDF error")
"""


@pytest.mark.parametrize("name", ["loops", "crashes", "takes_all", "raises"])
def test_a_library_that_loops_crashes_or_takes_all_memory_costs_a_child_process_only(tmp_path, monkeypatch, name):
    (tmp_path / "readers_of_test.py").write_text(READERS_IN_A_CHILD)
    monkeypatch.syspath_prepend(tmp_path)
    if name == "loops":
        assert read_in_child("readers_of_test:length", b"12345") == {"length": 5}
    monkeypatch.setattr("labcdp.core.disk.tiff._SECONDS", 1)
    with pytest.raises(InputError, match=r"damaged|not read|HDF error|MemoryError|memory"):
        read_in_child(f"readers_of_test:{name}", b"12345")


# A journal gives back what was recorded, or less of it; never anything else


HEAD = {"format": 1, "settings": "good"}
ROWS = [{"frame": 3, "cdp": [0.1 + 0.2, float("nan"), float("inf")], "note": "ä\tb"}, {"frame": 4}]


def written(path, head=HEAD, rows=ROWS):
    journal = LineJournal.open(path, head, "evaluation")
    for row in rows:
        journal.add(row)
    journal.close()
    return path.read_bytes()


def read(path, head=HEAD):
    journal = LineJournal.open(path, head, "evaluation")
    rows = [json.dumps(row) for row in journal.rows()]
    assert len(journal) == len(rows)
    assert [json.dumps(journal.row(place)) for place in range(len(rows))] == rows
    journal.close()
    return rows


def test_rows_are_read_back_bit_for_bit_and_a_cut_loses_only_its_line(tmp_path):
    path = tmp_path / "j.jsonl"
    whole = written(path)
    ends = [index + 1 for index, byte in enumerate(whole) if byte == ord("\n")]
    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        n = max(0, sum(end <= cut for end in ends) - 1)
        assert read(path) == [json.dumps(row) for row in ROWS[:n]]
        # What was cut off is gone, so that the next row begins on a line of its own.
        assert path.read_bytes().endswith(b"\n")


@given(st.data())
def test_an_altered_row_and_those_behind_it_are_not_read(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("journal") / "j.jsonl"
    whole = bytearray(written(path))
    n_before = data.draw(st.integers(0, 1))
    lines = bytes(whole).splitlines(keepends=True)
    at = sum(map(len, lines[: 1 + n_before])) + data.draw(st.integers(0, len(lines[1 + n_before]) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    path.write_bytes(whole)
    assert read(path) == [json.dumps(row) for row in ROWS[:n_before]]
    # Each line follows the one before: without that one, it is none of them.
    path.write_bytes(lines[0] + lines[2])
    assert read(path) == []


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"holds the results of another sweep \(another settings\): give another"),
        (b"a file of the user\n", r"j\.jsonl is not a journal"),
        (b'{"first": 1}\n{"first": 2}\n', r"j\.jsonl is not a journal"),
        (b"\x00" * 100, r"j\.jsonl is not a journal"),
    ],
)
def test_what_is_not_this_journal_is_refused_and_left_alone(tmp_path, content, message):
    path = tmp_path / "j.jsonl"
    content = content or written(path)
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        LineJournal.open(path, HEAD | {"settings": "other"}, "sweep")
    assert path.read_bytes() == content
