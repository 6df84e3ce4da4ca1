"""The log of a day at the live bench."""

from datetime import datetime, timedelta, timezone

import openpyxl
import pytest

from labcdp.core.errors import InputError
from labcdp.web.bench.day_log import DayLog, MeterReading

#: One minute to midnight, two hours east of Greenwich.
LATE = datetime(2026, 11, 29, 23, 59, tzinfo=timezone(timedelta(hours=2)))


class Clock:
    """A clock that a test sets."""

    def __init__(self):
        self.time = LATE

    def __call__(self):
        return self.time


def reading(clock, value):
    return MeterReading(clock(), "typed", value, "sky", 98.0, 1.0, 0.5)


def test_each_entry_is_on_the_disk_and_another_log_goes_on(tmp_path):
    clock, regions = Clock(), tmp_path / "bench.rois.json"
    log = DayLog(regions, clock)
    for value in (100.0, 50.0):
        log.add(reading(clock, value))
        assert DayLog(regions, clock).day == log.day
    log.delete(0)
    with pytest.raises(InputError, match="deleted"):
        log.delete(0)
    again = DayLog(regions, clock)
    assert [(number, one.luminance_cd_m2) for number, one in again.readings] == [(1, 50.0)]
    assert [path.name for path in tmp_path.iterdir()] == ["bench-log-2026-11-29.json"]

    # After midnight there is another one, and the first is as it was.
    before = again.path.read_bytes()
    clock.time += timedelta(minutes=2)
    again.add(reading(clock, 7.0))
    assert [one.luminance_cd_m2 for one in DayLog(regions, clock).day.readings] == [7.0]
    assert (tmp_path / "bench-log-2026-11-29.json").read_bytes() == before


def test_a_sheet_has_all_readings_and_each_export_is_a_file_of_its_own(tmp_path):
    clock = Clock()
    log = DayLog(tmp_path / "left.json", clock)
    log.add(reading(clock, 100.0), reading(clock, 50.0))
    log.delete(1)
    paths = [log.export(True), log.export(True)]
    assert [path.name for path in paths] == ["left-log-2026-11-29.xlsx", "left-log-2026-11-29-2.xlsx"]
    rows = list(openpyxl.load_workbook(paths[0])["readings"].iter_rows(min_row=2, max_row=3, values_only=True))
    assert [row[0] for row in rows] == ["2026-11-29 23:59:00+02:00"] * 2
    # Fractions with the format of a percentage: 98 of 100, and U for 95 %.
    assert rows[0][1] == "sky"
    assert rows[0][2:7] == pytest.approx((100, 1.96, 98, 0.98, -2), rel=1e-3)
    assert [row[-1] for row in rows] == [None, LATE.isoformat()]


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"format": "labcdp bench log 1", "readings": [{}]}'])
def test_another_file_is_not_overwritten(tmp_path, content):
    (tmp_path / "bench-log-2026-11-29.json").write_text(content)
    with pytest.raises(InputError, match="bench-log-2026-11-29"):
        DayLog(tmp_path / "bench.json", Clock())


def test_a_log_that_cannot_be_written_is_said_and_goes_on(tmp_path):
    clock = Clock()
    log = DayLog(tmp_path / "gone" / "bench.json", clock)
    log.add(reading(clock, 100.0))
    assert "cannot be written" in log.error
    (tmp_path / "gone").mkdir()
    log.add(reading(clock, 50.0))
    assert not log.error
    assert len(DayLog(tmp_path / "gone" / "bench.json", clock).day.readings) == 2
