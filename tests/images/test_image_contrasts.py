from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.cli.batch import Failure, end_batch, told, worked_through
from labcdp.cli.contrasts import parse_contrasts
from labcdp.cli.picture_options import picture_options, seconds
from labcdp.errors import CalibrationError, InputError
from labcdp.sources.picture import PictureOptions


def test_single_contrasts_and_ranges_are_sorted_and_each_once():
    assert parse_contrasts(["1000%", "10%:50%:20%", " 30 % ", "1000%"]) == (0.1, 0.3, 0.5, 10.0)


@given(st.decimals("0.01", "9999", places=2))
def test_a_contrast_is_the_float_nearest_to_what_was_typed(percent):
    assert parse_contrasts([f"{percent}%"]) == (float(Fraction(percent) / 100),)


@given(st.integers(1, 200), st.integers(1, 50), st.integers(0, 60))
def test_a_range_has_both_ends(start, step, n):
    found = parse_contrasts([f"{start}%:{start + n * step}%:{step}%"])
    assert found == tuple((start + k * step) / 100 for k in range(n + 1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1000", r"--contrast is '1000': give a percentage such as 1000%, or a range such as 10%:200%:10%"),
        ("1O%", r"--contrast is '1O%': give a percentage"),
        ("10%:20%", r"--contrast is '10%:20%': give a percentage"),
        ("0%", r"--contrast is '0%': give contrasts above 0%"),
        ("-5%", r"--contrast is '-5%': give contrasts above 0%"),
        ("1e400%", r"--contrast is '1e400%': give contrasts from 0.000000001% to 1000000000%$"),
        ("1e-400%", r"--contrast is '1e-400%': give contrasts from"),
        ("1e308%", r"--contrast is '1e308%': give contrasts from"),
        ("10%:1e400%:10%", r"--contrast is '10%:1e400%:10%': give contrasts from"),
        ("1e99999999999999999999%", r"--contrast is '1e99999999999999999999%': give "),
        ("inf%", r"--contrast is 'inf%': give contrasts above 0%"),
        ("nan%", r"--contrast is 'nan%': give contrasts above 0%"),
        ("10%:25%:10%", r"--contrast is '10%:25%:10%': steps of 0.1 from 0.1 do not meet 0.25: end at 0.2 or 0.3"),
        ("20%:10%:5%", r"--contrast is '20%:10%:5%': contrasts run from 0.2 down to 0.1"),
        ("0.001%:1000%:0.001%", r"more than 10000 contrasts: give a larger step"),
    ],
)
def test_what_is_no_contrast_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        parse_contrasts([text])


def test_no_contrast_is_refused():
    with pytest.raises(InputError, match=r"there is no contrast: give --of, for example --of 100%"):
        parse_contrasts([], "--of")


def test_a_batch_goes_on_and_tells_why_files_failed():
    def work(number):
        if number == 2:
            raise CalibrationError("two  is\nof another camera")
        if number == 3:
            raise PermissionError(13, "Permission denied")
        if number == 4:
            raise MemoryError
        return 10 * number

    found = list(worked_through([1, 2, 3, 4, 5], work, lambda n: f"file {n}"))
    assert [result for _, result in found] == [
        10,
        Failure("file 2", "two is of another camera"),
        Failure("file 3", "it cannot be read ([Errno 13] Permission denied): give a file you can read"),
        Failure("file 4", "there is not enough memory for it: give fewer pixels"),
        50,
    ]


def test_an_unforeseen_error_costs_only_its_file_and_asks_to_be_reported():
    found = [result for _, result in worked_through([1, 0, 2], lambda n: 1 / n)]
    reason = "an unforeseen error (ZeroDivisionError: division by zero): please report it, with this file"
    assert found == [1.0, Failure("0", reason), 0.5]


def test_ctrl_c_ends_a_batch():
    def work(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(worked_through([1], work))


def test_what_the_caller_does_with_a_result_is_not_caught():
    def write_all():
        for _ in worked_through([1, 2], str):
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_all()


def test_a_batch_ends_with_its_failures_and_status_1(capsys):
    import typer

    end_batch([], 3)
    with pytest.raises(typer.Exit) as ended:
        end_batch([Failure("a.png", "a.png is empty"), Failure("b.png", "no light")], 3, "pictures")
    assert ended.value.exit_code == 1
    assert capsys.readouterr().err == "labcdp: 2 of 3 pictures failed:\n  a.png is empty\n  b.png: no light\n"
    with pytest.raises(typer.Exit):
        end_batch([Failure("a.png", "a.png is empty")], 1)
    assert capsys.readouterr().err == "labcdp: a.png is empty\n"


def test_the_name_is_told_once():
    assert told(Failure("x", "it is bad")) == "x: it is bad"
    assert told(Failure("/a/x", "/a/x is bad")) == "/a/x is bad"


def test_options_that_are_typed_count_over_those_of_the_calibration():
    known = PictureOptions(exposure_s=0.01, gain_db=3.0, bit_depth=12)
    found = picture_options(known, "5ms", None, None, "Mono12Packed", "640x480")
    assert (found.exposure_s, found.gain_db, found.bit_depth) == (0.005, 3.0, 12)
    assert (found.pixel_format, found.size) == ("Mono12Packed", (640, 480))
    assert picture_options(known, None, 0.0, 10, None, None) == PictureOptions(
        0.01, 0.0, bit_depth=10, told=frozenset({"gain_db", "bit_depth"})
    )


@pytest.mark.parametrize(("text", "expected"), [("5ms", 0.005), ("20us", 2e-5), ("1.5s", 1.5)])
def test_times_are_read(text, expected):
    assert seconds(text, "--exposure") == pytest.approx(expected)


@pytest.mark.parametrize("text", ["5", "ms", "-1ms", "0s", "nans", "infs", "5 minutes"])
def test_what_is_no_time_is_refused(text):
    with pytest.raises(InputError, match=r"--exposure is .*: give a number above 0 with s, ms or us"):
        seconds(text, "--exposure")


@pytest.mark.parametrize("size", ["640", "640x480x3", "ax480"])
def test_what_is_no_size_is_refused(size):
    with pytest.raises(InputError, match=r"--size is .*: give width and height in pixels, for example 2464x2056"):
        picture_options(PictureOptions(), None, None, None, "Mono8", size)
