"""A journal gives back what was recorded, or less of it; never anything else."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.disk.journal import LineJournal
from labcdp.core.errors import InputError

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


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"holds the results of another sweep \(another settings\): give another"),
        (b"a file of the user\n", r"j\.jsonl is no journal of this version of labcdp"),
        (b'{"first": 1}\n{"first": 2}\n', r"j\.jsonl is no journal"),
        (b"\x00" * 100, r"j\.jsonl is no journal"),
    ],
)
def test_what_is_not_this_journal_is_refused_and_left_alone(tmp_path, content, message):
    path = tmp_path / "j.jsonl"
    content = content or written(path)
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        LineJournal.open(path, HEAD | {"settings": "other"}, "sweep")
    assert path.read_bytes() == content
