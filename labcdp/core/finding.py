"""Findings: what a user should know about a result, as values; the text is rendered in `labcdp.report.findings`."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

#: ``info``: worth knowing, nothing to do. ``warning``: the user should act. ``error``: a part has no result.
Severity: TypeAlias = Literal["info", "warning", "error"]

#: Values of a finding.
FindingValue: TypeAlias = str | int | float | bool | list[str] | list[float] | None


@dataclass(frozen=True)
class Finding:
    """Something a user should know.

    Parameters
    ----------
    code : str
        Code in lower case with hyphens, for example ``patch-saturated``; the key of its text.
    severity : {'info', 'warning', 'error'}
        How much it matters.
    subject : str
        The patch, region, frame, file or device it is about; empty for the whole result.
    values : mapping
        Numbers and names that the text quotes, with units in their names.
    """

    code: str
    severity: Severity = "warning"
    subject: str = ""
    values: Mapping[str, FindingValue] = field(default_factory=dict, hash=False)

    def __str__(self) -> str:
        """Return code, subject and values, as logs have them; `labcdp.report.findings` makes a sentence."""
        values = ", ".join(f"{name}={value}" for name, value in self.values.items())
        return " ".join(part for part in (self.code, self.subject and f"({self.subject})", values) if part)

    def within(self, place: str) -> Finding:
        """Return the finding with a place added to its subject, for example a colour plane."""
        return replace(self, subject=f"{self.subject}, {place}" if self.subject else place)


def info(code: str, subject: str = "", /, **values: FindingValue) -> Finding:
    """Return a finding that needs no action."""
    return Finding(code, "info", subject, values)


def warning(code: str, subject: str = "", /, **values: FindingValue) -> Finding:
    """Return a finding that the user should act upon."""
    return Finding(code, "warning", subject, values)


def error(code: str, subject: str = "", /, **values: FindingValue) -> Finding:
    """Return a finding that says why a part has no result."""
    return Finding(code, "error", subject, values)


def log_findings(log: logging.Logger, findings: Iterable[Finding]) -> None:
    """Log what the user should act upon."""
    for finding in findings:
        if finding.severity != "info":
            log.warning("%s", finding)


def unique(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return each finding once, the most severe first, otherwise in their order."""
    order = {"error": 0, "warning": 1, "info": 2}
    return tuple(sorted(dict.fromkeys(findings), key=lambda finding: order[finding.severity]))
