"""What goes into a session comes out again, and nothing else is touched."""

import json
import os
import resource
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from datetime import timedelta
from io import BytesIO

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from labcdp.core.clock import SimulatedClock
from labcdp.core.errors import InputError, SessionError
from labcdp.core.frame import CameraIdentity, Frame, Readout
from labcdp.output.file import lock
from labcdp.session import EventRecord, Session
from labcdp.session.frames import frame_from_tiff, frame_to_tiff

from ..output.test_results_folder import contents


@pytest.fixture
def path(tmp_path):
    return tmp_path / "session"


@pytest.fixture
def session(path, configuration):
    with Session.create(path, configuration) as session:
        yield session


@pytest.mark.parametrize(("camera_timestamp_ns", "stated", "register"), [(0, 64.0, None), (5, None, 64.0)])
def test_black_level_of_earlier_sessions_is_that_of_a_file_or_a_register(
    make_frame, camera_timestamp_ns, stated, register
):
    frame = make_frame()
    old = frame.metadata() | {"black_level_dn": 64.0, "camera_timestamp_ns": camera_timestamp_ns}
    del old["black_level_register"]
    again = Frame.from_metadata(frame.dn, old)
    assert (again.black_level_dn, again.black_level_register, again.readout) == (stated, register, None)


FLOATS = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(st.characters(codec="utf-8"))
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
def test_any_frame_is_restored_from_its_file_and_other_programs_read_it(frame, compress):
    data = frame_to_tiff(frame, compress)
    again = frame_from_tiff(data, "file")
    np.testing.assert_array_equal(again.dn, frame.dn, strict=True)
    assert again.metadata() == frame.metadata()
    theirs = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(theirs, frame.dn, strict=True)
    with tifffile.TiffFile(BytesIO(data)) as tiff:
        assert json.loads(tiff.pages.first.description) == json.loads(json.dumps(frame.metadata()))


def test_a_session_is_resumed_and_read_while_it_is_written(path, configuration, make_frame, new_reading):
    with Session.create(path, configuration, compress=True) as session:
        made = [
            *session.add_frames([]),
            session.add_frame(make_frame(1)),
            session.add_event("lens covered", {"by": "hand", "seconds": [1, 2.5, None, True], "µ": "ß\n"}),
        ]
    with Session.open(path, writable=True) as session:
        reader = Session.open(path)
        made.append(session.add_frame(make_frame(2, exposure_s=0.02), role="dark"))
        made.append(session.add_reading(new_reading(33.6), patch="upper right"))
        assert len(reader.frames()) == 1
        reader.verify()
    again = Session.open(path)
    assert (again.records[2:], again.frames("dark"), again.configuration) == (made, [made[2]], configuration)
    frames = ["frames/0001_light_5ms.tif", "frames/0002_dark_20ms.tif"]
    assert sorted(contents(path)) == ["README.txt", *frames, "journal.jsonl", "session.toml"]


def test_what_is_no_session_or_another_one_is_neither_read_nor_overwritten(tmp_path, path, configuration):
    path.mkdir()
    (path / "thesis.txt").write_text("a year's work")
    with pytest.raises(SessionError, match=r"session exists already"):
        Session.create(path, configuration)
    assert [file.name for file in path.parent.rglob("*")] == ["session", "thesis.txt"]
    for folder in (path, tmp_path / "none", path / "thesis.txt"):
        for writable in (False, True):
            with pytest.raises(SessionError, match=rf"{folder} is not a session: it has no journal.jsonl; give the"):
                Session.open(folder, writable=writable)


def test_a_second_writer_is_refused(session):
    with pytest.raises(SessionError, match=r"session is in use by another process"):
        Session.open(session.path, writable=True)
    session.close()
    Session.open(session.path, writable=True).close()


@pytest.mark.parametrize(
    "add",
    [
        lambda session, frame, _: session.add_frame(frame, role="flat"),
        lambda session, _, reading: session.add_reading(reading, patch="A9"),
        lambda session, *_: session.add_event("frame", {}),
        lambda session, *_: session.add_event("step", {"a": float("nan")}),
        lambda session, frame, _: session.add_frame(replace(frame, temperature_c=float("nan"))),
    ],
)
def test_wrong_values_are_refused_and_leave_no_trace(session, make_frame, new_reading, add):
    before = contents(session.path)
    with pytest.raises(InputError):
        add(session, make_frame(), new_reading(1.0))
    assert contents(session.path) == before
    assert session.add_frame(make_frame()).number == 1


def test_a_reader_changes_nothing_and_a_writer_puts_right_what_a_kill_left(path, configuration, make_frame):
    with Session.create(path, configuration) as session:
        record = session.add_frame(make_frame(1))
    torn, orphan = b'{"sequence": 4, "time": "2026-0', frame_to_tiff(make_frame(2), compress=False)
    with (path / "journal.jsonl").open("ab") as file:
        file.write(torn)
    (path / "frames/0007_light_5ms.tif").write_bytes(orphan)
    for name in ("frames/.labcdp-0123456789abcdef.part.tif", ".labcdp-0123456789abcdef.part.end", ".mine.part"):
        (path / name).write_bytes(b"half")
    before = contents(path)
    reader = Session.open(path)
    assert (reader.frames(), reader.unrecorded()) == ([record], [".mine.part", "frames/0007_light_5ms.tif"])
    with pytest.raises(SessionError, match=r"journal.jsonl ends with an incomplete line"):
        reader.verify()
    assert contents(path) == before
    with Session.open(path, writable=True) as session:
        event = session.records[-1]
        assert session.add_frame(make_frame(3)).file.name == "frames/0008_light_5ms.tif"
        session.verify()
    assert (event.kind, event.content, event.file.name) == ("torn line", {"line": 4}, "journal.torn-0004-1.txt")
    assert (path / "journal.torn-0004-1.txt").read_bytes() == torn
    assert (path / "frames/0007_light_5ms.tif").read_bytes() == orphan
    assert [path.name for path in path.rglob(".*")] == [".mine.part"]


@pytest.mark.parametrize("name", ["mine.png", "frames/0001_mine.tif", ".mine.part"])
def test_a_session_is_removed_without_files_of_others_only(path, configuration, name):
    Session.create(path, configuration).close()
    (path / name).write_bytes(b"mine")
    before = contents(path)
    with (
        Session.open(path, writable=True) as session,
        pytest.raises(SessionError, match="not belong to the session"),
    ):
        session.remove()
    assert contents(path) == before
    (path / name).unlink()
    with pytest.raises(SessionError, match="not open for writing"):
        Session.open(path).remove()
    with Session.open(path, writable=True) as session:
        session.remove()
    assert not any(path.parent.iterdir())


def test_one_frame_that_cannot_be_recorded_takes_back_the_whole_batch(session, make_frame):
    batch = [(make_frame(seed), "light", None) for seed in range(4)]
    bad = replace(batch[2][0], temperature_c=float("nan"))
    with pytest.raises(InputError):
        session.add_frames([*batch[:2], (bad, "light", None), batch[3]])
    assert (session.frames(), list((session.path / "frames").iterdir())) == ([], [])
    records = session.add_frames(batch)
    assert [(record.number, session.load(record).frame_id) for record in records] == [(n + 1, n) for n in range(4)]
    session.verify()


def test_a_clock_set_back_is_recorded_once_and_the_order_stays(path, configuration, new_reading):
    clock = SimulatedClock()
    with Session.create(path, configuration, clock=clock) as session:
        clock.sleep(7200)
        session.add_reading(new_reading(1.0), "upper left")
        # Somebody sets the time of day.
        clock.now = lambda: SimulatedClock.now(clock) - timedelta(hours=1)
        for value in (2.0, 3.0):
            session.add_reading(new_reading(value), "upper left")
    again = Session.open(path)
    again.verify()
    assert [r.reading.value for r in again.readings()] == [1, 2, 3]
    assert [r.content for r in again.records if isinstance(r, EventRecord) and r.kind == "clock"] == [
        {"set_back_s": 3600.0}
    ]


@contextmanager
def full_at(size):
    """A limit of the size of files, which is met."""
    largest = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, largest[1]))
    try:
        with pytest.raises(SessionError, match=r"cannot be written \(File too large\): raise the limit"):
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, largest)


def test_no_space_for_a_frame_or_for_a_line_of_the_journal(path, configuration, make_frame):
    """Of the line a part is written, and the whole frame before it goes too."""
    large = make_frame(shape=(120, 160))
    with Session.create(path, configuration) as session:
        session.add_frame(make_frame())
        journal = path / "journal.jsonl"
        with full_at(large.dn.nbytes // 2):
            session.add_frame(large)
        session.add_frame(make_frame())
        session.add_event("a line longer than a frame", {"text": "x" * 5000})
        size = journal.stat().st_size
        for add in (lambda: session.add_frame(make_frame()), lambda: session.add_event("pause", {})):
            with full_at(size + 50):
                add()
        assert journal.stat().st_size == size
        session.verify()
        session.add_frame(large)
    Session.open(path).verify()
    names = sorted(file.name for file in (path / "frames").iterdir())
    assert names == ["0001_light_5ms.tif", "0002_light_5ms.tif", "0003_light_5ms.tif"]


def test_of_many_that_make_one_session_at_once_one_gets_it(path, configuration):
    def create(_):
        try:
            return Session.create(path, configuration)
        except SessionError as error:
            return str(error)

    with ThreadPoolExecutor(8) as pool:
        made = list(pool.map(create, range(8)))
    (session,) = [one for one in made if isinstance(one, Session)]
    session.add_event("begun", {})
    session.close()
    assert {one for one in made if one is not session} == {
        f"{path} exists already: choose a new folder, or open the session in it"
    }
    assert os.listdir(path.parent) == [path.name]


def test_what_was_left_of_a_session_that_was_being_made_is_removed_unless_it_still_is(path, configuration):
    names = [f".{path.name}.{end}" for end in ("0123abcd.part", "4567abcd.part", "notes.part")]
    left, held, other = (path.parent / name for name in names)
    for folder in (left, held, other):
        (folder / "frames").mkdir(parents=True)
    descriptor = os.open(held, os.O_RDONLY)
    try:
        assert lock(descriptor)
        Session.create(path, configuration).close()
    finally:
        os.close(descriptor)
    assert sorted(os.listdir(path.parent)) == sorted([held.name, other.name, path.name])


@pytest.mark.parametrize("name", [255 * "a", 127 * "ü", 255 * "\udcff"])
def test_a_session_has_any_name_that_the_file_system_allows(tmp_path, configuration, name):
    Session.create(tmp_path / name, configuration).close()
    assert os.listdir(tmp_path) == [name]
    with Session.open(tmp_path / name, writable=True) as session:
        session.remove()
    assert os.listdir(tmp_path) == []
