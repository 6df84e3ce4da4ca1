"""Numbers as text."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.report import digits

POSITIVE = st.floats(1e-9, 1e9)


@given(POSITIVE, st.integers(1, 6))
def test_shows_the_significant_digits_of_decimal_arithmetic(value: float, n: int) -> None:
    # Decimal's g rounds half to even on the exact value, as round() does.
    expected = Decimal(f"{Decimal(value):.{n}g}")
    shown = Decimal(str(round(value, digits.decimals(value, n))))
    assert abs(shown - expected) <= expected * Decimal(10) ** -12
    assert digits.decimals(value, n) == n - 1 - expected.adjusted()


def test_gum_example_of_a_result_with_its_uncertainty() -> None:
    # JCGM 100:2008, 7.2.4: m_S = (100.021 47 +- 0.000 79) g
    assert digits.with_half_width(100.021472, 0.00079) == "100.02147 ± 0.00079"


@pytest.mark.parametrize(
    ("value", "half_width", "text"),
    [
        (12345.0, 123.0, "12340 ± 120"),
        (5.0, 0.0996, "5.00 ± 0.10"),
        (-0.004, 0.5, "0.00 ± 0.50"),
        (4.0, 0.0, "4.00000 ± 0.00000"),
        (4.0, float("inf"), "4.00 ± unknown"),
    ],
)
def test_value_matches_two_digits_of_the_half_width(value: float, half_width: float, text: str) -> None:
    assert digits.with_half_width(value, half_width) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.0, "0 %"),
        (1.0, "100 %"),
        (0.5, "50 %"),
        (0.99972, "99.972 %"),
        (0.00028, "0.028 %"),
        (1e-8, "less than 0.0001 %"),
        (1 - 1e-8, "more than 99.9999 %"),
    ],
)
def test_a_share_near_all_is_not_called_all(share: float, text: str) -> None:
    assert digits.share_percent(share) == text


@pytest.mark.parametrize(("exposure_s", "text"), [(0.0005, "500 µs"), (0.0125, "12.5 ms"), (2.0, "2 s")])
def test_exposure_in_a_handy_unit(exposure_s: float, text: str) -> None:
    assert digits.exposure(exposure_s) == text


@given(st.text(max_size=50), st.integers(2, 20))
def test_shortened_text_fits_and_can_be_shown(text: str, n: int) -> None:
    short = digits.shortened(text, n)
    assert len(short) <= n
    short.encode()  # raises for a lone surrogate
    assert all(c >= " " for c in short)
