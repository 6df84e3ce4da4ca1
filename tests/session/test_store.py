"""What goes into a session comes out again, and nothing else is touched."""

import json
import logging
import subprocess
import sys
from datetime import datetime

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from labcdp.core.errors import InputError, SessionError
from labcdp.core.frame import CameraIdentity, Frame, Readout
from labcdp.session import EventRecord, FrameRecord, ReadingRecord, Session
from labcdp.session.frames import frame_from_tiff, frame_to_tiff


@pytest.fixture
def path(tmp_path):
    return tmp_path / "session"


def contents(folder):
    return {file.relative_to(folder): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def assert_same(frame, other):
    np.testing.assert_array_equal(frame.dn, other.dn, strict=True)
    assert frame.metadata() == other.metadata()


@pytest.mark.parametrize(("camera_timestamp_ns", "stated", "register"), [(0, 64.0, None), (5, None, 64.0)])
def test_black_level_of_earlier_sessions_is_that_of_a_file_or_a_register(
    make_frame, camera_timestamp_ns, stated, register
):
    frame = make_frame()
    old = frame.metadata() | {"black_level_dn": 64.0, "camera_timestamp_ns": camera_timestamp_ns}
    del old["black_level_register"]
    again = Frame.from_metadata(frame.dn, old)
    assert (again.black_level_dn, again.black_level_register, again.readout) == (stated, register, None)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_frames_come_back_bit_for_bit(path, configuration, make_frame, compress, dtype):
    frame = make_frame(3, dtype=dtype)
    with Session.create(path, configuration, compress=compress) as session:
        assert_same(session.load(session.add_frame(frame)), frame)
    with Session.open(path, writable=True) as session:
        session.add_frame(frame, role="dark")
    again = Session.open(path)
    for record in again.frames():
        assert_same(again.load(record), frame)
    sizes = [record.file.size for record in again.frames()]
    assert (max(sizes) < frame.dn.nbytes) == (min(sizes) < frame.dn.nbytes)  # compressed for good, or never


FLOATS = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(st.characters(exclude_categories=["Cs"]))
FRAMES = st.builds(
    Frame,
    dn=arrays.arrays(st.sampled_from([np.uint8, np.uint16]), arrays.array_shapes(min_dims=2, max_dims=2, max_side=9)),
    exposure_s=st.floats(0, exclude_min=True, allow_infinity=False),
    gain_db=FLOATS,
    bit_depth=st.just(16),
    saturation_dn=st.floats(0, 65535, exclude_min=True),
    black_level_dn=st.none() | FLOATS,
    pixel_format=TEXT,
    colour_filter=st.sampled_from([None, "RG", "BG"]),
    temperature_c=st.none() | FLOATS,
    timestamp=st.datetimes(timezones=st.timezones()),
    camera_timestamp_ns=st.integers(),
    frame_id=st.integers(0),
    camera=st.builds(CameraIdentity, TEXT, TEXT, TEXT, st.booleans()),
    readout=st.none() | st.builds(Readout, st.integers(0), st.integers(0), st.tuples(st.integers(1, 4), st.just(1))),
    black_level_register=st.none() | FLOATS,
)


@given(FRAMES, st.booleans())
def test_any_frame_is_restored_from_its_file(frame, compress):
    assert_same(frame_from_tiff(frame_to_tiff(frame, compress), "file"), frame)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_another_program_reads_the_same_pixels(path, configuration, make_frame, compress, dtype):
    frame = make_frame(shape=(300, 200), dtype=dtype)
    with Session.create(path, configuration, compress=compress) as session:
        file = path / session.add_frame(frame).file.name
    np.testing.assert_array_equal(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), frame.dn, strict=True)
    with tifffile.TiffFile(file) as tiff:
        assert json.loads(tiff.pages.first.tags["ImageDescription"].value) == frame.metadata()


def test_records_keep_their_order(path, configuration, make_frame, make_reading):
    with Session.create(path, configuration) as session:
        made = [
            session.add_frame(make_frame(1)),
            session.add_reading(make_reading(), patch="upper left"),
            session.add_event("lens covered", {"by": "hand", "seconds": [1, 2.5, None, True], "µ": "ß\n"}),
            session.add_frame(make_frame(2, exposure_s=0.02), role="dark"),
            session.add_reading(make_reading(33.6), patch="upper right"),
        ]
        assert session.records[2:] == made
    again = Session.open(path)
    assert again.records[2:] == made
    assert [type(record) for record in made] == [
        FrameRecord, ReadingRecord, EventRecord, FrameRecord, ReadingRecord,
    ]  # fmt: skip
    assert [record.sequence for record in again.records] == [1, 2, 3, 4, 5, 6, 7]
    times = [record.time for record in again.records]
    assert times == sorted(times)
    assert [(r.number, r.role, r.exposure_s, r.gain_db, r.pixel_format, r.shape) for r in again.frames()] == [
        (1, "light", 0.005, 0.1, "Mono12", (12, 16)),
        (2, "dark", 0.02, 0.1, "Mono12", (12, 16)),
    ]
    assert again.frames("dark") == [made[3]]
    assert again.frames()[0].camera == make_frame().camera
    assert [(r.patch, r.reading) for r in again.readings()] == [
        ("upper left", make_reading()),
        ("upper right", make_reading(33.6)),
    ]


def test_the_folder_holds_what_its_page_says(path, configuration, make_frame):
    with Session.create(path, configuration) as session:
        session.add_frame(make_frame())
    files = {str(name) for name in contents(path)}
    assert files == {
        "README.txt", "session.toml", "journal.jsonl", "frames/0001_light_5ms.tif",
    }  # fmt: skip
    page = (path / "README.txt").read_text()
    assert all(name.removeprefix("frames/") in page for name in files - {"README.txt"})
    lines = [json.loads(line) for line in (path / "journal.jsonl").read_text().splitlines()]
    assert [line["kind"] for line in lines] == ["session", "readme", "frame"]
    assert all(datetime.fromisoformat(line["time"]).tzinfo for line in lines)
    assert Session.open(path).configuration == configuration


def test_reading_changes_nothing(path, configuration, make_frame, make_reading):
    with Session.create(path, configuration) as session:
        session.add_frame(make_frame())
        session.add_reading(make_reading(), patch="upper left")
    with (path / "journal.jsonl").open("ab") as file:
        file.write(b'{"sequence": 5, "ti')
    (path / "frames" / ".labcdp-0123456789abcdef.part.tif").write_bytes(b"half")
    before = contents(path)
    with Session.open(path) as session:
        session.load(session.frames()[0])
        session.problems()
        session.unrecorded()
    assert contents(path) == before


def test_a_reader_needs_no_lock_and_sees_what_was_there(path, configuration, make_frame):
    with Session.create(path, configuration) as writer:
        writer.add_frame(make_frame(1))
        reader = Session.open(path)
        writer.add_frame(make_frame(2))
        assert len(reader.frames()) == 1
        reader.verify()
        assert len(Session.open(path).frames()) == 2


def test_a_session_resumes_where_it_ended(path, configuration, make_frame):
    with Session.create(path, configuration) as session:
        session.add_frame(make_frame(1))
    with Session.open(path, writable=True) as session:
        assert session.add_frame(make_frame(2)).file.name == "frames/0002_light_5ms.tif"
        session.verify()


def test_a_folder_in_use_is_not_overwritten(path, configuration):
    path.mkdir()
    (path / "thesis.txt").write_text("a year's work")
    with pytest.raises(SessionError, match=r"session exists already: give a new folder, or open the session in it"):
        Session.create(path, configuration)
    assert [file.name for file in path.parent.rglob("*")] == ["session", "thesis.txt"]


@pytest.mark.parametrize("writable", [False, True])
def test_a_folder_that_is_not_a_session_is_refused(tmp_path, writable):
    (tmp_path / "file").touch()
    for folder in (tmp_path, tmp_path / "none", tmp_path / "file"):
        with pytest.raises(SessionError, match=rf"{folder} is not a session: it has no journal.jsonl; give the folder"):
            Session.open(folder, writable=writable)


def test_a_second_writer_is_refused(path, configuration, make_frame):
    with Session.create(path, configuration) as session:
        with pytest.raises(
            SessionError, match=r"session is in use by another process: end that one first, or open the"
        ):
            Session.open(path, writable=True)
        program = "import sys; from labcdp.session import Session; Session.open(sys.argv[1], writable=True)"
        other = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=False)
        assert "SessionError" in other.stderr
        assert "in use by another process" in other.stderr
        session.add_frame(make_frame())
    with Session.open(path, writable=True) as session:
        session.verify()


def test_wrong_values_are_refused_and_leave_no_trace(path, configuration, make_frame, make_reading):
    with Session.create(path, configuration) as session:
        before = contents(path)
        with pytest.raises(InputError, match=r"role is 'flat': give 'light' or 'dark'"):
            session.add_frame(make_frame(), role="flat")
        with pytest.raises(InputError, match=r"patch is 'A9': give one of the target's, upper left, upper right"):
            session.add_reading(make_reading(), patch="A9")
        with pytest.raises(InputError, match=r"kind is 'frame': give a name that is not one of session, readme, frame"):
            session.add_event("frame", {})
        with pytest.raises(InputError, match=r"content of this step record cannot be written as JSON \(Out of range"):
            session.add_event("step", {"value": float("nan")})
        with pytest.raises(InputError, match=r"content of this step record cannot be written as JSON \(Object of type"):
            session.add_event("step", {"value": b"bytes"})
        with pytest.raises(InputError, match=r"metadata of frame 0 cannot be written as JSON \(Out of range float"):
            session.add_frame(with_temperature(make_frame(), float("nan")))
        assert contents(path) == before
        assert session.add_frame(make_frame()).number == 1


def with_temperature(frame, temperature_c):
    return Frame.from_metadata(frame.dn, frame.metadata() | {"temperature_c": temperature_c})


def test_a_torn_line_is_set_aside_on_opening_for_writing(path, configuration, make_frame, caplog):
    with Session.create(path, configuration) as session:
        record = session.add_frame(make_frame())
    torn = b'{"sequence": 4, "time": "2026-0'
    with (path / "journal.jsonl").open("ab") as file:
        file.write(torn)
    reader = Session.open(path)
    assert reader.frames() == [record]
    assert "the last line is not whole and left out" in caplog.text
    with pytest.raises(SessionError, match=r"journal.jsonl ends with a line that is not whole: open the session for"):
        reader.verify()
    with Session.open(path, writable=True) as session:
        session.verify()
        assert session.frames() == [record]
        event = session.records[-1]
        assert (event.kind, event.content, event.file.name) == ("torn line", {"line": 4}, "journal.torn-0004-1.txt")
        assert session.unrecorded() == []
    assert (path / "journal.torn-0004-1.txt").read_bytes() == torn
    assert "line 4 is not whole, it is kept in journal.torn-0004-1.txt" in caplog.text


def test_leftovers_are_removed_and_unrecorded_frames_kept(path, configuration, make_frame, caplog):
    with Session.create(path, configuration) as session:
        session.add_frame(make_frame(1))
    frames = path / "frames"
    orphan = frame_to_tiff(make_frame(2), compress=False)
    (frames / "0007_light_5ms.tif").write_bytes(orphan)
    (frames / ".labcdp-0123456789abcdef.part.tif").write_bytes(b"half")
    (path / ".labcdp-0123456789abcdef.part.end").write_bytes(b"half")
    (path / ".mine.part").write_bytes(b"mine")
    assert Session.open(path).unrecorded() == [".mine.part", "frames/0007_light_5ms.tif"]
    with caplog.at_level(logging.WARNING), Session.open(path, writable=True) as session:
        assert session.add_frame(make_frame(3)).file.name == "frames/0008_light_5ms.tif"
        session.verify()
    assert "frames/0007_light_5ms.tif is not in the journal: it is left alone" in caplog.text
    assert (frames / "0007_light_5ms.tif").read_bytes() == orphan
    assert [path.name for path in path.rglob(".*")] == [".mine.part"]


@pytest.mark.parametrize("name", ["mine.png", "frames/0001_mine.tif", ".mine.part"])
def test_a_session_is_removed_without_files_of_others_only(path, configuration, name):
    Session.create(path, configuration).close()
    (path / name).write_bytes(b"mine")
    before = contents(path)
    with pytest.raises(SessionError, match="which is not of the session"):
        Session.open(path).remove()
    assert contents(path) == before
    (path / name).unlink()
    Session.open(path).remove()
    assert not path.exists()
