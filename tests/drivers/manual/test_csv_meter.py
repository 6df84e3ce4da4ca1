"""A meter whose readings stand in a CSV file."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.reading import MeterIdentity
from labcdp.drivers.csv_meter import CsvMeter
from labcdp.drivers.manual import MeterAccuracy
from labcdp.drivers.meter import MeterError

METER = MeterIdentity("L 1003", "4711")
ACCURACY = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.005, digits=2)


@pytest.fixture(scope="module")
def meter_of(tmp_path_factory):
    """Write a file and return a meter for it, not open."""
    path = tmp_path_factory.mktemp("csv") / "readings.csv"

    def make(text):
        path.write_text(text, encoding="utf-8")
        return CsvMeter(path, METER, ACCURACY)

    return make


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffpatch;luminance_cd_m2\r\nleft;10,5\r\n",
        "patch\tluminance_cd_m2\nleft\t10,5\n",
        'patch,luminance_cd_m2\nleft,"10,5"\n',
        "Patch , Luminance_cd_m2 ,note\n left , 10.5 ,dusty\n\n",
        "unit,patch,luminance\ncd/m2,left,10.5\n",
        "patch,luminance\nleft,10.5 cd/m2\n",
    ],
)
def test_ways_to_write_the_file(meter_of, text):
    with meter_of(text) as meter:
        meter.point("left")
        reading = meter.measure()
        with pytest.raises(MeterError, match=r"csv has 1 readings of patch 'left', all of them are used: add"):
            meter.measure()
    assert (reading.value, reading.unit, reading.resolution, reading.meter) == (10.5, "cd/m2", 0.1, METER)
    widths = (reading.digits_half_width, reading.scale_half_width_rel, reading.repeatability_rel)
    assert widths == pytest.approx((0.2, 0.03, 0.005))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("patch,value\nleft,1\n", r"line 1: the columns are patch, value: give one of luminance_cd_m2"),
        ("patch,luminance_cd_m2\na,1\nb\n", r"line 3: it has 1 cells, the header has 2"),
        ("patch;luminance_cd_m2\na;12,3\nb;1.234\n", r"line 3: '1.234' has another decimal mark than"),
        ("patch,luminance_cd_m2\na,12,3\n", r"line 2: it has 3 cells, .*a number with a decimal comma"),
        ("patch,luminance_cd_m2\n\na,bright\n", r"line 3: 'bright' is not a number"),
        ("patch,luminance\na,1\n", r"line 2: the luminance '1' has no unit"),
        ("patch,luminance_cd_m2,time\na,1,noon\n", r"line 2: the time 'noon' is not known"),
        ('patch,luminance_cd_m2\na,"1\n', r"line 2: unexpected end of data"),
    ],
)
def test_errors_name_file_line_and_value(meter_of, text, message):
    with pytest.raises(InputError, match=message) as caught:
        meter_of(text).open()
    assert "\n" not in str(caught.value)


@given(st.lists(st.tuples(st.text("abc ä.-", min_size=1).filter(str.strip), st.integers(0, 10**6)), min_size=1))
def test_every_reading_of_a_file_is_given_once_in_the_order_of_its_patch(meter_of, rows):
    text = "".join(f"{patch};{n / 1000:.3f}\n" for patch, n in rows)
    order, given_back = sorted(rows, key=lambda row: row[0].strip()), []
    with meter_of("patch;luminance_cd_m2\n" + text) as meter:
        for patch, _ in order:
            meter.point(patch.strip())
            given_back.append((patch, round(meter.measure().value * 1000)))
    assert given_back == order
