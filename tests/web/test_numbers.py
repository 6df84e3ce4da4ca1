"""Numbers as a person types them on pages."""

import pytest

from labcdp.core.errors import InputError
from labcdp.web.numbers import coordinates, number, number_list


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("1, 10, 100", (1, 10, 100)),
        ("1,5; 2,5 10", (1.5, 2.5, 10)),
        ("1,10,100", (1, 10, 100)),
        ("2,5", (2.5,)),
        ("-1e-3 .5", (-1e-3, 0.5)),
        ("", ()),
    ],
)
def test_a_comma_between_two_digits_is_that_of_a_decimal(text, numbers):
    assert number_list(text) == numbers


@pytest.mark.parametrize(
    "text",
    ["from 10, 20 to 30, 40", "10,20 30,40", "10,20,30,40", "x 10 y 20 to x 30, y 40", "(10, 20) to (30, 40)",
     "10 20 30 40", "10, 20, 30, 40", "10,0 20,0 30,0 40,0", "10.0; 20.0; 30.0; 40.0"],
)  # fmt: skip
def test_a_line_is_read_as_its_label_shows_it(text):
    assert coordinates(text, 4) == (10, 20, 30, 40)


def test_limits_have_words_unit_and_decimal_comma():
    assert coordinates("1,5 to 2,5 cd/m²", 2) == (1.5, 2.5)


@pytest.mark.parametrize("text", ["1,2,3", "ten", "1 2 3 4 5", "10 to 20"])
def test_something_else_is_refused(text):
    with pytest.raises(InputError):
        coordinates(text, 4)


def test_a_number_may_have_the_unit_of_its_field_and_no_other():
    assert (number("2,5 ms", "ms"), number("2.5", "ms")) == (2.5, 2.5)
    for text in ("2 s", "1.234,5", "1 2", "inf", "1e999", ""):
        with pytest.raises(InputError):
            number(text, "ms")
