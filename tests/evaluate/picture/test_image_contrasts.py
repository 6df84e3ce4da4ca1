from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.cli.pictures.batch import Failure, worked_through
from labcdp.cli.values import parse_contrasts, parse_pair
from labcdp.core.errors import CalibrationError, InputError


def test_single_contrasts_and_ranges_are_sorted_and_each_once():
    assert parse_contrasts(["1000%", "10%:50%:3", " 30 % ", "1000%,20%"]) == (0.1, 0.2, 0.3, 0.5, 10.0)
    assert parse_contrasts(["10%:1000%:3:log"]) == pytest.approx((0.1, 1.0, 10.0), rel=1e-15)


@given(st.decimals("0.01", "9999", places=2))
def test_a_contrast_is_the_float_nearest_to_what_was_typed(percent):
    assert parse_contrasts([f"{percent}%"]) == (float(Fraction(percent) / 100),)


@given(st.integers(1, 200), st.integers(1, 50), st.integers(1, 60))
def test_a_range_has_both_ends(start, step, n):
    found = parse_contrasts([f"{start}%:{start + n * step}%:{n + 1}"])
    assert found == tuple((start + k * step) / 100 for k in range(n + 1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "1000",
            r"--contrast is '1000': give a percentage such as 1000%, a list such as 50%,100%, or a range such as",
        ),
        ("0%", r"--contrast is '0%': give contrasts above 0%"),
        ("1e400%", r"--contrast is '1e400%': give contrasts from 0.000000001% to 1000000000%$"),
        ("10%:20%:10%", r"the third part is the number of contrasts, for example 10%:200%:20"),
        ("20%:10%:5", r"give a smaller start, a larger stop, and a count of 2 to 10000"),
        ("50%,,100%", r"--contrast is '50%,,100%': give a percentage"),
    ],
)
def test_what_is_not_a_contrast_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        parse_contrasts([text])


def test_pairs_are_two_names_that_may_hold_colons():
    assert parse_pair("a:b:c", ["a:b", "c", "b"]) == ("a:b", "c")
    for text, message in (("a", "by a colon"), ("a:x", "no 'x'"), ("a:a", "two different")):
        with pytest.raises(InputError, match=message):
            parse_pair(text, ["a", "b"])


def test_a_batch_continues_and_tells_why_files_failed():
    def work(number):
        if number == 2:
            raise CalibrationError("two  is\nof another camera")
        if number == 3:
            raise PermissionError(13, "Permission denied")
        if number == 4:
            raise MemoryError
        return 10 * number

    found = list(worked_through([1, 2, 3, 4, 5], work, 1))
    assert found == [
        (0, 10),
        (1, Failure("2", "two is of another camera")),
        (2, Failure("3", "it cannot be read ([Errno 13] Permission denied): check the file and its permissions")),
        (3, Failure("4", "not enough memory: use fewer pixels")),
        (4, 50),
    ]


def test_processes_do_as_one_by_one():
    items = ["1.5", "none", "-2"]
    assert sorted(worked_through(items, float, 2)) == list(worked_through(items, float, 1))


def test_ctrl_c_ends_a_batch():
    def work(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(worked_through([1], work))
