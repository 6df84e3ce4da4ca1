"""A meter whose readings are typed, and how numbers are read that people write."""

import re
from contextlib import suppress
from datetime import UTC, datetime
from decimal import Decimal
from math import hypot, isfinite, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.reading import MeterIdentity
from labcdp.drivers.file_meter import FileMeter
from labcdp.drivers.manual import ManualMeter, MeterAccuracy, parse_written
from labcdp.drivers.meter import MeterError

METER = MeterIdentity("L 1003", "4711", "2026-01-15")
ACCURACY = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.005, digits=2)


def measured(*answers):
    """What is measured where somebody types these answers."""
    left = iter(answers)
    with ManualMeter(lambda _prompt: next(left), METER, ACCURACY) as meter:
        return meter.measure()


def test_a_typed_number_is_a_reading_and_three_others_are_an_error():
    before, reading = datetime.now(UTC), measured("twelve", "-3", " 12,30 ")
    assert (reading.value, reading.unit, reading.resolution) == (12.3, "cd/m2", 0.01)
    assert (reading.meter, reading.raw) == (METER, " 12,30 ")
    assert before <= reading.timestamp <= datetime.now(UTC)
    assert (reading.peak, reading.held, reading.correction) == (False, True, None)
    assert reading.standard_uncertainty_common_rel == pytest.approx(0.03 / sqrt(3))
    assert reading.standard_uncertainty_random_cd_m2 == pytest.approx(hypot(0.02 / sqrt(3), 0.005 * 12.3))
    with pytest.raises(MeterError, match="typed"):
        measured("a", "b", "c", "12.3")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *((text, "is not a number") for text in ("", "1 2", "1.234,5")),
        *((text, "the unit .* is not known") for text in ("12.3 fL 4", "12 lx")),
        ("1,234", r"1\.234 or 1234"),
    ],
)
def test_what_is_not_a_luminance_says_why(text, message):
    with pytest.raises(InputError, match=message):
        parse_written(text)


@given(
    number=st.integers(0, 10**9),
    places=st.integers(0, 9),
    exponent=st.none() | st.integers(-9, 9),
    comma=st.booleans(),
    blanks=st.text(" \t", max_size=3),
    unit=st.sampled_from([None, "fL", "cd/m2", "cd/m^2", "cd/m²"]),
    spelt=st.sampled_from([str, str.lower, "+{}".format, lambda text: re.sub("^0(?=[.,])", "", text)]),
)
def test_a_written_number_is_read_with_its_last_digit(number, places, exponent, comma, blanks, unit, spelt):
    text = f"{Decimal(number).scaleb(-places):f}" + ("" if exponent is None else f"E{exponent:+03}")
    places -= exponent or 0
    text = spelt(text.replace(".", "," if comma else ".")) or "0"
    written = parse_written(f"{blanks}{text}{blanks}{unit or ''}{blanks}", comma_is_decimal=True)
    assert (written.value, written.unit) == (
        float(Decimal(number).scaleb(-places)),
        {None: None, "fL": "fL"}.get(unit, "cd/m2"),
    )
    assert written.resolution == pytest.approx(10.0**-places, rel=1e-12)


@given(
    st.text(max_size=20) | st.from_regex(r"[-+]?[0-9.,]{0,8}([eE][-+]?[0-9]{0,3})? ?[a-zA-Z/2^%]{0,4}", fullmatch=True)
)
def test_any_text_is_a_luminance_or_an_input_error(text):
    with suppress(InputError):
        written = parse_written(text)
        assert isfinite(written.value)
        assert written.value >= 0
        assert 0 < written.resolution < 1e100


# A meter whose readings are in a CSV file


@pytest.fixture(scope="module")
def meter_of(tmp_path_factory):
    """Write a file and return a meter for it, not open."""
    path = tmp_path_factory.mktemp("csv") / "readings.csv"

    def make(text):
        path.write_text(text, encoding="utf-8")
        return FileMeter(path, METER, ACCURACY)

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


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("note", ["a\u2028b", "a\x0bb", "a\x85b", "a\x0cb", '"a\nb"'])
def test_only_ends_of_lines_end_a_line(tmp_path, end, note):
    """RFC 4180, and CR alone; texts copied into a sheet bring other separators along."""
    lines = ["patch;luminance_cd_m2;note", f"white;12,5;{note}", "black;0,5;"]
    (tmp_path / "a.csv").write_bytes(end.join(lines).encode())
    with FileMeter(tmp_path / "a.csv", METER, ACCURACY) as meter:
        found = {patch: [one.value for one in readings] for patch, readings in meter.readings.items()}
    assert found == {"white": [12.5], "black": [0.5]}


@pytest.mark.parametrize("separator", [";", "\t", ","])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be"])
@pytest.mark.parametrize("head", ["", "sep={}", '"sep={}"', "SEP={}"])
def test_lists_as_spreadsheet_programs_save_them(tmp_path, separator, encoding, head):
    number = '"12,5"' if separator == "," else "12,5"
    lines = [*([head.format(separator)] if head else []), separator.join(("patch", "luminance_cd_m2")),
             separator.join(("white", number))]  # fmt: skip
    mark = b"\xfe\xff" if encoding == "utf-16-be" else b""
    (tmp_path / "a.csv").write_bytes(mark + "\r\n".join(lines).encode(encoding))
    with FileMeter(tmp_path / "a.csv", METER, ACCURACY) as meter:
        assert [reading.value for reading in meter.readings["white"]] == [12.5]
