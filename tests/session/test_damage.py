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

JOURNAL = "journal.jsonl"
FILES = ("session.toml", "README.txt", JOURNAL, "frames/0001_light_5ms.tif", "frames/0002_dark_5ms.tif")


@pytest.fixture(scope="module")
def sound(tmp_path_factory, configuration, make_frame, new_reading):
    path = tmp_path_factory.mktemp("damage") / "session"
    with Session.create(path, configuration) as session:
        session.add_frame(make_frame(1, shape=(3, 5)))
        session.add_reading(new_reading(75.6), patch="upper left")
        session.add_frame(make_frame(2, shape=(3, 5)), role="dark")
        session.add_reading(new_reading(33.6), patch="upper right")
    return path


@given(st.sampled_from(FILES), st.sampled_from(["changed", "cut", "longer", "missing"]), st.data())
def test_any_damage_is_noticed_and_the_other_frames_are_loaded(sound, make_frame, name, damage, data):
    file, opened = sound / name, Session.open(sound)
    text = file.read_bytes()
    at, flip = data.draw(st.integers(0, len(text) - 1)), data.draw(st.integers(1, 255))
    after = {"changed": bytes([text[at] ^ flip]) + text[at + 1 :], "cut": b"", "longer": text[at:] + b"\0"}
    try:
        file.unlink() if damage == "missing" else file.write_bytes(text[:at] + after[damage])
        for verify in (opened.verify, lambda: Session.open(sound).verify()):
            with pytest.raises(SessionError, match="journal.jsonl" if name == JOURNAL else re.escape(file.name)):
                verify()
        for seed, record in enumerate(opened.frames(), start=1):
            if record.file.name == name:
                with pytest.raises(SessionError, match=re.escape(file.name)):
                    opened.load(record)
            else:
                np.testing.assert_array_equal(opened.load(record).dn, make_frame(seed, shape=(3, 5)).dn)
    finally:
        file.write_bytes(text)


def test_a_changed_digit_anywhere_in_the_journal_is_noticed(sound, tmp_path):
    journal = shutil.copytree(sound, tmp_path / "session") / JOURNAL
    text = journal.read_bytes()
    for found in [*re.finditer(rb"[0-9]", text)][::11]:
        journal.write_bytes(text[: found.start()] + b"%d" % (9 - int(found[0])) + text[found.end() :])
        with pytest.raises(SessionError):
            Session.open(journal.parent).verify()


@pytest.mark.parametrize("order", [(1,), (1, 0)], ids=["removed", "swapped"])
def test_a_removed_line_and_swapped_ones_are_noticed(sound, tmp_path, order):
    damaged = shutil.copytree(sound, tmp_path / "session")
    journal = damaged / JOURNAL
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
