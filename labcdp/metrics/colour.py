"""Colours of two regions: Mahalanobis distance, CSP, and the share of pairs of pixels that keep their difference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import nan, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.disk.files import shown
from ..core.errors import InputError
from ..core.percent import plain_fraction
from ..core.quantity import Z_95, Interval, Quantity
from ..core.result import Finding, info, warning
from .arrays import light_array
from .correlation import region_inflation
from .detection import size_findings
from .uncertainty import confidence_interval, unbiased_variance

_Array = NDArray[np.float64]
#: Relative tolerance of distances, as rounding of float64 leaves it.
_ROUNDING = 1e-12
#: Determinant of a correlation matrix below which planes are taken to be dependent.
_DEPENDENT = 1e-12


@dataclass(frozen=True)
class ColourSeparation:
    """Separation of the colours of two regions.

    Parameters
    ----------
    distance : Quantity
        Mahalanobis distance of the means, by the pooled covariance.
    csp : Quantity
        Colour separation probability (CSP), share of pixels that are nearer to their own region than to the other if
        both are normal with the pooled covariance.
    csp_counted : Quantity
        The same share counted, each region with its own covariance; mean of both regions.
    csp_bound : float
        Least share by the Bhattacharyya bound of normal regions with covariances of their own.
    difference : ndarray of float, shape (planes,)
        Difference of chromaticity that the pairs of pixels are compared with.
    detected : Quantity
        Share of all pairs of pixels whose difference of chromaticity lies within `epsilon` of `difference`.
    epsilon : float
        Relative tolerance.
    findings : tuple of Finding
        What limits the values.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics import colour_separation
    >>> rng = np.random.default_rng(1)
    >>> red, green = rng.normal((60, 50, 50), 5, (900, 3)), rng.normal((50, 50, 50), 5, (900, 3))
    >>> separation = colour_separation(red, green)
    >>> round(separation.distance.value, 1), round(separation.csp.value, 2)
    (2.0, 0.84)
    """

    distance: Quantity
    csp: Quantity
    csp_counted: Quantity
    csp_bound: float
    difference: _Array
    detected: Quantity
    epsilon: float
    findings: tuple[Finding, ...] = ()


def colour_separation(
    first: ArrayLike,
    second: ArrayLike,
    epsilon: float | str = 0.5,
    *,
    difference: Sequence[float] | NDArray[np.floating] | None = None,
) -> ColourSeparation:
    """Separation of the colours of two regions, as a camera with several planes sees them.

    Parameters
    ----------
    first, second : array_like of float, shape (n, planes) or (height, width, planes)
        Pixels in linear light, or DN less the black level, one value for each plane: red, green and blue, or the
        planes of the cells of a colour filter. Two planes or more. Arrays of three dimensions are taken as parts of an
        image, whose noise may be correlated from pixel to pixel, others as independent pixels.
    epsilon : float or str
        Relative tolerance of the difference of chromaticity, above 0 and up to 1, or a percentage.
    difference : array_like of float, shape (planes,), or None
        Difference of chromaticity in the scene, of the first less the second region; None for that of the means.

    Returns
    -------
    ColourSeparation

    Raises
    ------
    InputError
        If the arrays do not have the same planes, two or more; a region has no more pixels than planes or a value that
        is not finite; or all pixels of both regions lie on one line or plane of the values, so that no noise tells
        them apart.

    Notes
    -----
    With Δ the difference of the means and S the pooled covariance of both regions, the distance is
    D = sqrt(Δᵀ S⁻¹ Δ) (P. C. Mahalanobis, On the generalised distance in statistics, 1936), and CSP = Φ(D / 2), the
    share of pixels on the right side of the linear discriminant of normal regions of equal size. A camera whose
    planes are multiplied by other factors has the same D.

    `csp_counted` counts the pixels whose squared distance by the covariance of their region, plus its ln det, is less
    than that by the other's (quadratic discriminant). A pixel is left out of mean and covariance of its own region
    when it is judged, as these would otherwise favour it. The bound is 1 - exp(-D_B) / 2 with the distance D_B of
    Bhattacharyya (K. Fukunaga, Introduction to Statistical Pattern Recognition, 1990, 3.4).

    Chromaticity is the share of each plane in the sum of all. A pair of pixels is detected if the difference of its
    chromaticities is no farther from that of the scene than `epsilon` times its length: a change of the hue counts as
    well as one of the size. Pairs with a pixel whose sum is not above 0 are not detected.

    u of the distance is that of its influence on each pixel, without an assumption about the distribution; that of
    `detected` is the one of CDP. Both are raised for correlated noise as `variance_inflation` says. The interval of the
    distance is that of D² less what noise adds to it, which matters where the colours hardly differ.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics import colour_separation
    >>> rng = np.random.default_rng(1)
    >>> sign, sky = rng.normal((90, 30, 30), 3, (30, 30, 3)), rng.normal((50, 50, 60), 3, (30, 30, 3))
    >>> separation = colour_separation(sign, sky, "50%")
    >>> separation.csp.value > 0.999, round(separation.detected.value, 2)
    (True, 1.0)
    """
    return separation(ColourRegion.of(first, "first"), ColourRegion.of(second, "second"), epsilon, difference)


def separation(
    first: ColourRegion,
    second: ColourRegion,
    epsilon: float | str,
    difference: Sequence[float] | NDArray[np.floating] | None = None,
) -> ColourSeparation:
    """Separate the colours of two regions, as `colour_separation`."""
    tolerance = plain_fraction(epsilon)
    if isinstance(tolerance, str | bool) or not 0 < tolerance <= 1:
        raise InputError(f"epsilon is {shown(epsilon)}: give a number above 0, up to 1")
    regions = first, second
    if first.pixels.shape[1] != second.pixels.shape[1]:
        planes = [region.pixels.shape[1] for region in regions]
        raise InputError(f"the regions have {planes[0]} and {planes[1]} planes: give the same planes of both")
    distance, csp = _distance(first, second)
    direction, detected = _detected_pairs(first, second, float(tolerance), difference)
    findings = [finding for region in regions if region.mask is not None for finding in region.size_findings]
    inflation = max(region.inflation for region in regions)
    if inflation > 1:
        findings.append(info("colours-correlated", inflation=inflation))
    if distance.interval.low == 0:
        findings.append(
            warning("colours-not-separated", f"{first.name} / {second.name}", highest=distance.interval.high)
        )
    return ColourSeparation(
        distance, csp, _counted_share(*regions), _bound(*regions), direction, detected, float(tolerance),
        tuple(findings),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ColourRegion:
    """Colours of the pixels of a region.

    Parameters
    ----------
    name : str
        Its name.
    pixels : ndarray of float, shape (n, planes)
        Values of its pixels, row by row.
    mask : ndarray of bool, shape (height, width), or None
        Where they are in the image; None for independent pixels.

    Raises
    ------
    InputError
        If there are fewer than two planes, too few pixels, or a value is not finite.
    """

    name: str
    pixels: _Array
    mask: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        n, planes = self.pixels.shape
        if planes < 2:
            raise InputError(f"region {self.name!r} has one plane only: a colour needs two or more")
        if not np.isfinite(self.pixels).all():
            raise InputError(f"region {self.name!r} has values that are not finite numbers: leave these pixels out")
        if n < planes + 2:
            raise InputError(f"region {self.name!r} has {n} pixels of {planes} planes: give at least {planes + 2}")

    @classmethod
    def of(cls, values: ArrayLike, name: str) -> ColourRegion:
        """Take all pixels of an array; raises InputError."""
        array = light_array(values, f"the {name} region")
        if array.ndim not in (2, 3):
            raise InputError(
                f"the {name} region has the shape {array.shape}: give (n, planes) or (height, width, planes)"
            )
        is_image = array.ndim == 3 and min(array.shape[:2]) > 1
        mask = np.ones(array.shape[:2], dtype=np.bool_) if is_image else None
        return cls(name, array.reshape(-1, array.shape[-1]), mask)

    @property
    def n(self) -> int:
        """Number of pixels."""
        return len(self.pixels)

    @property
    def size_findings(self) -> list[Finding]:
        """Findings about a region in which correlated noise cannot be told from chance."""
        return size_findings(self.name, self.n)

    @property
    def mean(self) -> _Array:
        """Mean of each plane."""
        mean: _Array = self.pixels.mean(axis=0)
        return mean

    @property
    def covariance(self) -> _Array:
        """Covariance of the planes, with n - 1."""
        covariance = np.cov(self.pixels, rowvar=False)
        return np.asarray(covariance, dtype=np.float64)

    @cached_property
    def inflation(self) -> float:
        """Largest factor by correlated noise of its planes."""
        return max(self.inflation_of(plane) for plane in self.pixels.T)

    def inflation_of(self, values: _Array) -> float:
        """Return the factor by which correlation raises the variance of the mean of a value for each pixel."""
        if self.mask is None:
            return 1.0
        image = np.zeros(self.mask.shape)
        image[self.mask] = values
        return region_inflation(image, self.mask)


def chromaticity(pixels: _Array) -> _Array:
    """Return the share of each plane in the sum of all, shape (n, planes); nan of pixels whose sum is not above 0."""
    sums = pixels.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(pixels, sums, out=np.full(pixels.shape, nan), where=sums > 0), dtype=np.float64)


def _inverse(covariance: _Array) -> _Array:
    scales = np.sqrt(np.diag(covariance))
    if not scales.all() or np.linalg.det(covariance / np.outer(scales, scales)) < _DEPENDENT:
        raise InputError(
            "the values of the planes have no noise of their own: pixels of a sensor scatter in each plane; use a "
            "picture that was not smoothed, or made grey"
        )
    return np.asarray(np.linalg.inv(covariance), dtype=np.float64)


def _pooled(first: ColourRegion, second: ColourRegion) -> _Array:
    total = (first.n - 1) * first.covariance + (second.n - 1) * second.covariance
    return np.asarray(total / (first.n + second.n - 2))


def _distance(first: ColourRegion, second: ColourRegion) -> tuple[Quantity, Quantity]:
    """Return Mahalanobis distance and CSP."""
    from scipy.special import ndtr

    planes, n = first.pixels.shape[1], first.n + second.n
    delta = first.mean - second.mean
    weights = _inverse(_pooled(first, second)) @ delta
    square = float(delta @ weights)
    variance, spread = 0.0, 0.0
    for region, sign in ((first, 1), (second, -1)):
        level = (region.pixels - region.mean) @ weights
        # Influence of a pixel on D² by the mean of its region, and by the covariance.
        influence = 2 * sign * level - region.n / n * (np.square(level) - square)
        variance += float(np.var(influence)) * region.inflation_of(influence) / region.n
        spread += region.inflation / region.n
    # Noise adds its share to D², whose scatter matters where the colours hardly differ.
    expected = max(square * (n - planes - 3) / (n - 2) - planes * spread, 0.0)
    half_width = Z_95 * sqrt(variance + 2 * planes * spread**2)
    ends = Interval(sqrt(max(expected - half_width, 0.0)), sqrt(max(square, expected + half_width)))
    distance = sqrt(square)
    u = (ends.high - ends.low) / (2 * Z_95)
    probabilities = [float(ndtr(x / 2)) for x in (distance, *ends)]
    csp_ends = Interval(probabilities[1], probabilities[2])
    csp = Quantity(probabilities[0], (csp_ends.high - csp_ends.low) / (2 * Z_95), ends=csp_ends)
    return Quantity(distance, u, ends=ends), csp


def _counted_share(first: ColourRegion, second: ColourRegion) -> Quantity:
    """Return the share of pixels that are nearer to their own region, each with its own covariance."""
    shares, variance = [], 0.0
    for region, other in ((first, second), (second, first)):
        right = _score_left_out(region) < _score(region.pixels, other)
        share = float(np.mean(right))
        shares.append(share)
        inflation = region.inflation_of(right.astype(np.float64)) if 0 < share < 1 else 1.0
        # How far the boundary follows the noise of the pixels, which is large where the colours hardly differ.
        with_itself = float(np.mean(_score(region.pixels, region) < _score(region.pixels, other)))
        variance += (share * (1 - share) / (region.n - 1) * inflation + (with_itself - share) ** 2) / 4
    value = sum(shares) / 2
    smaller = float(min(first.n, second.n)) / max(first.inflation, second.inflation)
    return Quantity(value, sqrt(variance), ends=confidence_interval(value, variance, max(smaller, 2.0)))


def _score(pixels: _Array, region: ColourRegion) -> _Array:
    """Squared distance from a region by its covariance, plus the ln det of that."""
    covariance = region.covariance
    inverse = _inverse(covariance)
    level = pixels - region.mean
    score: _Array = np.einsum("ni,ij,nj->n", level, inverse, level) + np.linalg.slogdet(covariance)[1]
    return score


def _score_left_out(region: ColourRegion) -> _Array:
    """Return the score of each pixel from its own region without it (rank-one update of mean and covariance)."""
    n, planes, covariance = region.n, region.pixels.shape[1], region.covariance
    level = region.pixels - region.mean
    square = np.einsum("ni,ij,nj->n", level, _inverse(covariance), level)
    # Never below 0, but for rounding.
    rest = np.maximum(1 - n * square / (n - 1) ** 2, _ROUNDING)
    left_out = square * (n / (n - 1)) ** 2 * (n - 2) / (n - 1) / rest
    log_det = np.linalg.slogdet(covariance)[1] + planes * np.log((n - 1) / (n - 2)) + np.log(rest)
    score: _Array = left_out + log_det
    return score


def _bound(first: ColourRegion, second: ColourRegion) -> float:
    """Return the least share of pixels that are nearer to their own region, by the Bhattacharyya distance."""
    covariances = first.covariance, second.covariance
    middle = (covariances[0] + covariances[1]) / 2
    delta = first.mean - second.mean
    log_dets = [float(np.linalg.slogdet(covariance)[1]) for covariance in (middle, *covariances)]
    distance = float(delta @ _inverse(middle) @ delta) / 8 + (log_dets[0] - (log_dets[1] + log_dets[2]) / 2) / 2
    return 1 - float(np.exp(-distance)) / 2


def _detected_pairs(
    first: ColourRegion, second: ColourRegion, epsilon: float, difference: Sequence[float] | NDArray[np.floating] | None
) -> tuple[_Array, Quantity]:
    """Return the difference of chromaticity in the scene, and the share of pairs of pixels within its tolerance."""
    means = [region.mean / region.mean.sum() if region.mean.sum() > 0 else region.mean * nan for region in
             (first, second)]  # fmt: skip
    direction = means[0] - means[1] if difference is None else np.asarray(difference, dtype=np.float64)
    if direction.shape != means[0].shape:
        raise InputError(
            f"difference has the shape {direction.shape}: give one value for each of {means[0].size} planes"
        )
    radius = epsilon * float(np.linalg.norm(direction)) * (1 + _ROUNDING)
    if not radius > 0:
        return direction, Quantity(nan, nan)
    shares = [
        _share_within(chromaticity(region.pixels), chromaticity(other.pixels), sign * direction, radius)
        for region, other, sign in ((first, second, 1), (second, first, -1))
    ]
    share = float(shares[0].mean())
    variance = unbiased_variance(share, shares[1], np.ones(second.n), shares[0], np.ones(first.n))
    smaller = float(min(first.n, second.n))
    if 0 < share < 1:
        # As for CDP, the shares are no more correlated than the pixels.
        most = max(first.inflation, second.inflation)
        parts = [float(np.var(values)) / values.size for values in shares]
        inflated = [
            part * region.inflation_of(values)
            for part, region, values in zip(parts, (first, second), shares, strict=True)
        ]
        variance *= max(min(most, sum(inflated) / sum(parts)), 1.0) if sum(parts) else 1.0
    return direction, Quantity(share, sqrt(variance), ends=confidence_interval(share, variance, smaller))


def _share_within(points: _Array, others: _Array, direction: _Array, radius: float) -> _Array:
    """Return for each point the share of others from which it lies in a direction, within a radius."""
    usable, defined = np.isfinite(points[:, 0]), others[np.isfinite(others[:, 0])]
    shares = np.zeros(len(points))
    if usable.any() and defined.size:
        shares[usable] = _counts_within(points[usable] - direction, defined, radius) / len(others)
    return shares


def _counts_within(centres: _Array, points: _Array, radius: float) -> _Array:
    """Return for each centre the number of points within a radius; all coordinates have the same sum."""
    planes = points.shape[1]
    if planes > 3:
        from scipy.spatial import KDTree

        return np.asarray(KDTree(points).query_ball_point(centres, radius, return_length=True), dtype=np.float64)
    from .colour_kernel import counts_within

    # Two coordinates of the plane that all of them lie in; with two planes, of a line.
    axes = np.array([[1.0, 0.0, -1.0], [-1.0, 2.0, -1.0]]) if planes == 3 else np.array([[1.0, -1.0], [0.0, 0.0]])
    axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1.0)
    flat, flat_centres = points @ axes.T, centres @ axes.T
    origin, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    columns = rows = max(int(sqrt(len(flat)) / 2), 1)
    cell = float(max(extent)) / columns * (1 + _ROUNDING) or 1.0
    index = np.minimum(((flat - origin) / cell).astype(np.int64), columns - 1)
    cells = index[:, 1] * columns + index[:, 0]
    order = np.argsort(cells, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(cells, minlength=rows * columns))])
    return counts_within(flat_centres, radius, np.ascontiguousarray(flat[order]), starts, origin, cell, columns)
