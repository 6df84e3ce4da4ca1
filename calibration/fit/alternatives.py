"""Alternative explanations of residuals: glare, wrong dark signal, exposure times, drift, place."""

from __future__ import annotations

from math import sqrt

import numpy as np

from .design import Array
from .problem import Solution

#: Decrease of chi^2 required of a further parameter.
WORTH = 6.6
#: Patches in excess of the parameters required for a test of positions.
_SPARE_PATCHES = 2
#: Readings within this many hours cannot show a drift.
_MIN_HOURS = 1 / 60


def ratio(found: tuple[float, float]) -> float:
    """Size of a value in standard uncertainties, from `Solution.shift`."""
    value, uncertainty = found
    return abs(value) / uncertainty


def strongest_alternative(solution: Solution) -> tuple[str, float] | None:
    """Find the best alternative explanation of the residuals, and its standardised value.

    Considered are a veil of glare, a wrong dark, each exposure time, a drift, and smooth changes over the image. Each
    parameter beyond the first costs `WORTH`.
    """
    candidates = [("a veil of glare", np.ones_like(solution.luminance)), ("a wrong dark", solution.slope)]
    if solution.design.exposures_s.size > 1:
        for number, exposure_s in enumerate(solution.design.exposures_s):
            pattern = np.where(solution.design.exposure == number, solution.luminance, 0.0)
            candidates.append((f"a wrong exposure time at {exposure_s:g} s", pattern))
    times = drift_pattern(solution)
    if times is not None:
        candidates.append(("a drift", times))
    found = [(name, ratio(solution.shift(pattern))) for name, pattern in candidates]
    found.append(("the place in the image", worth_of_place(solution)))
    strongest = max(found, key=lambda row: row[1])
    return strongest if strongest[1] > 0 else None


def drift_pattern(solution: Solution) -> Array | None:
    """Deviations by a light that changes by 1 per hour; None if the readings are (nearly) simultaneous."""
    design = solution.design
    hours = np.array([(time - design.read_at[0]).total_seconds() / 3600 for time in design.read_at])
    if np.ptp(hours) < _MIN_HOURS:
        return None
    pattern: Array = (hours - hours.mean())[design.patch] * solution.luminance
    return pattern


def by_place(solution: Solution) -> tuple[float, int, Array]:
    """Explain residuals by r^2, x and y; only by r^2 for few patches.

    Returns the decrease of chi^2, the number of patterns used, and the relative deviation of each patch, shape (P,).
    """
    design = solution.design
    spare = len(design.patches) - solution.candidate.n_parameters - _SPARE_PATCHES
    place = design.place[:, : 3 if spare >= 3 else 1 if spare >= 1 else 0]
    patterns = place[design.patch] * solution.luminance[:, None]
    seen, whole = patterns.T @ solution.left @ patterns, patterns.T @ solution.weight @ patterns
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    values, vectors = np.linalg.eigh(seen / np.outer(scale, scale))
    # Patterns collinear at these patches, or with the response, are dropped.
    vectors = vectors[:, values > 1e-6] / scale[:, None]
    pull = vectors.T @ (patterns.T @ solution.left @ solution.residual)
    explained = pull / values[values > 1e-6]
    deviation: Array = place @ (vectors @ explained)
    return float(pull @ explained), pull.size, deviation


def worth_of_place(solution: Solution) -> float:
    """Standardised value of the places' deviations, comparable with that of a single parameter."""
    drop, n, _ = by_place(solution)
    return sqrt(max(drop - WORTH * (n - 1), 0.0))
