"""Range and accuracy of the meters by their data sheets, and numbers as their displays round them."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Decimal
from math import floor, log10
from typing import Final

from ...core.reading import LuminanceUnit


@dataclass(frozen=True)
class MeterDataSheet:
    """Range and accuracy of a model.

    Source: Konica Minolta's data sheets, from memory; prefer the certificate of the meter at hand. The accuracy is
    stated for shown values in cd/m^2 and in fL alike.

    Parameters
    ----------
    model : str
        Name of the model.
    fast_range_cd_m2, slow_range_cd_m2 : (float, float)
        Lowest and highest luminance with FAST and with SLOW response.
    decimals : int
        Most decimals of the display.
    two_digits_below : float
        Displayed value above which the digit error is +-1 digit; below, it is +-2 digits.
    scale_half_width_rel : float
        Bound of the scale error, as a fraction.
    repeatability_rel : float
        Repeatability, as a fraction; the data sheet adds +-1 digit, which the digit error covers.
    digits : int
        Most significant digits of the display.
    """

    model: str
    fast_range_cd_m2: tuple[float, float]
    slow_range_cd_m2: tuple[float, float]
    decimals: int
    two_digits_below: float
    scale_half_width_rel: float = 0.02
    repeatability_rel: float = 0.002
    digits: int = 4

    def digit_error(self, value: float, unit: LuminanceUnit) -> int:
        """Bound of the digit error in digits; for a ratio, which hides the luminance, the larger one."""
        return 2 if unit == "%" or value < self.two_digits_below else 1

    def shown_resolution(self, value: float) -> float:
        """Value of the last digit the meter shows for a luminance of at least 0."""
        last = floor(log10(value)) + 1 - self.digits if value > 0 else -self.decimals
        return float(Decimal(1).scaleb(max(last, -self.decimals)))

    def sent_resolution(self, number: str) -> float:
        """Value of the last digit of a number as sent, but not finer than the last significant digit shown.

        The samples of the LS-110's manual fill all six characters (``125.35``, ``748000``), but the meter shows four
        digits, and a digit of the data sheet's accuracy is the last one shown. The zeros at the end of ``748000`` are
        placeholders (resolution 100); a fifth digit is finer than the stated accuracy (``125.35``: 0.1); a number of
        fewer digits is used as sent (``0.05``: 0.01).
        """
        sent = Decimal(number)
        last_place = sent.as_tuple().exponent
        assert isinstance(last_place, int)  # it is a letter only for NaN and infinity
        return float(Decimal(1).scaleb(max(last_place, sent.adjusted() + 1 - self.digits)))

    def display(self, value: float) -> Decimal | None:
        """Round a luminance of at least 0 like the meter, half up; None if it is too large for six characters."""
        exact = Decimal(repr(float(value)))
        for exponent in range(-self.decimals, 7 - self.digits):
            digits = int(exact.scaleb(-exponent).to_integral_value(ROUND_HALF_UP))
            if digits < 10**self.digits:
                return Decimal(digits).scaleb(exponent)
        return None


#: Acceptance angle 1 degree; +-2 digits from 0.001 to 0.999.
LS100: Final = MeterDataSheet("LS-100", (0.001, 299_900.0), (0.001, 49_990.0), 3, 1.0)
#: Acceptance angle 1/3 degree; +-2 digits from 0.01 to 9.99.
LS110: Final = MeterDataSheet("LS-110", (0.01, 999_900.0), (0.01, 499_900.0), 2, 10.0)
#: Acceptance angle 1 degree; three digits (Communication Manual of the CS-100A, command TDW).
CS100A: Final = MeterDataSheet("CS-100A", (0.01, 299_000.0), (0.01, 49_900.0), 2, 0.0, digits=3)
#: Acceptance angle 1 degree.
LS150: Final = MeterDataSheet("LS-150", (0.001, 999_900.0), (0.001, 999_900.0), 3, 1.0)
#: Acceptance angle 1/3 degree.
LS160: Final = MeterDataSheet("LS-160", (0.01, 9_999_000.0), (0.01, 9_999_000.0), 2, 10.0)
#: Acceptance angle 1 degree.
CS150: Final = MeterDataSheet("CS-150", (0.01, 999_900.0), (0.01, 999_900.0), 2, 1.0)
#: Acceptance angle 1/3 degree.
CS160: Final = MeterDataSheet("CS-160", (0.1, 9_999_000.0), (0.1, 9_999_000.0), 2, 10.0)
