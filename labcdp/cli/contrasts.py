"""Contrasts as they are typed: single ones and ranges, in percent."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, InvalidOperation

from ..errors import InputError

#: Help for the option that gives them.
CONTRAST_HELP = (
    "Contrast to be detected, for example 1000%, or a range START:STOP:STEP, for example 10%:200%:10%; may be repeated."
)
#: Contrasts outside of this are taken for mistakes, in percent: light spans some 14 powers of ten.
_LEAST_PERCENT, _MOST_PERCENT = Decimal("0.000000001"), Decimal(1_000_000_000)
#: More are taken for a mistake in a range.
_MOST_CONTRASTS = 10_000


def parse_contrasts(texts: Sequence[str], name: str = "--contrast") -> tuple[float, ...]:
    """Turn ``1000%`` and ``10%:200%:10%`` into contrasts.

    Parameters
    ----------
    texts : sequence of str
        Each a percentage, or start, stop and step with colons between them, both ends in.
    name : str
        What messages call the option.

    Returns
    -------
    tuple of float
        Fractions (1.0 is 100 %), rising, each once; each the number nearest to the decimal that was typed.

    Raises
    ------
    InputError
        If there is none, a text is neither of the two, or a value is not above 0, or beyond all contrasts.
    """
    from ..contrast import contrast_range

    found: set[float] = set()
    for text in texts:
        parts = [_fraction(part, text, name) for part in text.split(":")]
        if len(parts) == 1:
            found.add(parts[0])
        elif len(parts) == 3:
            start, stop, step = parts
            if (stop - start) / step > _MOST_CONTRASTS:
                raise InputError(f"{name} is {text!r}, more than {_MOST_CONTRASTS} contrasts: give a larger step")
            try:
                found.update(contrast_range(start, stop, step))
            except InputError as error:
                raise InputError(f"{name} is {text!r}: {error}") from error
        else:
            raise _refusal(text, name)
    if not found:
        raise InputError(f"there is no contrast: give {name}, for example {name} 100%")
    return tuple(sorted(found))


def _fraction(part: str, text: str, name: str) -> float:
    try:
        if not part.strip().endswith("%"):
            raise _refusal(text, name)
        # In decimals: 1.1 / 100 is not the float nearest to 0.011.
        percent = Decimal(part.strip()[:-1].strip())
    except InvalidOperation:
        raise _refusal(text, name) from None
    if not (percent.is_finite() and percent > 0):
        raise InputError(f"{name} is {text!r}: give contrasts above 0%")
    if not _LEAST_PERCENT <= percent <= _MOST_PERCENT:
        raise InputError(f"{name} is {text!r}: give contrasts from {_LEAST_PERCENT:f}% to {_MOST_PERCENT:f}%")
    return float(percent / 100)


def _refusal(text: str, name: str) -> InputError:
    return InputError(f"{name} is {text!r}: give a percentage such as 1000%, or a range such as 10%:200%:10%")
