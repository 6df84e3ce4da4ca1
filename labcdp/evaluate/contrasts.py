"""How contrasts are written, on the command line and on pages: 1000%, lists and ranges."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from fractions import Fraction

from ..core.disk.files import shown
from ..core.errors import InputError

#: Contrasts outside these limits, in percent, are refused as mistakes: luminance spans some 14 decades.
_LEAST_PERCENT, _MOST_PERCENT = Decimal("0.000000001"), Decimal(1_000_000_000)
#: Larger counts in a range are refused as mistakes.
_MOST_CONTRASTS = 10_000


def parse_contrasts(texts: Sequence[str], name: str = "--contrast") -> tuple[float, ...]:
    """Turn ``1000%``, ``50%,100%`` and ``10%:200%:20`` into contrasts.

    Parameters
    ----------
    texts : sequence of str
        Each a percentage, several with commas between them, or ``start:stop:count[:log]`` with both ends included.
    name : str
        Name of the option in messages.

    Returns
    -------
    tuple of float
        Fractions (1.0 is 100 %), rising, each once; each the number nearest to the decimal that was typed.

    Raises
    ------
    InputError
        If a text has another form, or a contrast is not above 0 or out of range.
    """
    contrasts: set[float] = set()
    for text in texts:
        if ":" in text:
            contrasts.update(_range(text, name))
        else:
            contrasts.update(float(_fraction(part, text, name)) for part in text.split(","))
    return tuple(sorted(contrasts))


def _range(text: str, name: str) -> list[float]:
    parts = text.split(":")
    logarithmic = len(parts) == 4 and parts[3].strip() == "log"
    if not (len(parts) == 3 or logarithmic):
        raise _refusal(text, name)
    if parts[2].strip().endswith("%"):
        raise InputError(f"{name} is {shown(text)}: the third part is the number of contrasts, for example 10%:200%:20")
    start, stop = (_fraction(part, text, name) for part in parts[:2])
    try:
        count = int(parts[2])
    except ValueError:
        raise _refusal(text, name) from None
    if not (2 <= count <= _MOST_CONTRASTS and start < stop):
        raise InputError(
            f"{name} is {shown(text)}: give a smaller start, a larger stop, and a count of 2 to {_MOST_CONTRASTS}"
        )
    if logarithmic:
        ratio = float(stop / start)
        inner = [float(start) * ratio ** (step / (count - 1)) for step in range(1, count - 1)]
        return [float(start), *inner, float(stop)]
    return [float(start + (stop - start) * step / (count - 1)) for step in range(count)]


def _fraction(part: str, text: str, name: str) -> Fraction:
    """Turn ``1.1%`` into 11/1000: 1.1 / 100 is not the float nearest to 0.011."""
    try:
        if not (part.isascii() and part.strip().endswith("%")):
            raise _refusal(text, name)
        percent = Decimal(part.strip()[:-1].strip())
    except InvalidOperation:
        raise _refusal(text, name) from None
    if not (percent.is_finite() and percent > 0):
        raise InputError(f"{name} is {shown(text)}: give contrasts above 0%")
    if not _LEAST_PERCENT <= percent <= _MOST_PERCENT:
        raise InputError(f"{name} is {shown(text)}: give contrasts from {_LEAST_PERCENT:f}% to {_MOST_PERCENT:f}%")
    return Fraction(percent) / 100


def _refusal(text: str, name: str) -> InputError:
    return InputError(
        f"{name} is {shown(text)}: give a percentage such as 1000%, a list such as 50%,100%, or a range such as "
        "10%:200%:20"
    )
