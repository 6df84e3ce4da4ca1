"""Frames recorded together, records that no longer count, and a clock that is set back."""

import logging
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from labcdp.clock import SimulatedClock
from labcdp.errors import InputError, SessionError
from labcdp.session import EventRecord, Session


@pytest.fixture
def session(tmp_path, configuration):
    with Session.create(tmp_path / "session", configuration) as session:
        yield session


class WallClock(SimulatedClock):
    """A clock whose time of day somebody sets."""

    def __init__(self):
        super().__init__()
        self.offset = timedelta(0)

    def now(self):
        return super().now() + self.offset


def test_frames_recorded_together_are_as_those_recorded_one_by_one(session, make_frame):
    alone = session.add_frame(make_frame(0))
    both = session.add_frames([(make_frame(1), "light", None), (make_frame(2, 0.02), "dark", None)])
    assert [record.number for record in session.frames()] == [1, 2, 3]
    assert session.frames() == [alone, *both]
    assert [record.file.name for record in both] == ["frames/0002_light_5ms.tif", "frames/0003_dark_20ms.tif"]
    for seed, record in enumerate(session.frames()):
        np.testing.assert_array_equal(session.load(record).dn, make_frame(seed).dn, strict=True)
    session.verify()


def test_frames_recorded_together_are_flushed_with_one_line_of_the_journal_each_and_one_flush(
    session, make_frame, monkeypatch
):
    """One flush for each frame's file, one for the folder, one for the journal, two for the journal's end."""
    import os

    flushed = []
    fsync = os.fsync
    monkeypatch.setattr(os, "fsync", lambda descriptor: (flushed.append(descriptor), fsync(descriptor))[1])
    session.add_frames([(make_frame(seed), "light", None) for seed in range(8)])
    assert len(flushed) == 8 + 1 + 1 + 2
    assert len(session.frames()) == 8


def test_one_frame_that_cannot_be_recorded_takes_back_the_whole_batch(session, make_frame, monkeypatch):
    from labcdp.session import store

    good = store.frame_to_tiff

    def fails_at_the_third(frame, compress):
        if frame.frame_id == 2:
            raise InputError("no")
        return good(frame, compress)

    monkeypatch.setattr(store, "frame_to_tiff", fails_at_the_third)
    batch = [(make_frame(seed), "light", None) for seed in range(4)]
    with pytest.raises(InputError, match=r"^no$"):
        session.add_frames(batch)
    assert session.frames() == []
    assert list((session.path / "frames").iterdir()) == []
    monkeypatch.undo()
    assert [record.number for record in session.add_frames(batch)] == [1, 2, 3, 4]
    session.verify()


def test_a_wrong_role_or_patch_of_one_costs_nothing(session, make_frame):
    with pytest.raises(InputError, match=r"^role is 'grey': give 'light' or 'dark'$"):
        session.add_frames([(make_frame(0), "light", None), (make_frame(1), "grey", None)])
    with pytest.raises(InputError, match=r"^patch is 'no': give one of the target's, upper left, upper right$"):
        session.add_frame(make_frame(0), patch="no")
    assert session.frames() == []


def test_a_frame_of_one_patch_keeps_its_name(session, make_frame, configuration):
    session.add_frame(make_frame(0), patch="upper right")
    session.close()
    assert [record.patch for record in Session.open(session.path).frames()] == ["upper right"]


def test_what_was_taken_again_no_longer_counts_but_stays(session, make_frame, make_reading):
    kept = session.add_frame(make_frame(0))
    flickered = session.add_frame(make_frame(1))
    wrong = session.add_reading(make_reading(), "upper left")
    session.supersede([flickered, wrong], "flicker of 3 %")
    again = session.add_frame(make_frame(2))
    reopened = Session.open(session.path)
    assert reopened.frames() == session.frames() == [kept, again]
    assert reopened.readings() == []
    assert reopened.load(flickered).frame_id == 1
    event = next(r for r in reopened.records if isinstance(r, EventRecord) and r.kind == "superseded")
    assert event.content == {"lines": [flickered.sequence, wrong.sequence], "reason": "flicker of 3 %"}
    session.verify()


def test_exposures_come_from_the_plan_or_were_found(session, configuration, tmp_path):
    assert session.exposures_s == (0.005, 0.02)
    plan = configuration.plan.model_copy(update={"exposures_s": None})
    with Session.create(tmp_path / "other", configuration.model_copy(update={"plan": plan})) as searched:
        assert searched.exposures_s is None
        searched.add_event("exposures", {"exposures_s": [0.1, 0.4]})
        searched.add_event("exposures", {"exposures_s": [0.2, 0.8]})
        assert searched.exposures_s == (0.2, 0.8)
        assert Session.open(searched.path).exposures_s == (0.2, 0.8)


def test_a_clock_set_back_is_said_and_recorded_once_and_the_order_stays(tmp_path, configuration, make_reading, caplog):
    clock = WallClock()
    with Session.create(tmp_path / "session", configuration, clock=clock) as session:
        clock.sleep(7200)
        session.add_reading(make_reading(1), "upper left")
        clock.offset = timedelta(hours=-1)
        with caplog.at_level(logging.WARNING):
            session.add_reading(make_reading(2), "upper left")
            session.add_reading(make_reading(3), "upper left")
    said = [record.getMessage() for record in caplog.records]
    assert said == [
        f"{tmp_path}/session/journal.jsonl: the computer's clock was set back by 3600 s; records keep their order by "
        "number"
    ]
    reopened = Session.open(tmp_path / "session")
    assert [r.reading.value for r in reopened.readings()] == [1, 2, 3]
    events = [r for r in reopened.records if isinstance(r, EventRecord) and r.kind == "clock"]
    assert [event.content for event in events] == [{"set_back_s": 3600.0}]
    reopened.verify()


def test_a_session_opened_with_a_clock_far_behind_says_so_at_the_first_record(
    tmp_path, configuration, make_reading, caplog
):
    ahead = SimulatedClock(datetime.now(UTC) + timedelta(days=400))
    Session.create(tmp_path / "session", configuration, clock=ahead).close()
    with Session.open(tmp_path / "session", writable=True) as session, caplog.at_level(logging.WARNING):
        session.add_reading(make_reading(1), "upper left")
    assert "the computer's clock was set back by 345" in caplog.text
    session.verify()


def test_a_clock_put_right_by_a_fraction_of_a_second_is_nothing_to_tell(tmp_path, configuration, make_reading, caplog):
    clock = WallClock()
    with Session.create(tmp_path / "session", configuration, clock=clock) as session:
        clock.offset = timedelta(seconds=-0.9)
        with caplog.at_level(logging.WARNING):
            session.add_reading(make_reading(1), "upper left")
    assert caplog.text == ""
    assert [r.kind for r in session.records if isinstance(r, EventRecord)] == ["session", "readme"]


def test_nobody_else_may_write_a_line_about_the_clock_or_what_counts(session):
    for kind in ("clock", "superseded"):
        with pytest.raises(InputError, match=rf"kind is '{kind}': give a name that is not one of"):
            session.add_event(kind, {})


def test_a_closed_session_takes_no_batch(session, make_frame):
    session.close()
    with pytest.raises(SessionError, match=r"is not open for writing: open it with writable=True$"):
        session.add_frames([(make_frame(0), "light", None)])
