"""Whether a twin describes its camera, as findings."""

from __future__ import annotations

from collections.abc import Iterator
from math import comb

from ....calibration.fit.significance import critical_value
from ....core.finding import Finding, info, warning
from ..evaluate import TwinEvaluation
from ..signal import KINDS

#: Significance level of the number of differing pairs, and expected share of pairs that differ by chance.
_CHANCE, _EXPECTED = 0.01, 0.05


def verdict(evaluation: TwinEvaluation) -> Finding:
    """Return whether the twin describes the camera, by the CDPs and by the signals of the patches."""
    differing = evaluation.count("differ")
    n = differing + evaluation.count("agree")
    counts: dict[str, float] = {"decided": n, "differing": differing, "by_chance": _EXPECTED * n}
    chance = sum(comb(n, k) * _EXPECTED**k * (1 - _EXPECTED) ** (n - k) for k in range(differing, n + 1))
    if differing and chance < _CHANCE:
        return warning("twin-differs", **counts)
    if any(signal_findings(evaluation)):
        return warning("twin-signals-differ", **counts)
    return info("twin-describes-camera", **counts) if n else warning("twin-undecided", **counts)


def signal_findings(evaluation: TwinEvaluation) -> Iterator[Finding]:
    """Yield a warning for each kind of signal in which a patch deviates by more than by chance in 1 % of sessions."""
    limit = critical_value(len(KINDS) * len(evaluation.patches))
    for kind, name in KINDS.items():
        z = {patch.name: z for patch in evaluation.patches if (z := patch.z[kind]) is not None and abs(z) > limit}
        if z:
            worst = max(z, key=lambda patch: abs(z[patch]))
            yield warning("signal-differs", name, patches=list(z), worst=worst, z=z[worst])
