"""Findings as text, from the templates in ``labcdp/data/findings``."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Any

from ..core.errors import LabcdpError
from ..core.finding import Finding, unique
from .digits import exposure, percent, printable, share_percent, shortened, significant

#: Longest quoted name from a file, and longest quoted message of labcdp, in characters.
_LONGEST_NAME, _LONGEST_SENTENCE = 100, 500
#: Format specifications for significant digits, also as a percentage or with a sign.
_NUMBER = re.compile(r"(\+?)(percent|digits)(\d*)")


class _Words(Formatter):
    """Format specifications in addition to those of Python: see `finding_text`."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, list):
            return ", ".join(self.format_field(one, format_spec) for one in value)
        if value is None:
            return "unknown"
        if format_spec == "percent":
            return percent(value)
        if format_spec == "share":
            return share_percent(value)
        if format_spec == "time":
            return exposure(value)
        if format_spec == "sentence":
            return shortened(value, _LONGEST_SENTENCE)
        number = _NUMBER.fullmatch(format_spec)
        if number is not None:
            sign, kind, n_digits = number.groups()
            text = significant(100 * value if kind == "percent" else value, int(n_digits or 3))
            return f"{sign if value > 0 else ''}{text}{' %' if kind == 'percent' else ''}"
        if isinstance(value, str):
            return shortened(value, _LONGEST_NAME)
        return str(super().format_field(value, format_spec))


def finding_text(finding: Finding) -> str:
    """Return a finding as one or two sentences.

    The templates are in ``labcdp/data/findings/*.toml``, by code; they can quote ``{subject}`` and the finding's
    values. A subject that a template does not quote is put before the sentence. A value can be formatted as
    ``{x:percent}`` (a fraction, unrounded), ``{x:percent2}`` (with two significant digits), ``{x:share}`` (a fraction,
    with two digits of it or of its complement), ``{x:time}`` (seconds), ``{x:digits3}`` (three significant digits),
    ``{x:+percent2}`` and ``{x:+digits3}`` (with a sign), ``{x:sentence}`` (a message of labcdp's own, which may be
    long), or as in Python. A finding's value ``files``, the input files it refers to, is put after the text.
    """
    template = templates().get(finding.code)
    if template is None:
        raise LabcdpError(f"there is no text for the finding {finding.code!r}: add it to data/findings")
    text = _Words().vformat(template, (), {"subject": finding.subject, **finding.values})
    if finding.subject and "{subject" not in template:
        text = f"{shortened(finding.subject, _LONGEST_NAME)}: {text}"
    files = finding.values.get("files")
    if isinstance(files, list):
        text += f" ({shortened(str(files[0]), _LONGEST_NAME) if len(files) == 1 else f'{len(files)} files'})"
    return printable(text)


def warning_texts(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the texts of warnings and errors, each once."""
    return tuple(finding_text(finding) for finding in unique(findings) if finding.severity != "info")


@cache
def templates() -> dict[str, str]:
    """Return all texts by code; raises LabcdpError if a code is in two files."""
    found: dict[str, str] = {}
    for file in sorted(files("labcdp").joinpath("data/findings").iterdir(), key=lambda one: one.name):
        for code, text in tomllib.loads(file.read_text(encoding="utf-8")).items():
            if code in found:
                raise LabcdpError(f"the finding {code!r} has two texts, one of them in {file.name}")
            found[code] = text
    return found
