"""Response of a non-linear camera, from several exposures of a still scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, log, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.dn import Response
from ...core.errors import CalibrationError
from ...core.frame import Frame
from ...core.result import Finding, warning
from ..frames.observations import CameraState

#: Fewest exposures: two determine the effect of a factor of exposure, the third tests it.
MIN_EXPOSURES = 3
#: Share of the DN range that must be covered by two exposures.
MIN_COVERED_SHARE = 0.6
#: Largest deviation of the exposures from the curve.
MAX_RESIDUAL_REL = 0.1
#: Number of sampled pixels, on a grid over the image.
_MOST_PIXELS = 100_000
#: Share of the range above dark and below saturation where noise and clipping bend the curve.
_EDGE = 0.03
#: Fewest pixels of a covered level, and for detecting motion.
_SEEN = 5
#: Levels of the DN range, and number of them between which a response is straight enough to be interpolated.
_LEVELS, _NEAR = 256, 5
#: Share of the DN range above which noise is small compared with deviations by motion.
_BRIGHT_SHARE, _MOVED = 0.2, 0.25
#: Root mean square error of a curve within a link of a factor e, at both ends of ln h; it grows with the square of
#: ln f. By simulated brackets of cameras with gamma 1.8 and 2.2 and factors of 1.5 to 4.
_WITHIN_REL = (0.005, 0.001)
#: Factor of neighbouring exposures that causes a warning.
_WIDE_FACTOR = 3.0
#: Independent errors of a curve for each step of the exposure, and the most.
_PARTS, _MOST_ERRORS = 2, 16
_CONTRADICTION = (
    "the exposures differ from any one response by {:.0%}: something moved, or the camera changed gain, white "
    "balance or tone automatically; switch this off and repeat the bracket"
)
_Array = NDArray[np.floating[Any]]
#: Most groups, as the cost of Debevec's equations grows with the cube; and fewest pixels of one.
_MOST_GROUPS, _LEAST_PIXELS = 300, 10
#: Brightness range relative to neighbouring groups above which a group mixes two areas of the scene.
_MIXED, _NEIGHBOURS = 4.0, 21
#: Parts of the range, of equal ratio, that the residual is averaged over, and of how many that of each is the mean.
_CELLS, _NEAR_CELLS = 24, 9
#: Number of knots, in equal ratios of DN above dark, and weight of the curve's second differences.
_KNOTS, _SMOOTHNESS = 48, 1.0
#: Weight at the ends of the range, of that in its middle.
_LEAST_WEIGHT = 0.1


@dataclass(frozen=True)
class ResponseCurve:
    """Response by a bracket, without absolute scale: the meter gives it.

    Parameters
    ----------
    response : Response
        A table over the DN above dark; h = n at its first knot above 0.
    residual_rel : float
        Root mean square deviation of the exposures from the curve over the signals, noise averaged out.
    residuals_rel : tuple of float
        The same in each part of `range_net_dn`, of equal ratios.
    range_net_dn : (float, float)
        DN above dark that the bracket covers; beyond, the curve is a straight line.
    exposures_s : tuple of float
        Of the frames.
    findings : tuple of Finding
        Findings for the user.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> from labcdp.calibration import response_from_bracket
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> frame, signal = session.load(session.frames("light")[0]), np.geomspace(20, 40_000, 240_000).reshape(400, 600)
    >>> times = 1.0, 0.5, 0.25, 0.125
    >>> bracket = [
    ...     replace(frame, dn=np.clip(64 + signal * t, 0, 4095).round().astype(np.uint16), exposure_s=t) for t in times
    ... ]
    >>> response_from_bracket(bracket, dark_dn=64.0).exposures_s
    (0.125, 0.25, 0.5, 1.0)
    """

    response: Response
    residual_rel: float
    residuals_rel: tuple[float, ...]
    range_net_dn: tuple[float, float]
    exposures_s: tuple[float, ...]
    findings: tuple[Finding, ...]

    def errors(self, net_dn: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Independent relative errors of h for one standard uncertainty each, shape (k, n), at DN of shape (n,).

        The curve is a chain of ratios from exposure to exposure: the residuals, largest near dark, add up along the
        chain, as a ramp over each half link of ln h, constant outside. Within a link h is only smooth: the exposures
        determine it at a factor f from any signal, but not in between. Such an error is alike in all links, waves over
        ln h of the periods ln f and half of it, and does not add up.
        """
        step = float(np.median(np.diff(np.log(self.exposures_s))))
        low, high = (log(float(self.response.linearise(n))) for n in self.range_net_dn)
        n_links = max((high - low) / step, 1.0)
        edges = np.linspace(low, high, min(ceil(_PARTS * n_links), _MOST_ERRORS) + 1)
        at = np.log(self.response.linearise(np.clip(net_dn, *self.range_net_dn)))
        ramps = np.clip((at - edges[:-1, None]) / np.diff(edges)[:, None], 0, 1)
        cells = np.geomspace(*self.range_net_dn, 2 * len(self.residuals_rel) + 1)[1::2]
        middles = np.log(self.response.linearise(cells))
        residual = np.interp((edges[:-1] + edges[1:]) / 2, middles, self.residuals_rel)
        phase = 2 * pi * np.multiply.outer([1, 2], (at - low) / step)
        within = np.interp(at, [low, high], _WITHIN_REL) * step**2 / sqrt(len(phase))
        waves = within * np.concatenate([np.cos(phase), np.sin(phase)])
        return np.concatenate([residual[:, None] * sqrt(n_links / len(ramps)) * ramps, waves])


def response_from_bracket(frames: Sequence[Frame], dark_dn: float) -> ResponseCurve:
    """Response of a camera from frames of one still scene at several exposures.

    Pixels are first averaged in groups of equal brightness, as noise of single pixels would bias the curve, mostly near
    dark and saturation; then the equations of Debevec and Malik are solved for the groups.

    Parameters
    ----------
    frames : sequence of Frame
        At three or more exposures, of one camera and setting; those of one exposure are averaged. The scene should
        have all luminances.
    dark_dn : float
        Mean DN of dark signal, by dark frames.

    Raises
    ------
    CalibrationError
        If there are fewer than three exposures, cameras or settings differ, exposures do not overlap, the bracket
        covers less than `MIN_COVERED_SHARE` of the DN, or is inconsistent.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> from labcdp.calibration import response_from_bracket
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> frame, signal = session.load(session.frames("light")[0]), np.geomspace(20, 40_000, 240_000).reshape(400, 600)
    >>> noise = np.random.default_rng(1).normal(0, 2, (4, *signal.shape))
    >>> dn = [np.clip(64 + signal * t + n, 0, 4095).astype(np.uint16) for t, n in zip((1, 0.5, 0.25, 0.125), noise)]
    >>> bracket = [replace(frame, dn=image, exposure_s=t) for t, image in zip((1, 0.5, 0.25, 0.125), dn)]
    >>> curve = response_from_bracket(bracket, dark_dn=64.0)
    >>> curve.residual_rel < 0.01
    True
    """
    groups_of_frames = _by_exposure(frames)
    exposures_s = tuple(groups_of_frames)
    if CameraState.of(frames[0]).has_hand_overs:
        raise CalibrationError(
            "the response of a bracket is for cameras of one capture and up to 16 bits: leave it out, the fit of the "
            "patches finds what the curve of the codes leaves"
        )
    every = max(frames[0].dn.size // _MOST_PIXELS, 1)
    sampled = [[frame.dn.ravel()[::every] for frame in group] for group in groups_of_frames.values()]
    net_dn = np.stack([np.mean(group, axis=0) for group in sampled]) - dark_dn
    limits, share = _covered(net_dn, frames[0].saturation_dn - dark_dn, 2.0 ** max(frames[0].bit_depth - 8, 0))
    if share < MIN_COVERED_SHARE:
        raise CalibrationError(
            f"the bracket shows {share:.0%} of the DN between dark and saturation at two exposures, a curve needs "
            f"{MIN_COVERED_SHARE:.0%}: take more exposures, or a scene with more luminances"
        )
    groups = _groups(net_dn)
    knots, curve = _debevec(groups, exposures_s, limits)
    response = Response("table", (0.0, *knots.tolist()), (0.0, *curve.tolist()))
    _require_still(net_dn, exposures_s, response, limits)
    residual, residuals = _residuals_rel(groups, exposures_s, response, limits)
    if residual > MAX_RESIDUAL_REL:
        raise CalibrationError(_CONTRADICTION.format(residual))
    findings = []
    factor = max(b / a for a, b in pairwise(exposures_s))
    if factor > _WIDE_FACTOR:
        findings.append(warning("bracket-wide", factor=factor))
    if share < 0.9:
        findings.append(warning("bracket-partial", share=share))
    if residual > 0.02:
        findings.append(warning("bracket-residual", residual_rel=float(residual)))
    return ResponseCurve(response, residual, residuals, limits, exposures_s, tuple(findings))


def _by_exposure(frames: Sequence[Frame]) -> dict[float, list[Frame]]:
    """Frames by exposure, the shortest first."""
    groups: dict[float, list[Frame]] = {}
    for frame in sorted(frames, key=lambda frame: frame.exposure_s):
        groups.setdefault(frame.exposure_s, []).append(frame)
    if len(groups) < MIN_EXPOSURES:
        given = f"{len(frames)} frames at {len(groups)} exposures"
        raise CalibrationError(f"there are {given}: give frames at {MIN_EXPOSURES} or more exposures")
    state = CameraState.of(frames[0])
    for frame in frames[1:]:
        state.require(CameraState.of(frame), "the first frame", f"frame {frame.frame_id}")
    return groups


def _covered(net_dn: NDArray[np.float64], full_dn: float, step_dn: float) -> tuple[tuple[float, float], float]:
    """Limits of the DN seen at two neighbouring exposures, away from dark and saturation, and their share of all DN."""
    from scipy.ndimage import binary_dilation

    edge = max(_EDGE * full_dn, 2 * step_dn)
    seen = []
    for shorter, longer in pairwise(net_dn):
        both = (shorter >= edge) & (longer <= full_dn - edge)
        if not both.any():
            raise CalibrationError(
                "two neighbouring exposures share no pixel that is neither dark nor saturated: take exposures in "
                "between, a factor of 2 to 4 apart"
            )
        seen += [shorter[both], longer[both]]
    counts, edges = np.histogram(np.concatenate(seen), _LEVELS, (edge, full_dn - edge))
    levels = np.flatnonzero(counts >= _SEEN)
    if not levels.size:
        return (edge, full_dn - edge), 0.0
    first, last = int(levels[0]), int(levels[-1])
    # Between close covered levels the curve is interpolated.
    covered = binary_dilation(counts >= _SEEN, iterations=_NEAR)[first : last + 1]
    return (float(edges[first]), float(edges[last + 1])), np.count_nonzero(covered) / _LEVELS


def _deviations(
    net_dn: _Array, exposures_s: Sequence[float], response: Response, limits: tuple[float, float]
) -> Iterator[tuple[_Array, _Array]]:
    """Signals within limits at the longer of two neighbouring exposures, and ln of their h over what is expected."""
    for (a, shorter_s), (b, longer_s) in pairwise(zip(net_dn, exposures_s, strict=True)):
        both = (a >= limits[0]) & (b <= limits[1])
        yield b[both], np.log(response.linearise(b[both]) / response.linearise(a[both]) * shorter_s / longer_s)


def _require_still(
    net_dn: _Array, exposures_s: Sequence[float], response: Response, limits: tuple[float, float]
) -> None:
    """Refuse inconsistent pixels, which the means over groups would hide."""
    where_noise_is_small = max(limits[0], _BRIGHT_SHARE * limits[1]), limits[1]
    for _, deviation in _deviations(net_dn, exposures_s, response, where_noise_is_small):
        if deviation.size >= _SEEN and (typical := float(np.median(np.abs(deviation)))) > _MOVED:
            raise CalibrationError(_CONTRADICTION.format(typical))


def _groups(dn: _Array) -> _Array:
    """Average pixels of about one brightness: mean DN, shape (exposures, groups), to reduce the bias by noise.

    Groups much less uniform than those of neighbouring brightness are left out: they mix areas of the scene, and their
    mean does not follow the response.
    """
    from scipy.ndimage import median_filter

    brightness = dn.sum(axis=0)
    order = np.argsort(brightness, kind="stable")
    members = np.array_split(order, min(_MOST_GROUPS, max(order.size // _LEAST_PIXELS, 1)))
    spans = np.array([brightness[m[-1]] - brightness[m[0]] for m in members])
    even = spans <= _MIXED * np.maximum(median_filter(spans, _NEIGHBOURS, mode="nearest"), 1.0)
    return np.array([dn[:, m].mean(axis=1) for m, keep in zip(members, even, strict=True) if keep]).T


def _residuals_rel(
    net_dn: _Array, exposures_s: Sequence[float], response: Response, limits: tuple[float, float]
) -> tuple[float, tuple[float, ...]]:
    """Root mean square deviation of neighbouring exposures from the response within the limits: in all, and by part."""
    from scipy.ndimage import uniform_filter1d

    squares, seen = np.zeros(_CELLS), np.zeros(_CELLS)
    for longer, deviation in _deviations(net_dn, exposures_s, response, limits):
        cell = np.minimum(_CELLS * np.log(longer / limits[0]) / log(limits[1] / limits[0]), _CELLS - 1).astype(int)
        number = np.bincount(cell, minlength=_CELLS)
        squares += (np.bincount(cell, deviation, _CELLS) / np.maximum(number, 1)) ** 2
        seen += number > 0
    if not seen.any():
        raise CalibrationError("no brightness is seen at two exposures: take exposures in between, a factor of 2 to 4")
    known = np.flatnonzero(seen)
    local = uniform_filter1d(np.interp(np.arange(_CELLS), known, squares[known] / seen[known]), _NEAR_CELLS)
    return sqrt(squares.sum() / seen.sum()), tuple(np.sqrt(local).tolist())


def _debevec(net_dn: _Array, exposures_s: Sequence[float], limits: tuple[float, float]) -> tuple[_Array, _Array]:
    """Knots between the limits, and h there, rising, with h = n at the first: the least squares of ln h = ln E + ln t.

    Equations, hat-shaped weights and second differences are those of P. E. Debevec and J. Malik, "Recovering high
    dynamic range radiance maps from photographs", SIGGRAPH 1997; h is linear in logarithms between knots, in which
    second differences of a power law are 0, so that smoothing does not bend a gamma curve.
    """
    low, high = np.log(limits)
    inside = (net_dn >= limits[0]) & (net_dn <= limits[1])
    inside &= np.count_nonzero(inside, axis=0) > 1
    i, j = np.nonzero(inside)
    groups, j = np.unique(j, return_inverse=True)
    knot = (np.log(net_dn[inside]) - low) / (high - low) * (_KNOTS - 1)
    left = np.minimum(knot.astype(int), _KNOTS - 2)
    rows = np.arange(knot.size)
    design = np.zeros((knot.size + _KNOTS - 1, _KNOTS + groups.size))
    design[rows, left], design[rows, left + 1] = left + 1 - knot, knot - left
    design[rows, _KNOTS + j] = -1.0
    wanted = np.zeros(len(design))
    wanted[rows] = np.log(exposures_s)[i]
    weight = np.maximum(1 - np.abs(2 * knot / (_KNOTS - 1) - 1), _LEAST_WEIGHT)
    design[rows] *= weight[:, None]
    wanted[rows] *= weight
    design[knot.size : -1, :_KNOTS] = _SMOOTHNESS * np.diff(np.eye(_KNOTS), 2, axis=0)
    design[-1, _KNOTS // 2] = 1.0  # the scale is free
    curve = np.linalg.lstsq(design, wanted)[0][:_KNOTS]
    knots = np.exp(np.linspace(low, high, _KNOTS))
    rising = np.exp(np.maximum.accumulate(curve - curve[0])) * (1 + 1e-6 * np.arange(_KNOTS))
    return knots, knots[0] * rising
