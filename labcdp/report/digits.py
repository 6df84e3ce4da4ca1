"""Numbers and times as text with significant digits only."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from math import floor, isfinite, log10

from ..core.table import Z_95 as Z_95
from ..metrics import DetectionResult

#: Text for an unknown value.
UNKNOWN = "unknown"

#: Most decimals of a probability.
_MOST_DECIMALS_OF_SHARE = 5

#: Characters that cannot be written to XML or drawn; names may contain them.
_UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


def decimals(value: float, significant: int) -> int:
    """Count the decimals for a number of significant digits; a negative number rounds to tens and so on."""
    if not isfinite(value) or value == 0:
        return significant
    exponent = floor(log10(abs(value)))
    # Rounding may add a digit, as from 9.96 to 10.
    if abs(round(value, significant - 1 - exponent)) >= 10 ** (exponent + 1):
        exponent += 1
    return significant - 1 - exponent


def fixed(value: float | None, n_decimals: int, sign: bool = False) -> str:
    """Write a value with a number of decimals, 0 never with a minus; `UNKNOWN` for None, nan and infinity."""
    if value is None or not isfinite(value):
        return UNKNOWN
    rounded = round(value, n_decimals) + 0.0  # makes -0.0 a 0.0
    return f"{rounded:{'+' if sign and rounded else ''}.{max(n_decimals, 0)}f}"


def significant(value: float, n_digits: int = 4) -> str:
    """Write a value with a number of significant digits."""
    return fixed(value, decimals(value, n_digits))


def with_half_width(value: float, half_width: float) -> str:
    """Write "value ± U", with two digits of U and the value rounded to match (GUM 7.2.6)."""
    n = decimals(half_width, 2) if half_width > 0 else decimals(value, 6)
    return f"{fixed(value, n)} ± {fixed(half_width, n)}"


def percent(fraction: float, n_digits: int = 6) -> str:
    """Write a fraction as percent with up to a number of significant digits: 0.76 is "76 %"."""
    return f"{100 * fraction:.{n_digits}g} %"


def share_percent(share: float) -> str:
    """Write a share as percent, with two digits of the share or of its complement."""
    rest = min(share, 1 - share)
    if 0 < rest < 1e-6:
        return "less than 0.0001 %" if rest == share else "more than 99.9999 %"
    return f"{fixed(100 * share, decimals(100 * rest, 2) if rest else 0)} %"


def exposure(exposure_s: float) -> str:
    """Write an exposure in a convenient unit."""
    for unit, seconds in (("s", 1.0), ("ms", 1e-3)):
        if exposure_s >= seconds:
            return f"{exposure_s / seconds:.4g} {unit}"
    return f"{exposure_s * 1e6:.4g} µs"


def exposures(exposures_s: Iterable[float]) -> str:
    """Write several exposures, the shortest first."""
    return ", ".join(exposure(value) for value in sorted(exposures_s))


def cdp_decimals(result: DetectionResult) -> int:
    """Count the decimals that the 95 % interval of a CDP supports."""
    low, high = result.confidence_interval
    if not high > low:
        return 4
    return min(decimals((high - low) / 2, 2), _MOST_DECIMALS_OF_SHARE)


def cdp_interval(result: DetectionResult) -> str:
    """Write the 95 % interval of a CDP."""
    low, high = result.confidence_interval
    n = cdp_decimals(result)
    return f"{fixed(low, n)} to {fixed(high, n)}" if isfinite(low) and isfinite(high) else UNKNOWN


def printable(text: str) -> str:
    """Replace characters that cannot be shown."""
    return _UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", text)


def shortened(text: str, n_characters: int) -> str:
    """Truncate a text and make it printable."""
    text = printable(text)
    return text if len(text) <= n_characters else text[: n_characters - 1] + "…"


def day(time: datetime) -> str:
    """Write the day, in UTC."""
    return f"{time.astimezone(UTC):%Y-%m-%d}"


def minute(time: datetime) -> str:
    """Write day and time, in UTC."""
    return f"{time.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def listed(parts: Sequence[str]) -> str:
    """Write "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
