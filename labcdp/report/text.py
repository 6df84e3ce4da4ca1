"""Numbers, times, cells of tables and findings as text, rounded by their uncertainty."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from decimal import Decimal
from functools import cache, partial
from importlib.resources import files
from math import ceil, floor, isfinite, isinf, isnan, log10
from string import Formatter
from typing import Any

from ..core.clock import exposure_text
from ..core.errors import LabcdpError
from ..core.quantity import Z_95 as Z_95
from ..core.quantity import Quantity
from ..core.result import Finding, FindingValue, Severity, unique
from ..core.table import Column, Table
from ..metrics import Cdp

#: Text for a value that is not known, and for one that is missing in a table.
UNKNOWN, MISSING = "unknown", "-"


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


#: Most decimals of a number without an exponent.
_MOST_FIXED = 9


def fixed(value: float | None, n_decimals: int, sign: bool = False) -> str:
    """Write a value with a number of decimals, of many with an exponent, 0 never with a minus.

    `UNKNOWN` for None, nan and infinity.
    """
    if value is None or not isfinite(value):
        return UNKNOWN
    if n_decimals > _MOST_FIXED:
        # An exponent in place of tens of zeros.
        exponent = floor(log10(abs(value))) if value else -n_decimals
        return f"{value:{'+' if sign and value else ''}.{max(n_decimals + exponent, 0)}e}" if value else "0"
    rounded = round(value, n_decimals) + 0.0  # makes -0.0 a 0.0
    return f"{rounded:{'+' if sign and rounded else ''}.{max(n_decimals, 0)}f}"


def significant(value: float, n_digits: int = 4) -> str:
    """Write a value with a number of significant digits."""
    return fixed(value, decimals(value, n_digits))


def with_half_width(value: float, half_width: float, sign: bool = False) -> str:
    """Write "value ± U", with two digits of U and the value rounded to match (GUM 7.2.6)."""
    n = decimals(half_width, 2) if half_width > 0 else decimals(value, 6)
    return f"{fixed(value, n, sign)} ± {fixed(half_width, n)}"


def bounded(value: float, bound: str, unit: str = "", n_digits: int = 3) -> str:
    """Write a value that is a bound, as ``> 128 cd/m²``: rounded away from the true one, so that it stays one.

    Parameters
    ----------
    value : float
        The value.
    bound : {'>', '<', '?'}
        Whether the true one is larger, smaller, or not known.
    unit : str
        Its unit; may be empty.
    n_digits : int
        Significant digits.
    """
    if bound == "?" or not isfinite(value):
        return UNKNOWN
    n = n_digits - 1 - floor(log10(abs(value))) if value else n_digits
    # What is a short decimal stays it: 0.3 in steps of 0.001 is 299.99… of them.
    steps = round(value * 10.0**n, 6)
    away = floor(steps) if bound == ">" else ceil(steps)
    return f"{bound} {fixed(away / 10.0**n, n)} {unit}".rstrip()


def measured_text(value: float, u: float, bound: str = "") -> str:
    """Write a value with U (95 %), without it if u is not known; or a bound.

    Examples
    --------
    >>> measured_text(128.31, 0.5), measured_text(128.31, 0.5, ">")
    ('128.31 ± 0.98', '> 128')
    """
    if bound:
        return bounded(value, bound)
    return with_half_width(value, Z_95 * u) if isfinite(u) else significant(value)


def measured_contrast_text(contrast: Quantity, bound: str = "") -> str:
    """Write a contrast in percent with U (95 %), without it if u is not known; or a bound."""
    if not isfinite(contrast.value):
        return MISSING if isnan(contrast.value) else "unbounded"
    text = measured_text(100 * contrast.value, 100 * contrast.u, bound)
    return text if text == UNKNOWN else f"{text} %"


def percent(fraction: float, n_digits: int = 6) -> str:
    """Write a fraction as percent with up to a number of significant digits: 0.76 is "76 %"."""
    return f"{100 * fraction:.{n_digits}g} %"


def share_percent(share: float) -> str:
    """Write a share as percent, with two digits of the share or of its complement."""
    rest = min(share, 1 - share)
    if 0 < rest < 1e-6:
        return "less than 0.0001 %" if rest == share else "more than 99.9999 %"
    return f"{fixed(100 * share, decimals(100 * rest, 2) if rest else 0)} %"


def length_text(length_m: float) -> str:
    """Write a length with the unit in which it is usual: mm, or µm below a tenth of that."""
    return f"{length_m * 1e3:.4g} mm" if length_m >= 1e-4 else f"{length_m * 1e6:.4g} µm"


def exposures(exposures_s: Iterable[float]) -> str:
    """Write several exposures, the shortest first."""
    return ", ".join(exposure_text(value) for value in sorted(exposures_s))


def cdp_decimals(result: Cdp[float]) -> int:
    """Count the decimals that the 95 % interval of a CDP supports."""
    low, high = result.interval
    if not high > low:
        return 4
    return min(decimals((high - low) / 2, 2), _MOST_OF_INTERVAL)


def cdp_interval(result: Cdp[float]) -> str:
    """Write the 95 % interval of a CDP."""
    low, high = result.interval
    n = cdp_decimals(result)
    return f"{fixed(low, n)} to {fixed(high, n)}" if isfinite(low) and isfinite(high) else UNKNOWN


def span(*texts: str) -> str:
    """Write "a to b", or one of them if they read the same."""
    return " to ".join(dict.fromkeys(texts))


def printable(text: str) -> str:
    """Replace characters that cannot be shown."""
    return _UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", text)


def shortened(text: str, n_characters: int) -> str:
    """Truncate a text and make it printable."""
    text = printable(text)
    return text if len(text) <= n_characters else text[: n_characters - 1] + "…"


def capitalised(text: str) -> str:
    """Begin a text with a capital, unless it begins with the name of a file."""
    return text[:1].upper() + text[1:] if text.partition(" ")[0].strip(",;:").replace("-", "").isalpha() else text


def sentence(text: str) -> str:
    """Return a text with a capital and a full stop."""
    return f"{capitalised(text).rstrip('.')}."


def day(time: datetime) -> str:
    """Write the day, in UTC."""
    return f"{time.astimezone(UTC):%Y-%m-%d}"


def minute(time: datetime) -> str:
    """Write day and time, in UTC."""
    return f"{time.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def listed(parts: Sequence[str]) -> str:
    """Write "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


#: Most decimals, however small the uncertainty; fewer for an interval, which is one of a probability.
_MOST_DECIMALS, _MOST_OF_INTERVAL = 6, 5


def text_table(table: Table) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the visible columns as text."""
    shown = [column for column in table.columns if column.shown]
    return [_head(column) for column in shown], [[cell_text(column, row) for column in shown] for row in table.rows()]


def is_number(values: Iterable[Any]) -> bool:
    """Whether a column holds numbers and is right-aligned."""
    return not isinstance(next((value for value in values if value is not None), ""), str | bool)


def cell_text(column: Column, row: Mapping[str, Any]) -> str:
    """Return one cell: text, ``value``, ``value ± U``, ``value (low to high)`` or ``> value``.

    Examples
    --------
    >>> from labcdp.core.table import Column
    >>> cell_text(Column("cdp", "CDP", low="low", high="high"), {"cdp": 0.93, "low": 0.91, "high": 0.95})
    '0.930 (0.910 to 0.950)'
    """
    value = cell_value(column, row)
    if expanded := cell_expanded(column, row):
        return f"{value} ± {expanded}"
    interval = cell_interval(column, row)
    return f"{value} ({interval})" if interval else value


def cell_value(column: Column, row: Mapping[str, Any]) -> str:
    """Return the value of a cell, rounded by its uncertainty but without it."""
    value = row[column.name]
    if value is None or isinstance(value, str):
        return printable(value) if value else MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isfinite(value):
        return "∞" if isinf(value) and value > 0 else MISSING
    if column.time:
        return exposure_text(value)
    factor = 100 if column.unit_in(row) == "%" else 1
    if bound := row.get(column.bound):
        return bounded(factor * value, bound)
    return fixed(factor * value, cell_decimals(column, row))


def cell_expanded(column: Column, row: Mapping[str, Any]) -> str:
    """Return U (95 %) of the value of a cell; empty where there is none."""
    expanded = row.get(column.expanded)
    if expanded is None or not (isfinite(expanded) and _has_uncertainty(column, row)):
        return ""
    return fixed((100 if column.unit_in(row) == "%" else 1) * expanded, cell_decimals(column, row))


def cell_interval(column: Column, row: Mapping[str, Any]) -> str:
    """Return the 95 % interval of the value of a cell; empty where there is none."""
    ends = row.get(column.low), row.get(column.high)
    if any(end is None or not isfinite(end) for end in ends) or not _has_uncertainty(column, row):
        return ""
    factor, n = 100 if column.unit_in(row) == "%" else 1, cell_decimals(column, row)
    low, high = (fixed(factor * end, n) for end in ends if end is not None)
    return f"{low} to {high}"


def _has_uncertainty(column: Column, row: Mapping[str, Any]) -> bool:
    """Whether a cell holds a finite number that is no bound and no time."""
    value = row[column.name]
    is_plain = value is None or isinstance(value, str | bool) or not isfinite(value)
    return not (is_plain or column.time or row.get(column.bound))


def cell_decimals(column: Column, row: Mapping[str, Any]) -> int:
    """Return how many decimals of a number are shown: two digits of its uncertainty (GUM 7.2.6), else its own.

    A negative number rounds to tens and so on. For values in percent the decimals of the percentage are counted.
    """
    factor = 100 if column.unit_in(row) == "%" else 1
    if column.decimals is not None:
        return column.decimals
    uncertainty = row.get(column.expanded)
    if uncertainty is None:
        low, high = row.get(column.low), row.get(column.high)
        uncertainty = (high - low) / 2 if low is not None and high is not None else None
    if uncertainty is not None and isfinite(uncertainty) and uncertainty > 0:
        return min(decimals(factor * uncertainty, 2), _MOST_OF_INTERVAL if column.low else _MOST_DECIMALS)
    value = row[column.name]
    if column.digits == 0:
        return max(-int(Decimal(f"{factor * value:.6g}").as_tuple().exponent), 0)
    return 0 if isinstance(value, int) else decimals(factor * value, column.digits)


def _head(column: Column) -> str:
    extra = " ± U" if column.expanded else ", 95 % interval" if column.low else ""
    if column.time:
        return column.label
    return f"{column.label}{extra} ({column.unit})" if column.unit else f"{column.label}{extra}"


#: Longest quoted name from a file, and longest quoted message of labcdp, in characters.
_LONGEST_NAME, _LONGEST_SENTENCE = 100, 500
#: Format specifications for significant digits, also as a percentage or with a sign.
_NUMBER = re.compile(r"(\+?)(percent|digits)(\d*)")
#: A value and its U in a template, which are rounded alike.
_WITH_U = re.compile(r"\{(\w+):(\+?)(percent|digits)\d*\} ± \{(\w+):(?:percent|digits)\d*\}")


#: Other formats by their names.
_FORMATS: dict[str, Callable[[Any], str]] = {
    "percent": percent, "share": share_percent, "time": exposure_text, "length": length_text,
    "sentence": lambda text: shortened(text, _LONGEST_SENTENCE),
}  # fmt: skip


def _formatted(value: Any, spec: str) -> str:
    """Format a value of a finding by a specification of `finding_text`."""
    if isinstance(value, list):
        if spec.startswith("to "):
            return span(*(_formatted(part, spec[3:]) for part in value))
        return ", ".join(_formatted(part, spec) for part in value)
    if value is None:
        return UNKNOWN
    if spec in _FORMATS:
        return _FORMATS[spec](value)
    number = _NUMBER.fullmatch(spec)
    if number is not None:
        sign, kind, n_digits = number.groups()
        text = significant(100 * value if kind == "percent" else value, int(n_digits or 3))
        return f"{sign if value > 0 else ''}{text}{' %' if kind == 'percent' else ''}"
    if isinstance(value, str):
        return shortened(value, _LONGEST_NAME)
    # With z, a value that rounds to 0 has no minus.
    zero = isinstance(value, float) and spec[-1:] in ("f", "%")
    return format(value, re.sub(r"^\+?", r"\g<0>z", spec) if zero else spec)


def _value_with_u(values: Mapping[str, FindingValue], written: re.Match[str]) -> str:
    """Write "value ± U" for a match of `_WITH_U`; as the template has it if one of them is not known."""
    name, sign, kind, expanded_name = written.groups()
    value, expanded = values.get(name), values.get(expanded_name)
    if not isinstance(value, int | float) or not isinstance(expanded, int | float) or not isfinite(expanded):
        return written[0]
    factor, unit = (100, " %") if kind == "percent" else (1, "")
    return with_half_width(factor * value, factor * expanded, sign=bool(sign)) + unit


def finding_text(finding: Finding) -> str:
    """Return a finding as one or two sentences.

    The templates are in ``labcdp/data/findings/*.toml``, by code; they can quote ``{subject}`` and the finding's
    values. A subject that a template does not quote is put before the sentence. A value can be formatted as
    ``{x:percent}`` (a fraction, unrounded), ``{x:percent2}`` (with two significant digits), ``{x:share}`` (a fraction,
    with two digits of it or of its complement), ``{x:time}`` (seconds), ``{x:length}`` (metres), ``{x:digits3}`` (three
    significant digits), ``{x:percent2} ± {expanded_x:percent2}`` (two digits of U, and the value to the same place),
    ``{x:+percent2}`` and ``{x:+digits3}`` (with a sign), ``{x:sentence}`` (a message of labcdp's own, which may be
    long), or as in Python; a list of two ends as ``{x:to .1f}``. A finding's value ``files``, the input files it
    refers to, is put after the text.
    """
    template = templates().get(finding.code)
    if template is None:
        raise LabcdpError(f"there is no text for the finding {finding.code!r}: add it to data/findings")
    values = {"subject": finding.subject, **finding.values}
    # A finding in a file of an older version may lack a value that its text quotes today.
    text = "".join(
        literal + ("" if name is None else _formatted(values.get(name), spec or ""))
        for literal, name, spec, _ in Formatter().parse(_WITH_U.sub(partial(_value_with_u, finding.values), template))
    )
    if finding.subject and "{subject" not in template:
        text = f"{shortened(finding.subject, _LONGEST_NAME)}: {text}"
    files = finding.values.get("files")
    if isinstance(files, list):
        text += f" ({shortened(str(files[0]), _LONGEST_NAME) if len(files) == 1 else f'{len(files)} files'})"
    return printable(text)


def finding_sentence(finding: Finding) -> str:
    """Return a finding as a sentence that begins with a capital, or with the name of its subject."""
    text, name = finding_text(finding), shortened(finding.subject, _LONGEST_NAME)
    return text if name and text.startswith(name) else capitalised(text)


#: Most subjects of findings of one kind that are named.
_MOST_SUBJECTS = 8


def finding_lines(findings: Iterable[Finding], sentences: bool = False) -> list[tuple[Severity, str]]:
    """Return severity and text of findings, the most severe first; of several of one kind one line.

    The line is that of the first one, with how many there are besides, and what they are about. Failures for different
    reasons are of different kinds.
    """
    kinds: dict[tuple[Severity, str, str], list[Finding]] = {}
    for finding in unique(findings):
        reason = (
            str(finding.values.get("reason", "")).replace(_about(finding), "") if finding.severity == "error" else ""
        )
        kinds.setdefault((finding.severity, finding.code, reason), []).append(finding)
    return [
        (severity, _kind_line(same, finding_sentence if sentences else finding_text))
        for (severity, _, _), same in kinds.items()
    ]


def _about(finding: Finding) -> str:
    """Return what a finding is about: its subject, or a file."""
    return finding.subject or str(finding.values.get("path", ""))


def _kind_line(findings: Sequence[Finding], written: Callable[[Finding], str]) -> str:
    first, *others = findings
    text = written(first)
    if not others:
        return text
    subjects = [*dict.fromkeys(name for name in map(_about, others) if name not in ("", _about(first)))]
    named = [shortened(subject, _LONGEST_NAME) for subject in subjects[:_MOST_SUBJECTS]]
    more = f", and {len(subjects) - len(named)} more" if len(subjects) > len(named) else ""
    about = f": {', '.join(named)}{more}" if named else ""
    return f"{text} (and {len(others)} more of this kind{about})"


def warning_texts(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the texts of warnings and errors, each once."""
    return tuple(finding_text(finding) for finding in unique(findings) if finding.severity != "info")


@cache
def templates() -> dict[str, str]:
    """Return all texts by code; raises LabcdpError if a code is in two files."""
    texts: dict[str, str] = {}
    for file in sorted(files("labcdp").joinpath("data/findings").iterdir(), key=lambda file: file.name):
        for code, text in tomllib.loads(file.read_text(encoding="utf-8")).items():
            if code in texts:
                raise LabcdpError(f"the finding {code!r} has two texts, one of them in {file.name}")
            texts[code] = text
    return texts
