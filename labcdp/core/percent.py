"""Fractions as a person writes them: 0.5, or with its sign "50%"; and percentages whose sign is missing."""

from __future__ import annotations

from decimal import Decimal
from math import isfinite
from typing import Any

import numpy as np

from .errors import InputError

#: Contrasts that are whole numbers from here on, 2000 %, are taken for percentages without their sign; those beyond the
#: other end are refused anyway.
_DOUBTFUL = range(20, 10**12)


def of_percent(text: str) -> float | None:
    """Turn ``50%`` into 0.5, and anything else into None."""
    try:
        # 2.3 / 100 is not the float nearest to 0.023.
        fraction = float(Decimal(text[:-1].strip()).scaleb(-2)) if text.isascii() and text.endswith("%") else None
    except ArithmeticError:
        return None
    return fraction if fraction is not None and isfinite(fraction) else None


def plain_fraction(value: Any) -> Any:
    """Return a percentage as a fraction, anything else as it is."""
    fraction = of_percent(value) if isinstance(value, str) else None
    return value if fraction is None else fraction


def plain_contrast(value: Any, name: str) -> Any:
    """Return a contrast that is a percentage as a fraction, anything else as it is.

    Raises
    ------
    InputError
        If it is a whole number so large that it is a percentage without its sign: 50 would be 5000 %. A float, as
        programs compute it, may be of any size.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if whole and int(value) in _DOUBTFUL:
        with_name = f"{name} is {value}" if name else f"is {value}"
        raise InputError(f'{with_name}, which would be {value}00 %: give it with its sign, "{value}%" or "{value}00%"')
    return plain_fraction(value)
