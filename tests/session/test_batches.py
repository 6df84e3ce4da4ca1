"""Frames recorded together, records that no longer count, and a clock that is set back."""

import logging
from datetime import timedelta

import numpy as np
import pytest

from labcdp.core.clock import SimulatedClock
from labcdp.core.errors import InputError
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


def test_one_frame_that_cannot_be_recorded_takes_back_the_whole_batch(session, make_frame, monkeypatch):
    from labcdp.session.frames import tiff_parts

    def fails_at_the_third(frame, compress):
        if frame.frame_id == 2:
            raise InputError("no")
        return tiff_parts(frame, compress)

    monkeypatch.setattr("labcdp.session.frames.tiff_parts", fails_at_the_third)
    batch = [(make_frame(seed), "light", None) for seed in range(4)]
    with pytest.raises(InputError, match=r"^no$"):
        session.add_frames(batch)
    assert session.frames() == []
    assert list((session.path / "frames").iterdir()) == []
    monkeypatch.undo()
    assert [record.number for record in session.add_frames(batch)] == [1, 2, 3, 4]
    session.verify()


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
