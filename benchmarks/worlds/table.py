"""What many calibrations of a world say together: coverage, findings, refusals; as numbers and as a table."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import sqrt
from typing import Any

import numpy as np

from .bench import QUANTITIES, Outcome
from .world import World

#: Coverage that is asked for, and share of the failures in which a finding must name the effect.
LOWEST, HIGHEST, NAMED = 0.93, 0.97, 0.9
_COLUMNS = (
    *("world", "luminance", "contrast", "CDP", "U, error of L", "U, error of K", "U, error of CDP"),
    *("named", "named where wrong", "refused", "verdict"),
)


@dataclass(frozen=True)
class Summary:
    """Result of a world.

    Parameters
    ----------
    world : str
        Its name.
    calibrations, refused : int
        How many were tried, and how many labcdp refused.
    reasons : dict of str to int
        Why, and how often.
    coverage, coverage_error : dict of str to float
        Share of 95 % intervals that contain the truth, by quantity, with its binomial standard error.
    median_expanded, median_error : dict of str to float
        Medians of the stated U and of the size of the actual error.
    named, named_where_wrong : float or None
        Share of calibrations with a finding that names the effect: of all, and of those in which an interval does not
        contain the truth, of the quantities whose intervals do not hold if there are some. None where no finding is
        expected, or nothing was wrong.
    wrong : int
        Calibrations in which such an interval does not contain the truth.
    findings : dict of str to float
        Share of calibrations with each warning or error.
    """

    world: str
    calibrations: int
    refused: int
    reasons: dict[str, int]
    coverage: dict[str, float]
    coverage_error: dict[str, float]
    median_expanded: dict[str, float]
    median_error: dict[str, float]
    named: float | None
    named_where_wrong: float | None
    wrong: int
    findings: dict[str, float]

    @property
    def verdict(self) -> str:
        """Whether coverage is 93 to 97 % within two standard errors; if not, whether the effect is named instead.

        It is named if a finding is raised in 90 % of the calibrations in which an interval does not hold.
        """
        if not self.coverage:
            return "refused"
        found = _outside(self.coverage, self.calibrations - self.refused).values()
        if not found:
            return "holds"
        if (self.named_where_wrong or 0.0) >= NAMED:
            return "named"
        return "too low" if "too low" in found else "too wide"


def _outside(coverage: dict[str, float], n: int) -> dict[str, str]:
    """Quantities whose coverage in n calibrations is wrong, beyond two standard errors, and how."""
    lowest, highest = LOWEST - 2 * binomial_error(LOWEST, n), HIGHEST + 2 * binomial_error(HIGHEST, n)
    return {
        quantity: "too low" if share < lowest else "too wide"
        for quantity, share in coverage.items()
        if not lowest <= share <= highest
    }


def binomial_error(share: float, n: int) -> float:
    """Return the standard deviation of a share of n."""
    return sqrt(share * (1 - share) / n)


def names_effect(world: World, outcome: Outcome) -> bool:
    """Whether a finding names what is special in this world."""
    return any(code.startswith(world.names) for _, code in outcome.findings) if world.names else False


def summarise(world: World, outcomes: Sequence[Outcome]) -> Summary:
    """Join the outcomes of a world."""
    done = [one for one in outcomes if not one.refused]
    coverage = {q: float(np.mean([one.inside[q] for one in done])) for q in QUANTITIES} if done else {}
    # What is wrong by chance in quantities that hold needs no name.
    judged = _outside(coverage, len(done)) or QUANTITIES
    wrong = [one for one in done if not all(one.inside[q] for q in judged)]
    return Summary(
        world=world.name,
        calibrations=len(outcomes),
        refused=len(outcomes) - len(done),
        reasons=dict(Counter(_reason(one.refused) for one in outcomes if one.refused).most_common()),
        coverage=coverage,
        coverage_error={q: binomial_error(share, len(done)) for q, share in coverage.items()},
        median_expanded={q: float(np.median([one.expanded[q] for one in done])) for q in coverage},
        median_error={q: float(np.median([abs(one.error[q]) for one in done])) for q in coverage},
        named=float(np.mean([names_effect(world, one) for one in done])) if world.names and done else None,
        named_where_wrong=float(np.mean([names_effect(world, one) for one in wrong]))
        if world.names and wrong
        else None,
        wrong=len(wrong),
        findings=_warnings(done),
    )


def _reason(message: str) -> str:
    """Return what is wrong, without the advice and without names of patches."""
    what = message if message.startswith("crash") else message.partition(": ")[0]
    return re.sub(r"'P\d+'", "'P..'", what)


def _warnings(outcomes: Sequence[Outcome]) -> dict[str, float]:
    codes = Counter(code for one in outcomes for severity, code in one.findings if severity != "info")
    return {code: n / len(outcomes) for code, n in codes.most_common()}


def markdown(summaries: Sequence[Summary]) -> str:
    """Return the table, and below it what was refused and what is warned of in the ideal world."""
    lines = [
        f"| {' | '.join(_COLUMNS)} |",
        "|---" * len(_COLUMNS) + "|",
    ]
    for one in summaries:
        cells = [one.world]
        cells += [_coverage(one, q) for q in QUANTITIES]
        cells += [_sizes(one, q) for q in QUANTITIES]
        cells += [_percent(one.named), _percent(one.named_where_wrong)]
        cells += [f"{one.refused} of {one.calibrations}", one.verdict]
        lines.append("| " + " | ".join(cells) + " |")
    lines += [f"\nRefused in {one.world!r}: {n} x {why}" for one in summaries for why, n in one.reasons.items()]
    for one in summaries[:1]:
        warned = ", ".join(f"`{code}` {share:.0%}" for code, share in one.findings.items()) or "none"
        lines.append(f"\nWarnings in {one.world!r}: {warned}.")
    return "\n".join(lines)


def as_json(summaries: Sequence[Summary]) -> list[dict[str, Any]]:
    """Return all numbers as values JSON can hold."""
    return [asdict(one) | {"verdict": one.verdict} for one in summaries]


def _coverage(one: Summary, quantity: str) -> str:
    if quantity not in one.coverage:
        return ""
    return f"{100 * one.coverage[quantity]:.1f} ± {100 * one.coverage_error[quantity]:.1f} %"


def _sizes(one: Summary, quantity: str) -> str:
    if quantity not in one.coverage:
        return ""
    return f"{100 * one.median_expanded[quantity]:.2g} %, {100 * one.median_error[quantity]:.2g} %"


def _percent(share: float | None) -> str:
    return "" if share is None else f"{share:.0%}"
