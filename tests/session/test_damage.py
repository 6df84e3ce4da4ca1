"""Whatever happens to a session's files is noticed, and said precisely."""

import hashlib
import json
import re
import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import SessionError
from labcdp.session import Session, example_session

FRAME = "frames/0001_light_5ms.tif"
FILES = ("session.toml", "README.txt", "journal.jsonl", FRAME, "frames/0002_dark_5ms.tif")


@pytest.fixture(scope="module")
def sound(tmp_path_factory, configuration, make_frame, new_reading):
    path = tmp_path_factory.mktemp("damage") / "session"
    with Session.create(path, configuration) as session:
        session.add_frame(make_frame(1, shape=(3, 5)))
        session.add_reading(new_reading(75.6), patch="upper left")
        session.add_frame(make_frame(2, shape=(3, 5)), role="dark")
        session.add_reading(new_reading(33.6), patch="upper right")
    return path


@pytest.fixture
def damaged(sound, tmp_path):
    return shutil.copytree(sound, tmp_path / "session")


@given(st.data())
def test_a_changed_byte_is_noticed(sound, data):
    file = sound / data.draw(st.sampled_from(FILES))
    text = file.read_bytes()
    at = data.draw(st.integers(0, len(text) - 1))
    flip = data.draw(st.integers(1, 255))
    opened = Session.open(sound)
    try:
        file.write_bytes(text[:at] + bytes([text[at] ^ flip]) + text[at + 1 :])
        for verify in (opened.verify, lambda: Session.open(sound).verify()):
            with pytest.raises(SessionError, match=re.escape(file.name)):
                verify()
    finally:
        file.write_bytes(text)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        *((name, None, "is missing") for name in FILES),
        (FRAME, lambda data: data[:100], "is truncated"),
        (FRAME, lambda data: data + b"\0", "was altered"),
        (FRAME, lambda data: data[:-1] + b"?", "was altered"),
    ],
)
def test_a_missing_or_damaged_file_is_named_and_its_frame_not_loaded_but_the_others_are(
    damaged, make_frame, name, change, message
):
    session, file = Session.open(damaged), damaged / name
    data = file.read_bytes()
    file.unlink()
    if change:
        file.write_bytes(change(data))
    first, second = session.frames()
    for read in (session.verify, *((lambda: session.load(first),) if name == FRAME else ())):
        with pytest.raises(SessionError, match=f"{re.escape(str(file))} {message}"):
            read()
    if name == FRAME:
        np.testing.assert_array_equal(session.load(second).dn, make_frame(2, shape=(3, 5)).dn)


@pytest.mark.parametrize("order", [(1,), (1, 0)], ids=["removed", "swapped"])
def test_a_removed_line_and_swapped_ones_are_noticed(damaged, order):
    journal = damaged / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    for line in range(5):
        journal.write_bytes(b"".join(lines[:line] + [lines[line + place] for place in order] + lines[line + 2 :]))
        for writable in (False, True):
            with pytest.raises(SessionError, match=f"line {line + 1} was altered, or a line there was removed or swap"):
                Session.open(damaged, writable=writable)


def test_the_checks_are_as_documented(sound):
    for line in (sound / "journal.jsonl").read_text().splitlines():
        check = json.loads(line)["check"]
        assert hashlib.sha256(line.replace(f', "check": "{check}"', "").encode()).hexdigest() == check


def test_sessions_of_format_1_are_read_and_resumed(tmp_path, new_reading):
    """Their checks are over the line before as well."""
    path = shutil.copytree(example_session(), tmp_path / "session")
    with Session.open(path, writable=True) as resumed:
        assert resumed.records[0].content["format"] == 1
        resumed.verify()
        n_readings = len(resumed.readings())
        resumed.add_reading(new_reading(75.6), resumed.configuration.target.patches[0].name)
    again = Session.open(path)
    again.verify()
    assert len(again.readings()) == n_readings + 1
    lines = (path / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (path / "journal.jsonl").write_bytes(b"".join([*lines[:2], lines[2].replace(b"e", b"f", 1), *lines[3:]]))
    with pytest.raises(SessionError, match="line 3 was altered"):
        Session.open(path)
