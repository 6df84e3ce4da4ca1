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
from .causes import causes_of, false, right
from .world import World

#: Coverage that is asked for, and share of the failures in which a finding must name the right cause.
LOWEST, HIGHEST, NAMED = 0.93, 0.97, 0.9
#: Largest share of calibrations with a false cause, and largest U over the error where the right one is named instead
#: of an interval that holds. A normal error has 1.96 / 0.674 = 2.9 where U is right, and the median of n such ratios a
#: relative standard error of 1.17 / sqrt(n), by the density of the error at its median.
MOST_FALSE, MOST_OF_ERROR, MEDIAN_ERROR = 0.05, 3.0, 1.17
_COLUMNS = (
    *("world", "luminance", "contrast", "CDP", "U, error of L", "U, error of K", "U, error of CDP"),
    *("right cause", "right where wrong", "U / error of L, K, CDP where right", "false cause", "refused", "verdict"),
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
        Share of calibrations with a finding that names a right cause: of all, and of those in which an interval does
        not contain the truth, of the quantities whose intervals do not hold if there are some. None where no finding is
        expected, or nothing was wrong.
    wrong : int
        Calibrations in which such an interval does not contain the truth.
    of_error : dict of str to float
        Median of U over the size of the error, by quantity, of the calibrations with such a finding; empty without.
    false_cause : float
        Share of calibrations with a finding that names a cause which the world does not have.
    false_causes : dict of str to float
        The same for each code.
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
    of_error: dict[str, float]
    false_cause: float
    false_causes: dict[str, float]
    findings: dict[str, float]

    @property
    def verdict(self) -> str:
        """Whether coverage is 93 to 97 % within two standard errors; if not, whether a right cause is named instead.

        It is named if a finding is raised in 90 % of the calibrations in which an interval does not hold. What is wrong
        beside this is added, both within two standard errors: a false cause in more than 5 %, and U of more than three
        times the error where intervals do not hold but are named.
        """
        if not self.coverage:
            return "refused"
        n = self.calibrations - self.refused
        found = _outside(self.coverage, n)
        named = (self.named_where_wrong or 0.0) >= NAMED
        verdict = "too low" if "too low" in found.values() else "too wide" if found else "holds"
        words = ["named" if found and named else verdict]
        most = MOST_OF_ERROR * (1 + 2 * MEDIAN_ERROR / sqrt(max((self.named or 0.0) * n, 1)))
        if found and named and any(self.of_error[quantity] > most for quantity in found):
            words.append("U too wide")
        if self.false_cause > MOST_FALSE + 2 * binomial_error(MOST_FALSE, n):
            words.append("false cause")
        return ", ".join(words)


def _outside(coverage: dict[str, float], n: int) -> dict[str, str]:
    """Quantities whose coverage in n calibrations is wrong, beyond two standard errors, and how."""
    if not coverage:
        return {}
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
    return right(outcome.findings, world.causes)


def summarise(world: World, outcomes: Sequence[Outcome]) -> Summary:
    """Join the outcomes of a world."""
    done = [one for one in outcomes if not one.refused]
    coverage = {q: float(np.mean([one.inside[q] for one in done])) for q in QUANTITIES} if done else {}
    # What is wrong by chance in quantities that hold needs no name.
    judged = _outside(coverage, len(done)) or QUANTITIES
    wrong = [one for one in done if not all(one.inside[q] for q in judged)]
    named = [one for one in done if names_effect(world, one)]
    false_codes = [false(one.findings, world.causes) for one in done]
    return Summary(
        world=world.name,
        calibrations=len(outcomes),
        refused=len(outcomes) - len(done),
        reasons=dict(Counter(_reason(one.refused) for one in outcomes if one.refused).most_common()),
        coverage=coverage,
        coverage_error={q: binomial_error(share, len(done)) for q, share in coverage.items()},
        median_expanded={q: float(np.median([one.expanded[q] for one in done])) for q in coverage},
        median_error={q: float(np.median([abs(one.error[q]) for one in done])) for q in coverage},
        named=len(named) / len(done) if world.causes and done else None,
        named_where_wrong=float(np.mean([names_effect(world, one) for one in wrong]))
        if world.causes and wrong
        else None,
        wrong=len(wrong),
        of_error={q: _median_of_error(named, q) for q in coverage} if named else {},
        false_cause=float(np.mean([bool(codes) for codes in false_codes])) if done else 0.0,
        false_causes=_shares(false_codes),
        findings=_warnings(done),
    )


def _reason(message: str) -> str:
    """Return what is wrong, without the advice and without names and values of patches."""
    what = message if message.startswith("crash") else message.partition(": ")[0]
    return re.sub(r"\b\d+\.\d+\b", "..", re.sub(r"'P\d+'", "'P..'", what))


def _median_of_error(outcomes: Sequence[Outcome], quantity: str) -> float:
    """Median of U over the size of the error; an error of 0, as of a CDP of 0, is as small as a number can be."""
    ratios = [one.expanded[quantity] / max(abs(one.error[quantity]), 1e-12) for one in outcomes]
    return float(np.median(ratios))


def _warnings(outcomes: Sequence[Outcome]) -> dict[str, float]:
    return _shares([[code for severity, code in one.findings if severity != "info"] for one in outcomes])


def _shares(codes: Sequence[Sequence[str]]) -> dict[str, float]:
    """Share of calibrations with each code, the most frequent first."""
    counted = Counter(code for one in codes for code in dict.fromkeys(one))
    return {code: n / len(codes) for code, n in counted.most_common()}


def markdown(summaries: Sequence[Summary]) -> str:
    """Return the table, and below it refusals, what is warned of in the ideal world, and warnings without a cause."""
    lines = [
        f"| {' | '.join(_COLUMNS)} |",
        "|---" * len(_COLUMNS) + "|",
    ]
    for one in summaries:
        cells = [one.world]
        cells += [_coverage(one, q) for q in QUANTITIES]
        cells += [_sizes(one, q) for q in QUANTITIES]
        cells += [_percent(one.named), _percent(one.named_where_wrong)]
        cells += [", ".join(f"{one.of_error[q]:.2g}" for q in QUANTITIES if one.of_error), _false(one)]
        cells += [f"{one.refused} of {one.calibrations}", one.verdict]
        lines.append("| " + " | ".join(cells) + " |")
    lines += [f"\nRefused in {one.world!r}: {n} x {why}" for one in summaries for why, n in one.reasons.items()]
    for one in summaries[:1]:
        warned = ", ".join(f"`{code}` {share:.0%}" for code, share in one.findings.items()) or "none"
        lines.append(f"\nWarnings in {one.world!r}: {warned}.")
    silent = sorted({code for one in summaries for code in one.findings if not causes_of(code)})
    lines.append(f"\nWarnings that name no cause: {', '.join(f'`{code}`' for code in silent) or 'none'}.")
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


def _false(one: Summary) -> str:
    by_code = ", ".join(f"`{code}` {share:.0%}" for code, share in one.false_causes.items())
    return f"{one.false_cause:.0%}" + (f": {by_code}" if by_code else "")


def _percent(share: float | None) -> str:
    return "" if share is None else f"{share:.0%}"
