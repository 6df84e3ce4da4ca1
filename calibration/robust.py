"""One bad reading: found, named, and left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, inf, sqrt

import numpy as np

from ..errors import CalibrationError
from ..reading import Reading
from .alternatives import WORTH, ratio, strongest_alternative
from .chance import limit
from .design import Array, Design
from .findings import LeftOut
from .fit_tests import shift_with_scatter
from .gls import Solution, solve
from .readings import PatchReading, contradict, ratio_hint, single_reading
from .rungs import Rung

#: Part of the patches that may be left out, one at least: more bad ones than this are not the exception any more.
MAX_SHARE = 0.1
#: Fewest patches to tell a bad one: without it three are left.
_MIN_PATCHES = 4
#: Standard uncertainties within which a reading agrees with the camera.
_AGREES = 3.0


@dataclass(frozen=True, eq=False)
class Screened:
    """What is left after bad readings are taken out.

    Parameters
    ----------
    design : Design
        Without them.
    readings : dict of str to PatchReading
        Of the patches in the design.
    left_out : tuple of LeftOut
        What was taken out, with reasons that can serve as warnings.
    """

    design: Design
    readings: Mapping[str, PatchReading]
    left_out: tuple[LeftOut, ...]


def screen(
    design: Design,
    ladder: Sequence[Rung],
    joined: Mapping[str, PatchReading],
    readings: Mapping[str, Sequence[Reading]],
) -> Screened:
    """Find readings that contradict camera and other patches.

    Of two readings of one patch that contradict each other, the camera says which is wrong. A patch is bad if its
    deleted residual (against a fit without its reading) over its standard deviation is beyond the Bonferroni limit for
    all patches, and if nothing else explains the deviation better: another response, glare, a wrong dark or exposure
    time, a drift, or the patches' places in the image. At most one patch or `MAX_SHARE` of them is left out.

    Parameters
    ----------
    design : Design
        All usable patches.
    ladder : sequence of Rung
        Responses that may explain the data.
    joined : mapping of str to PatchReading
        The patches' readings.
    readings : mapping of str to sequence of Reading
        Each reading of them.
    """
    design, joined, left_out = _choose_of_two(design, ladder, dict(joined), readings)
    most = max(1, int(MAX_SHARE * len(design.patches)))
    for _ in range(most):
        if len(design.patches) < _MIN_PATCHES:
            break
        bad = _bad_patch(design, ladder)
        if bad is None:
            break
        patch, expected = bad
        name, shown = design.patches[patch], float(design.reading_cd_m2[patch])
        left_out.append(
            LeftOut(
                name,
                None,
                None,
                f"patch {name!r} reads {shown:.4g} cd/m^2, the camera by the other patches {expected:.4g} cd/m^2 "
                f"({shown / expected:.3g} times){ratio_hint(shown / expected)}",
            )
        )
        design = design.without(patch)
    return Screened(design, {name: joined[name] for name in design.patches}, tuple(left_out))


def _bad_patch(design: Design, ladder: Sequence[Rung]) -> tuple[int, float] | None:
    """Find the number of a bad patch, and its luminance by the others; None if there is none."""
    best: tuple[float, Solution, int] | None = None
    for rung in ladder:
        try:
            solution = solve(design, rung)
        except CalibrationError:
            continue
        drops = [ratio(solution.shift(pattern)) ** 2 for pattern in _patterns(design)]
        worst = int(np.argmax(drops))
        left = solution.chi_squared - drops[worst] + WORTH * (rung.n_parameters - 1)
        if best is None or left < best[0]:
            best = left, solution, worst
    if best is None:
        return None
    _, solution, patch = best
    value, uncertainty, freedom = shift_with_scatter(solution, _patterns(design)[patch])
    if uncertainty == inf or abs(value) <= limit(len(design.patches), freedom) * uncertainty:
        return None
    alternative = strongest_alternative(solution)
    if alternative is not None and alternative[1] >= ratio(solution.shift(_patterns(design)[patch])):
        return None
    expected = float(design.reading_cd_m2[patch] + value)
    return (patch, expected) if expected > 0 else None


def _choose_of_two(
    design: Design,
    ladder: Sequence[Rung],
    joined: dict[str, PatchReading],
    readings: Mapping[str, Sequence[Reading]],
) -> tuple[Design, dict[str, PatchReading], list[LeftOut]]:
    """Where a patch has two readings that contradict each other, keep the one the camera agrees with."""
    left_out: list[LeftOut] = []
    for patch, name in enumerate(design.patches):
        distinct = [k for k, r in enumerate(readings[name], start=1) if r not in readings[name][: k - 1]]
        pair = [readings[name][k - 1] for k in distinct]
        if len(pair) != 2 or not contradict(pair) or len(design.patches) < _MIN_PATCHES:
            continue
        solution = solve(design, ladder[0])
        value, uncertainty = solution.shift(_patterns(design)[patch])
        if uncertainty == inf:
            continue
        expected = float(design.reading_cd_m2[patch] + value)
        # What is left of the shift's variance when this patch's own reading is taken off is the camera's.
        by_camera = sqrt(max(uncertainty**2 - float(design.reading_variance[patch]), 0.0))
        off = [
            abs(r.luminance_cd_m2 - expected) / hypot(by_camera, r.standard_uncertainty_random_cd_m2, 1e-9 * expected)
            for r in pair
        ]
        right = int(np.argmin(off))
        if off[right] < _AGREES and off[1 - right] > limit(2 * len(design.patches)):
            before = len(joined[name].left_out)
            joined[name] = single_reading(joined[name], readings[name], distinct[right])
            left_out += joined[name].left_out[before:]
            design = design.with_reading(patch, joined[name])
    return design, joined, left_out


def _patterns(design: Design) -> list[Array]:
    """For each patch, what a reading too low by 1 cd/m^2 does to luminances less readings."""
    return [np.where(design.patch == patch, 1.0, 0.0) for patch in range(len(design.patches))]
