"""One comparison of labcdp with a truth from outside."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """A value that is known from elsewhere, and labcdp's.

    Parameters
    ----------
    name : str
        What is compared.
    truth, found : float or None
        The value from outside and labcdp's; None if it could not be computed here.
    deviation, limit : float or None
        Their distance, and the largest that agrees; without a limit the distance is only stated.
    measure : str
        What deviation and limit are in, for example ``absolute``, ``relative`` or ``standard deviations``.
    source : str
        Where the truth comes from; if not computed, why.
    """

    name: str
    truth: float | None
    found: float | None
    deviation: float | None
    limit: float | None
    measure: str
    source: str

    @property
    def verdict(self) -> str:
        """Whether it agrees."""
        if self.found is None:
            return "not run"
        if self.limit is None or self.deviation is None:
            return "stated"
        return "agrees" if abs(self.deviation) <= self.limit else "deviates"


def absolute(name: str, truth: float, found: float, limit: float, source: str) -> Check:
    """Compare by the difference."""
    return Check(name, truth, found, found - truth, limit, "absolute", source)


def relative(name: str, truth: float, found: float, limit: float, source: str) -> Check:
    """Compare by the relative difference."""
    return Check(name, truth, found, found / truth - 1, limit, "relative", source)


def by_noise(name: str, truth: float, found: float, deviation: float, source: str, limit: float = 4.0) -> Check:
    """Compare by a difference in standard deviations."""
    return Check(name, truth, found, deviation, limit, "standard deviations", source)


def stated(name: str, found: float, measure: str, source: str) -> Check:
    """State a value that has no truth, such as a ratio of speeds."""
    return Check(name, None, found, None, None, measure, source)


def not_run(name: str, why: str) -> Check:
    """Say why there is no value."""
    return Check(name, None, None, None, None, "", why)
