"""Response of a camera that is not linear, from several exposures of a still scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, log, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..frame import Frame
from ..response import Response
from .observations import CameraState
from .response_groups import group_pixels, residual_rel
from .response_levels import LEVELS, Method, knots, level_of, opencv_curve

#: Fewest exposures: two of them say what a factor of the exposure does, the third tests it.
MIN_EXPOSURES = 3
#: Share of the DN between dark and saturation that has to be seen at two exposures.
MIN_COVERED_SHARE = 0.6
#: Deviation of the exposures from the curve from which there is no curve.
MAX_RESIDUAL_REL = 0.1
#: Pixels of the frames that are looked at, evenly over the image.
_MOST_PIXELS = 100_000
#: Share of the range above dark and below saturation where noise and clipping bend the curve.
_EDGE = 0.03
#: Fewest pixels at a level for the level to count as seen, and to judge whether the scene stood still.
_SEEN = 5
#: Levels of 8 bits between which a response is straight enough to be interpolated.
_NEAR = 5
#: Share of the DN from which noise is small beside the typical deviation of pixels that speaks of motion.
_BRIGHT_SHARE, _MOVED = 0.2, 0.25
#: Error of a curve within a factor e of the exposure, by simulated brackets; it grows with the square of ln f.
_WITHIN_REL = 0.01
#: Factor of neighbouring exposures that is worth a warning.
_WIDE_FACTOR = 3.0
#: Independent errors of a curve for each step of the exposure, and the most.
_PARTS, _MOST_ERRORS = 2, 16
_CONTRADICTION = (
    "the exposures differ from any one response by {:.0%}: did something move, or the camera change gain, white "
    "balance or tone by itself? switch that off and take the bracket again"
)


@dataclass(frozen=True)
class ResponseCurve:
    """Response by a bracket, without absolute scale: the meter gives it.

    Parameters
    ----------
    response : Response
        A table over the DN above dark; h = n at its first knot above 0.
    residual_rel : float
        Root mean square over the signals of how far the exposures are from the curve, noise averaged out.
    range_net_dn : (float, float)
        DN above dark that the bracket covers; beyond, the curve is a straight line.
    exposures_s : tuple of float
        Of the frames.
    method : {'debevec', 'robertson'}
        What computed it.
    warnings : tuple of str
        What the user should know.
    """

    response: Response
    residual_rel: float
    range_net_dn: tuple[float, float]
    exposures_s: tuple[float, ...]
    method: Method
    warnings: tuple[str, ...]

    def errors(self, net_dn: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Independent relative errors of h for one standard uncertainty each, shape (k, n), at DN of shape (n,).

        The curve is a chain of ratios from exposure to exposure, so its error grows link by link: each error is a ramp
        over its part of ln h, half a link, and constant outside. A link has the residual of the curve, and what a
        smooth curve may do within it: the exposures tell h at a factor f from any signal, not in between.
        """
        steps = np.diff(np.log(self.exposures_s))
        link_rel = float(np.hypot(self.residual_rel, _WITHIN_REL * np.median(steps) ** 2))
        low, high = (log(float(self.response.linearise(n))) for n in self.range_net_dn)
        n_links = max((high - low) / float(np.median(steps)), 1.0)
        edges = np.linspace(low, high, min(ceil(_PARTS * n_links), _MOST_ERRORS) + 1)
        at = np.log(self.response.linearise(np.clip(net_dn, *self.range_net_dn)))
        ramps: NDArray[np.float64] = np.clip((at - edges[:-1, None]) / np.diff(edges)[:, None], 0, 1)
        return link_rel * sqrt(n_links / ramps.shape[0]) * ramps


def response_from_bracket(frames: Sequence[Frame], dark_dn: float, method: Method = "debevec") -> ResponseCurve:
    """Response of a camera from frames of one still scene at several exposures.

    With OpenCV: P. E. Debevec and J. Malik, "Recovering high dynamic range radiance maps from photographs",
    SIGGRAPH 1997; M. A. Robertson, S. Borman and R. L. Stevenson, "Estimation-theoretic approach to dynamic range
    enhancement using multiple exposures", J. Electron. Imaging 12 (2003) 219. Both know of 256 levels, which here are
    equal ratios of DN above dark. OpenCV takes single pixels, whose noise bends the curve, most of all towards dark
    and saturation: here pixels are averaged in groups of one brightness before. The curve is smoothed by parabolas
    over 11 levels, since a response has no teeth, and made to rise.

    Parameters
    ----------
    frames : sequence of Frame
        At three or more exposures, of one camera and setting; those of one exposure are averaged. The scene should
        have all luminances.
    dark_dn : float
        Mean DN of darkness, by dark frames.
    method : {'debevec', 'robertson'}
        Debevec: linear equations that ask for a smooth curve. Robertson: an iteration that does not, and so needs
        exposures that are not all powers of one factor.

    Raises
    ------
    CalibrationError
        If there are fewer than three exposures, cameras or settings differ, exposures do not overlap, the bracket
        covers less than `MIN_COVERED_SHARE` of the DN, or contradicts itself, or the method cannot do with it.
    """
    groups_of_frames = _by_exposure(frames)
    exposures_s = tuple(groups_of_frames)
    if method == "robertson":
        _require_uneven(exposures_s)
    step = 2 ** max(frames[0].bit_depth - 8, 0)
    every = max(frames[0].dn.size // _MOST_PIXELS, 1)
    pixels = np.stack([_mean_dn(group, every) for group in groups_of_frames.values()])
    # A mean of 7.5 belongs to level 8 as often as to level 7: both are rounded.
    levels = np.minimum((pixels + 0.5) // step, LEVELS - 1).astype(np.uint8)
    net_of_level = (np.arange(LEVELS) + 0.5) * step - 0.5 - dark_dn
    inside = _inside(net_of_level, frames[0].saturation_dn - dark_dn, step)
    covered = _covered(levels, inside)
    share = covered.size / max(inside.size, 1)
    if share < MIN_COVERED_SHARE:
        raise CalibrationError(
            f"the bracket shows {share:.0%} of the DN between dark and saturation at two exposures, a curve needs "
            f"{MIN_COVERED_SHARE:.0%}: take more exposures, or a scene with more luminances"
        )
    covered_dn = (float(net_of_level[covered[0]]), float(net_of_level[covered[-1]]))
    groups = group_pixels(pixels) - dark_dn
    net_dn, curve = knots(opencv_curve(level_of(groups, covered_dn), exposures_s, method), covered_dn)
    response = Response("table", (0.0, *net_dn.tolist()), (0.0, *(curve / curve[0] * net_dn[0]).tolist()))
    _require_still(pixels - dark_dn, exposures_s, response, covered_dn)
    residual = residual_rel(groups, exposures_s, response, covered_dn)
    if residual > MAX_RESIDUAL_REL:
        raise CalibrationError(_CONTRADICTION.format(residual))
    warnings = []
    factor = max(b / a for a, b in pairwise(exposures_s))
    if factor > _WIDE_FACTOR:
        warnings.append(
            f"exposures of the bracket are up to a factor of {factor:.2g} apart, within which the response rests on "
            "its smoothness: take exposures a factor of 1.5 to 2.5 apart"
        )
    if share < 0.9:
        warnings.append(
            f"the bracket shows {share:.0%} of the DN between dark and saturation; the rest is interpolated"
        )
    if residual > 0.02:
        warnings.append(f"the exposures differ from the curve by {residual:.1%}: expect that of luminances too")
    return ResponseCurve(response, residual, covered_dn, exposures_s, method, tuple(warnings))


def _by_exposure(frames: Sequence[Frame]) -> dict[float, list[Frame]]:
    """Frames by exposure, the shortest first."""
    groups: dict[float, list[Frame]] = {}
    for frame in sorted(frames, key=lambda frame: frame.exposure_s):
        groups.setdefault(frame.exposure_s, []).append(frame)
    if len(groups) < MIN_EXPOSURES:
        raise CalibrationError(
            f"there are {len(frames)} frames at {len(groups)} exposures: give frames at {MIN_EXPOSURES} or more "
            "exposures"
        )
    state = CameraState.of(frames[0])
    for frame in frames[1:]:
        state.require(CameraState.of(frame), "the first frame", f"frame {frame.frame_id}")
    return groups


def _mean_dn(frames: Sequence[Frame], every: int) -> NDArray[np.float64]:
    """Mean over frames of every so-many-th pixel."""
    total = np.zeros(frames[0].dn.ravel()[::every].size)
    for frame in frames:
        total += frame.dn.ravel()[::every]
    return total / len(frames)


def _require_uneven(exposures_s: Sequence[float]) -> None:
    """Refuse exposures that are all powers of one factor.

    From h(f x) = f h(x) alone, h is known up to any function that repeats from factor to factor.
    """
    steps = np.diff(np.log(exposures_s))
    in_units = steps / steps.min()
    if np.abs(in_units - np.round(in_units)).max() < 0.05:
        raise CalibrationError(
            f"all exposures are powers of a factor of {np.exp(steps.min()):.3g}, from which Robertson's method cannot "
            "tell the response: use the method debevec, or take exposures with uneven factors, such as 1.5, 2 and 2.7"
        )


def _inside(net_of_level: NDArray[np.float64], full_dn: float, step: int) -> NDArray[np.intp]:
    """Levels between which the curve is looked for."""
    edge = max(_EDGE * full_dn, 2.0 * step)
    inside: NDArray[np.intp] = np.flatnonzero((net_of_level >= edge) & (net_of_level <= full_dn - edge))
    return inside


def _covered(levels: NDArray[np.uint8], inside: NDArray[np.intp]) -> NDArray[np.intp]:
    """Levels of `inside` that pixels show which are inside at the neighbouring exposure too."""
    low, high = (int(inside[0]), int(inside[-1])) if inside.size else (1, 0)
    counts = np.zeros(LEVELS, dtype=np.int64)
    for shorter, longer in pairwise(levels):
        both = (shorter >= low) & (longer <= high)
        if not both.any():
            raise CalibrationError(
                "two neighbouring exposures share no pixel that is neither dark nor saturated: take exposures in "
                "between, a factor of 2 to 4 apart"
            )
        for image in (shorter, longer):
            counts += np.bincount(image[both], minlength=LEVELS)
    seen = np.flatnonzero(counts >= _SEEN)
    if not seen.size:
        return inside[:0]
    # Between seen levels that are close the curve is as good as at them.
    away = np.abs(inside[:, None] - seen[None, :]).min(axis=1)
    near = inside[away <= _NEAR]
    covered: NDArray[np.intp] = near[(near >= seen[0]) & (near <= seen[-1])]
    return covered


def _require_still(
    net_dn: NDArray[np.float64], exposures_s: Sequence[float], response: Response, limits: tuple[float, float]
) -> None:
    """Refuse pixels that contradict each other; in the means over groups it would not show."""
    # Where noise is small.
    low, high = max(limits[0], _BRIGHT_SHARE * limits[1]), limits[1]
    for (a, shorter_s), (b, longer_s) in pairwise(zip(net_dn, exposures_s, strict=True)):
        both = (a >= low) & (b <= high)
        if np.count_nonzero(both) < _SEEN:
            continue
        ratio = response.linearise(b[both]) / response.linearise(a[both]) * shorter_s / longer_s
        typical = float(np.median(np.abs(np.log(ratio))))
        if typical > _MOVED:
            raise CalibrationError(_CONTRADICTION.format(typical))
