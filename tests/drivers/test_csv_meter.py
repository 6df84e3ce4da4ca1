"""A meter whose readings stand in a CSV file."""

import os
from contextlib import suppress
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers.csv_meter import CsvMeter
from labcdp.drivers.meter import MeterError, MeterNotFoundError, measure_series
from labcdp.drivers.written_reading import MeterAccuracy
from labcdp.errors import InputError, LabcdpError
from labcdp.reading import MeterIdentity

METER = MeterIdentity("L 1003", "4711")
ACCURACY = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.005, digits=2)


@pytest.fixture
def meter_of(tmp_path):
    """Write a file and return a meter for it, not open."""

    def make(text):
        path = tmp_path / "readings.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return CsvMeter(path, METER, ACCURACY)

    return make


def test_readings_come_by_patch_in_the_order_of_the_file(meter_of):
    text = "patch,luminance_cd_m2\nleft,10.5\nright,99\nleft,10.7\nleft,10.60\n"
    with meter_of(text) as meter:
        meter.point("left")
        first = meter.measure()
        meter.point("right")
        assert meter.measure().value == 99
        meter.point("left")
        assert [meter.measure().value for _ in range(2)] == [10.7, 10.6]
        with pytest.raises(
            MeterError, match=r"readings\.csv has 3 readings of patch 'left', all of them are used: add"
        ):
            meter.measure()
    assert (first.value, first.unit, first.resolution, first.meter) == (10.5, "cd/m2", 0.1, METER)
    assert first.digits_half_width == pytest.approx(0.2)
    assert (first.scale_half_width_rel, first.repeatability_rel) == (0.03, 0.005)
    assert first.raw == "left,10.5"


@pytest.mark.parametrize(
    "text",
    [
        "patch;luminance_cd_m2\nleft;10,5\n",
        "\ufeffpatch;luminance_cd_m2\r\nleft;10,5\r\n",
        "patch\tluminance_cd_m2\nleft\t10,5\n",
        'patch,luminance_cd_m2\nleft,"10,5"\n',
        "Patch , Luminance_cd_m2 ,note\n left , 10.5 ,dusty\n\n",
        "patch;luminance;unit\nleft;10,5;cd/m^2\n",
        "unit,patch,luminance\ncd/m2,left,10.5\n",
        "patch,luminance\nleft,10.5 cd/m2\n",
        "patch;luminance_cd_m2\nleft;10.5 cd/m2\n",
    ],
)
def test_ways_to_write_the_file(meter_of, text):
    with meter_of(text) as meter:
        meter.point("left")
        reading = meter.measure()
    assert (reading.value, reading.unit, reading.resolution) == (10.5, "cd/m2", 0.1)


@pytest.mark.parametrize(
    "text",
    ["patch,luminance_fL\nleft,3.4\n", "patch,luminance,unit\nleft,3.4,fL\n", "patch;luminance\nleft;3,4 fL\n"],
)
def test_foot_lamberts(meter_of, text):
    with meter_of(text) as meter:
        meter.point("left")
        assert meter.measure().luminance_cd_m2 == pytest.approx(3.4 * 3.4262591, rel=1e-7)


def test_between_tabs_a_comma_is_the_decimal_comma(meter_of):
    with meter_of("patch\tluminance_fL\na\t65,806\n") as meter:
        assert meter.readings["a"][0].value == 65.806


def test_between_semicolons_a_comma_is_the_decimal_comma(meter_of):
    with meter_of("patch;luminance_cd_m2\nleft;1,234\n") as meter:
        meter.point("left")
        assert meter.measure().value == 1.234


def test_times_are_those_of_the_file(meter_of):
    text = "patch;luminance_cd_m2;time\nleft;1;2026-03-02T14:05:00+01:00\nleft;2;2026-03-02 14:05\n"
    with meter_of(text) as meter:
        meter.point("left")
        first, second = measure_series(meter, 2).readings
    assert first.timestamp == datetime(2026, 3, 2, 13, 5, tzinfo=UTC)
    assert second.timestamp == datetime(2026, 3, 2, 14, 5).astimezone()


def test_without_times_it_is_that_of_the_last_change(meter_of, tmp_path):
    meter = meter_of("patch,luminance_cd_m2\nleft,1\n")
    os.utime(tmp_path / "readings.csv", (1_700_000_000, 1_700_000_000))
    with meter:
        meter.point("left")
        assert meter.measure().timestamp == datetime.fromtimestamp(1_700_000_000, UTC)


def test_closing_forgets_what_was_given(meter_of):
    meter = meter_of("patch,luminance_cd_m2\nleft,1\n")
    for _ in range(2):
        with meter:
            meter.point("left")
            assert meter.measure().value == 1
    meter.close()
    with pytest.raises(MeterError, match=r"readings\.csv: the meter is not open: call open\(\)"):
        meter.measure()
    with pytest.raises(MeterError, match="not open"):
        meter.point("left")
    assert meter.identity is METER


def test_a_patch_is_chosen_first_and_exists(meter_of):
    with meter_of("patch,luminance_cd_m2\nleft,1\nright,2\n") as meter:
        with pytest.raises(MeterError, match=r"readings\.csv: no patch is chosen: call point\(\)"):
            meter.measure()
        with pytest.raises(MeterError, match="has no reading of patch 'middle', only of 'left', 'right': add it"):
            meter.point("middle")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"readings\.csv is empty: give a CSV file with the columns patch and luminance_cd_m2"),
        ("patch,luminance_cd_m2\n", r"readings\.csv has a header and no reading"),
        ("name,luminance_cd_m2\nleft,1\n", r"csv, line 1: there is no column patch, only name, luminance_cd_m2"),
        ("patch,value\nleft,1\n", r"csv, line 1: the columns are patch, value: give one of luminance_cd_m2"),
        ("patch,luminance_fL,luminance_cd_m2\na,1,2\n", r"csv, line 1: the columns are .*: give one of luminance_cd"),
        ("patch,patch,luminance_cd_m2\na,b,1\n", r"csv, line 1: the column patch is there twice: keep one"),
        ("patch,luminance_cd_m2\na,1\nb\n", r"csv, line 3: it has 1 cells, the header has 2: 'b'"),
        (
            "patch;luminance_cd_m2\na;12,3\nb;1.234\n",
            r"csv, line 3: '1.234' has another decimal mark than the numbers above: write all with a point or all with",
        ),
        (
            "patch;luminance_cd_m2\na;1.234,5\n",
            r"csv, line 2: '1.234,5' has another decimal mark",
        ),
        ("patch,luminance_cd_m2\na,12,3\n", r"csv, line 2: it has 3 cells, .*'a,12,3'; a number with a decimal comma"),
        ("patch,luminance_cd_m2\n\na,bright\n", r"csv, line 3: 'bright' is not a number: write it like"),
        ("patch,luminance_cd_m2\na,-1\n", r"csv, line 2: -1 is negative"),
        ("patch,luminance_cd_m2\na,\n", r"csv, line 2: '' is not a number"),
        ('patch,luminance_cd_m2\na,"1,234"\n', r"csv, line 2: '1,234' can mean 1\.234 or 1234"),
        ("patch,luminance_cd_m2\n ,1\n", r"csv, line 2: the patch has no name: ' ,1'"),
        ("patch,luminance\na,1\n", r"csv, line 2: the luminance '1' has no unit: name the column luminance_cd_m2"),
        ("patch,luminance_cd_m2\na,1 fL\n", r"csv, line 2: the luminance '1 fL' is in cd/m2 and in fL: give one"),
        ("patch,luminance,unit\na,1,lx\n", r"csv, line 2: the unit 'lx' is not known: give cd/m2 or fL"),
        ("patch,luminance_cd_m2,time\na,1,noon\n", r"csv, line 2: the time 'noon' is not known: write it like 2026"),
        ('patch,luminance_cd_m2\na,"1\n', r"csv, line 2: unexpected end of data"),
        ('patch,luminance_cd_m2\na,"1"2\n', r"csv, line 2: .*expected"),
    ],
)
def test_errors_name_file_line_and_value(meter_of, text, message):
    with pytest.raises(InputError, match=message) as caught:
        meter_of(text).open()
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(meter_of, tmp_path):
    with pytest.raises(InputError, match=r"readings\.csv is not UTF-8 text \(byte 22\): save it as CSV in UTF-8"):
        meter_of(b"patch,luminance_cd_m2\n\xfcber,1\n").open()
    with pytest.raises(MeterNotFoundError, match=r"no\.csv cannot be read \(No such file or directory\): give"):
        CsvMeter(tmp_path / "no.csv", METER, ACCURACY).open()
    CsvMeter(tmp_path / "no.csv", METER, ACCURACY).close()


@given(st.lists(st.tuples(st.text("abc ä.-", min_size=1).filter(str.strip), st.integers(0, 10**6)), min_size=1))
def test_every_reading_of_a_file_is_given_once(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("csv") / "readings.csv"
    path.write_text("patch;luminance_cd_m2\n" + "".join(f"{patch};{n / 1000:.3f}\n" for patch, n in rows))
    given_back = []
    with CsvMeter(path, METER, ACCURACY) as meter:
        for patch, _ in rows:
            meter.point(patch.strip())
            given_back.append((patch.strip(), round(meter.measure().value * 1000)))
    assert sorted(given_back) == sorted((patch.strip(), n) for patch, n in rows)


@given(st.text(max_size=80), st.booleans())
def test_arbitrary_text_raises_nothing_but_labcdp_errors(tmp_path_factory, text, with_header):
    path = tmp_path_factory.mktemp("csv") / "readings.csv"
    path.write_text(("patch,luminance_cd_m2\n" if with_header else "") + text, encoding="utf-8")
    with suppress(LabcdpError), CsvMeter(path, METER, ACCURACY) as meter:
        assert meter.identity is METER
