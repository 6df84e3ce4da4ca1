"""Numbers as text."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.report import text as digits

POSITIVE = st.floats(1e-9, 1e9)


@given(POSITIVE, st.integers(1, 6))
def test_shows_the_significant_digits_of_decimal_arithmetic(value: float, n: int) -> None:
    # Decimal's g rounds half to even on the exact value, as round() does.
    expected = Decimal(f"{Decimal(value):.{n}g}")
    shown = Decimal(str(round(value, digits.decimals(value, n))))
    assert abs(shown - expected) <= expected * Decimal(10) ** -12
    assert digits.decimals(value, n) == n - 1 - expected.adjusted()


@pytest.mark.parametrize(
    ("shown", "arguments", "text"),
    [
        # JCGM 100:2008, 7.2.4: m_S = (100.021 47 +- 0.000 79) g
        (digits.with_half_width, (100.021472, 0.00079), "100.02147 ± 0.00079"),
        (digits.with_half_width, (5.0, 0.0996), "5.00 ± 0.10"),
        (digits.with_half_width, (-0.004, 0.5), "0.00 ± 0.50"),
        (digits.with_half_width, (4.0, float("inf")), "4.00 ± unknown"),
        # A share near all is not called all.
        (digits.share_percent, (1.0,), "100 %"),
        (digits.share_percent, (0.99972,), "99.972 %"),
        (digits.share_percent, (1e-8,), "less than 0.0001 %"),
        (digits.share_percent, (1 - 1e-8,), "more than 99.9999 %"),
        (digits.exposure, (0.0005,), "500 µs"),
    ],
)
def test_numbers_are_shown_with_the_digits_that_count(shown, arguments, text) -> None:
    assert shown(*arguments) == text


@given(st.text(max_size=50), st.integers(2, 20))
def test_shortened_text_fits_and_can_be_shown(text: str, n: int) -> None:
    short = digits.shortened(text, n)
    assert len(short) <= n
    short.encode()  # raises for a lone surrogate
    assert all(c >= " " for c in short)
