"""Checks of regions: saturation, an edge at the border, non-uniform light, outlier pixels, too few pixels."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.result import Finding, warning
from ..core.roi import Roi

_Array: TypeAlias = NDArray[np.float64]

#: Fewer pixels give intervals too wide to say much: the CDP of two such regions has a standard error up to 0.07.
_FEW_PIXELS = 100

#: Share of saturated or missing pixels from which a finding names them.
_SHARE = 0.001

#: Rings of pixels along the border that are held against the middle, and the most that may be an edge.
_RINGS = 6

#: A ring is on an edge if this part of its pixels is this many standard deviations off ...
_OFF_SHARE, _OFF_SIGMA = 0.02, 5.5
#: ... or its mean is off by this many standard deviations of pixels, and of means.
_MEAN_OFF, _MEAN_OFF_SIGMA = 0.5, 5.0

#: Blocks along each side of a region whose means show a trend.
_BLOCKS = 8

#: A trend is reported if it spans this part of the mean, varies by this part of the noise, and stands out of the
#: scatter of the blocks by this many of its standard deviations.
_TREND_REL, _TREND_TO_NOISE, _TREND_SIGMA = 0.02, 0.3, 6.0

#: Odd pixels are reported if they are this many standard deviations off and raise the variance by this part.
_ODD_SIGMA, _ODD_VARIANCE = 6.0, 0.1

#: Relative differences up to this are rounding errors.
_ROUNDING = 1e-9


def check_region(values: NDArray[Any], saturated: NDArray[np.bool_] | None, roi: Roi) -> tuple[Finding, ...]:
    """Find problems of a region that speak against using it.

    Parameters
    ----------
    values : ndarray of float or int, shape (height, width)
        The image, in any unit.
    saturated : ndarray of bool, shape (height, width), or None
        Pixels that are saturated; None where it is not known.
    roi : Roi
        The region.

    Returns
    -------
    tuple of Finding
        None if all is well.

    Raises
    ------
    InputError
        If the region lies outside the image or holds no pixel, or the shapes differ.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.core.roi import Roi
    >>> from labcdp.regions import check_region
    >>> check_region(np.full((30, 40), 100.0), None, Roi.rectangle("sky", 0, 0, 20, 20))
    ()
    """
    if values.ndim != 2 or (saturated is not None and saturated.shape != values.shape):
        shapes = values.shape if saturated is None else (values.shape, saturated.shape)
        raise InputError(f"a region is checked in a 2-D image and a mask of the same shape, got {shapes}")
    height, width = values.shape
    window, mask = roi.window((height, width)), roi.mask((height, width))
    pixels = values[window].astype(np.float64)
    findings: list[Finding] = []
    count = int(mask.sum())
    if count < _FEW_PIXELS:
        findings.append(warning("region-few-pixels", roi.name, pixels=count, recommended=_FEW_PIXELS))
    if saturated is not None:
        share = float(saturated[window][mask].mean())
        if share >= _SHARE:
            findings.append(warning("region-saturated", roi.name, share=share))
    valued = np.isfinite(pixels)
    if (missing := float(1 - valued[mask].mean())) >= _SHARE:
        findings.append(warning("region-missing-values", roi.name, share=missing))
    if (mask & valued).sum() >= _FEW_PIXELS / 4:
        findings += _uneven(pixels, mask & valued, mask, roi.name)
    return tuple(findings)


def _uneven(pixels: _Array, usable: NDArray[np.bool_], mask: NDArray[np.bool_], name: str) -> list[Finding]:
    findings = []
    depth = _depth(mask)
    margin = _edge_px(pixels, usable, depth)
    if margin:
        findings.append(warning("region-edge", name, margin_px=margin))
        usable = usable & (depth > margin)
    y, x = np.nonzero(usable)
    values = pixels[usable]
    if values.size < _FEW_PIXELS / 4:
        return findings
    trend = _trend(x, y, values)
    sigma = _noise(values - trend) + _ROUNDING * float(np.abs(values).max())
    span = float(np.ptp(np.percentile(trend, (1, 99))))
    level = abs(float(np.median(values)))
    if span > _TREND_REL * level and trend.std() > _TREND_TO_NOISE * sigma:
        if level:
            findings.append(warning("region-uneven", name, share=span / level))
        else:
            findings.append(warning("region-uneven-around-0", name, span=span))
    odd = np.abs(values - trend) > _ODD_SIGMA * sigma
    rest = values[~odd] - trend[~odd]
    if odd.any() and (values - trend).var() > (1 + _ODD_VARIANCE) * rest.var():
        findings.append(warning("region-odd-pixels", name, odd=int(odd.sum()), pixels=values.size, sigma=_ODD_SIGMA))
    return findings


def _depth(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return in which ring from the border each pixel is: 1 for the outermost, 0 outside."""
    import cv2

    padded = np.pad(mask, 1).astype(np.uint8)
    distance = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    return np.asarray(np.rint(distance), dtype=np.int64)


def _edge_px(pixels: _Array, usable: NDArray[np.bool_], depth: NDArray[np.int64]) -> int:
    """Return how many rings along the border are not like the middle."""
    rings = min(_RINGS, int(depth.max()) // 3)
    middle = usable & (depth > rings)
    if rings == 0 or middle.sum() < _FEW_PIXELS / 2:
        return 0
    y, x = np.nonzero(usable)
    inside, ring = middle[usable], depth[usable]
    values = pixels[usable]
    plane = _plane(x, y, inside, values)
    rest = values - plane
    sigma = _noise(rest[inside]) + _ROUNDING * float(np.abs(values).max())
    off_inside = float((np.abs(rest[inside]) > _OFF_SIGMA * sigma).mean())
    # Neighbouring pixels may be alike: the scatter of the middle's own rings says how much means may differ.
    deeper = [rest[ring == n].mean() for n in range(rings + 1, int(ring.max()) + 1) if (ring == n).sum() >= 8]
    scatter = float(np.std(deeper)) if len(deeper) > 2 else 0.0
    deepest = 0
    for n in np.intersect1d(ring, range(1, rings + 1)).tolist():
        ring_values = rest[ring == n]
        off = float((np.abs(ring_values) > _OFF_SIGMA * sigma).mean())
        most = max(_MEAN_OFF * sigma, _MEAN_OFF_SIGMA * max(scatter, sigma / np.sqrt(ring_values.size)))
        if off > _OFF_SHARE + 5 * off_inside or abs(float(ring_values.mean())) > most:
            deepest = n
    return deepest


def _plane(x: NDArray[np.int64], y: NDArray[np.int64], inside: NDArray[np.bool_], values: _Array) -> _Array:
    """Return the plane through the chosen pixels, at all pixels; odd ones among them do not tilt it."""
    chosen = values[inside]
    median, far = float(np.median(chosen)), _ODD_SIGMA * _noise(chosen)
    terms = _terms(_unit(x), _unit(y))[:, :3]
    coefficients = np.linalg.lstsq(terms[inside], np.clip(chosen, median - far, median + far), rcond=None)[0]
    return np.asarray(terms @ coefficients)


def _trend(x: NDArray[np.int64], y: NDArray[np.int64], values: _Array) -> _Array:
    """Return a smooth surface through the medians of blocks, at all pixels; their median where none stands out.

    Medians of blocks: a few odd pixels move none of them, and noise that is alike in neighbouring pixels shows in
    their scatter, against which the surface is held.
    """
    from scipy import ndimage

    u, v = _unit(x), _unit(y)
    column, row = (np.minimum(((w + 1) / 2 * _BLOCKS).astype(int), _BLOCKS - 1) for w in (u, v))
    block = column * _BLOCKS + row
    flat = np.full(values.size, np.median(values))
    blocks = np.flatnonzero(np.bincount(block) >= max(3, values.size / _BLOCKS**2 / 4))
    if blocks.size < 12:
        return flat
    medians = ndimage.median(values, block, blocks)
    terms = _terms(*(ndimage.mean(w, block, blocks) for w in (u, v)))
    coefficients = np.linalg.lstsq(terms, medians, rcond=None)[0]
    fitted = terms @ coefficients
    free = blocks.size - terms.shape[1]
    scatter = float(((medians - fitted) ** 2).sum() / free)
    explained = float(((fitted - medians.mean()) ** 2).sum() / (terms.shape[1] - 1))
    # F of the surface; its standard deviation is about 1 where there is none.
    if explained <= (1 + _TREND_SIGMA) * scatter:
        return flat
    return np.asarray(_terms(u, v) @ coefficients)


def _terms(u: _Array, v: _Array) -> _Array:
    return np.column_stack([np.ones(u.size), u, v, u * u, u * v, v * v])


def _unit(x: NDArray[np.int64]) -> _Array:
    """Return coordinates from -1 to 1."""
    low, high = float(x.min()), float(x.max())
    return np.asarray((2 * x - low - high) / max(high - low, 1.0))


def _noise(rest: _Array) -> float:
    """Return a standard deviation that a few odd pixels do not raise."""
    low, high = np.percentile(rest, (1, 99))
    clipped = float(np.clip(rest, low, high).std())
    mad = 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
    return max(clipped, mad)
