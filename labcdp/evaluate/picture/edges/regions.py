"""Regions of a contrast map: an image cut into superpixels, and the statistics of the pixels of each."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, sqrt
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ....core.luminance import Invalid, LuminanceMap
from ....metrics import Distribution
from ....regions.superpixels import inner, seen_half, superpixel_labels

Floats: TypeAlias = NDArray[np.float64]
Labels: TypeAlias = NDArray[np.int32]

#: Pixels this close to another region are left out: lens and pixel mix the light of both sides there.
_MARGIN_PX, _SMALL_MARGIN_PX = 2, 1

#: Superpixels below this size get the small margin.
_SMALL_SIZE_PX = 20

#: Share of the largest differences of a region that is left out, because the light may differ there, and the mean size
#: of the rest for noise of a standard deviation of 1, 2 (pdf(0) - pdf(z)) / (1 - share) with cdf(z) = 1 - share / 2.
_TRIMMED, _MEAN_OF_TRIMMED = 0.5, 0.32466

#: A step between regions is one of an object if it is at least this part of the difference of their means. Light that
#: changes steadily changes in both by at least this part; the outline of a faint object may run through one of them.
_LEAST_STEP, _LEAST_CHANGE = 0.25, 0.05


@dataclass(frozen=True, eq=False)
class MapRegions:
    """Superpixels of a luminance map, in pixels of the map.

    Parameters
    ----------
    size_px : int
        Side of a region, about.
    labels : ndarray of int32, shape (height, width)
        Region of each pixel, 0 to n - 1.
    n_pixels : ndarray of int64, shape (n,)
        Pixels of each region that are measured: away from its border, and not those that the borders were found with.
    mean, std : ndarray of float, shape (n,)
        Of these pixels, the latter with n - 1; nan where there are too few.
    noise : ndarray of float, shape (n,)
        Standard deviation of the noise of these pixels as neighbours along diagonals differ, which the light's own
        changes across the region hardly touch; too low for noise in which these are correlated. nan where there are
        too few.
    saturated_share, invalid_share : ndarray of float, shape (n,)
        Share of all pixels of the region that are saturated, and that are not valid for any reason.
    centre_px : ndarray of float, shape (n, 2)
        Middle (x, y) of all pixels of the region.
    values : ndarray of float64, shape (sum of n_pixels,)
        Measured pixels, region after region.
    middle_px, slope : ndarray of float, shape (n, 2)
        Middle (x, y) of the measured pixels, and how the light changes there from pixel to pixel along x and y, by
        least squares; nan where there are too few.
    """

    size_px: int
    labels: Labels
    n_pixels: NDArray[np.int64]
    mean: Floats
    std: Floats
    noise: Floats
    saturated_share: Floats
    invalid_share: Floats
    centre_px: Floats
    values: Floats
    middle_px: Floats
    slope: Floats

    def steady(self, sides: Labels, places_px: Floats) -> NDArray[np.bool_]:
        """Whether light changes within two regions as steadily as across their border at (x, y), as shading does.

        The bright and the dark region both change towards it, and leave no step there.
        """
        changes = (self.slope[sides] * (places_px - self.middle_px[sides])).sum(axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = changes * [[-1], [1]] / -np.diff(self.mean[sides], axis=0)
        return np.asarray((1 - parts.sum(axis=0) < _LEAST_STEP) & (parts.min(axis=0) > _LEAST_CHANGE))

    def distributions(self, wanted: Labels) -> dict[int, Distribution]:
        """Distributions of the measured pixels of some regions."""
        ends = np.cumsum(self.n_pixels)
        starts = ends - self.n_pixels
        return {label: Distribution.from_array(self.values[starts[label] : ends[label]]) for label in wanted.tolist()}


def map_regions(luminance: LuminanceMap, size_px: int, *others: LuminanceMap) -> list[MapRegions]:
    """Cut a luminance map into superpixels of about `size_px` squared pixels; measure each there and in other maps.

    Raises
    ------
    InputError
        As `superpixel_labels`.

    Notes
    -----
    Borders that were laid by the noise of the very pixels they are judged by would make contrasts of noise. One half of
    the pixels, as the white squares of a chessboard, finds the regions; the other half alone is measured.
    """
    labels, measured = map_cut(luminance.luminance_cd_m2, size_px)
    for other in others:
        measured &= np.isfinite(other.luminance_cd_m2)
    return [_measured(luminance_map, labels, measured, size_px) for luminance_map in (luminance, *others)]


def _measured(luminance: LuminanceMap, labels: Labels, measured: NDArray[np.bool_], size_px: int) -> MapRegions:
    image = luminance.luminance_cd_m2
    n = int(labels.max()) + 1
    saturated = np.not_equal(luminance.invalid & Invalid.SATURATED, 0)
    rows, columns = np.ogrid[: labels.shape[0], : labels.shape[1]]
    centres = [mean_of(labels, np.broadcast_to(index + 0.5, labels.shape), n) for index in (columns, rows)]
    values, n_pixels, mean, std = statistics(image, labels, measured)
    return MapRegions(
        size_px=size_px,
        labels=labels,
        n_pixels=n_pixels,
        mean=mean,
        std=std,
        noise=_noise(image, labels, measured, n),
        saturated_share=mean_of(labels, saturated, n),
        invalid_share=mean_of(labels, ~luminance.valid, n),
        centre_px=np.stack(centres, axis=1),
        values=values,
        **_planes(image, labels, measured, n),
    )


def map_cut(image: NDArray[np.floating[Any]], size_px: int) -> tuple[Labels, NDArray[np.bool_]]:
    """Cut an image into superpixels; their labels, and a mask of the pixels to measure.

    Raises
    ------
    InputError
        As `superpixel_labels`.
    """
    labels = superpixel_labels(image, size_px, half=True)
    measured = inner(labels, _MARGIN_PX if size_px >= _SMALL_SIZE_PX else _SMALL_MARGIN_PX)
    measured &= ~seen_half((image.shape[0], image.shape[1]))
    measured &= np.isfinite(image)
    return labels, measured


def mean_of(labels: Labels, pattern: NDArray[Any], n: int) -> Floats:
    """Mean of a pattern over each of `n` regions; what is not finite counts as 0."""
    from scipy import ndimage

    return np.asarray(ndimage.mean(np.where(np.isfinite(pattern), pattern, 0.0), labels, np.arange(n)))


def statistics(
    image: NDArray[np.floating[Any]], labels: Labels, measured: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.int64], Floats, Floats]:
    """Measured pixels, region after region; and their number, mean and standard deviation (with n - 1) in each."""
    label, n = labels[measured], int(labels.max()) + 1
    order = np.argsort(label, kind="stable")
    label, values = label[order], image[measured][order].astype(np.float64)
    n_pixels = np.bincount(label, minlength=n).astype(np.int64)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.bincount(label, weights=values, minlength=n) / n_pixels
        squares = np.bincount(label, weights=(values - mean[label]) ** 2, minlength=n)
        return values, n_pixels, mean, np.where(n_pixels > 1, np.sqrt(squares / (n_pixels - 1)), nan)


def _planes(image: NDArray[np.floating[Any]], labels: Labels, measured: NDArray[np.bool_], n: int) -> dict[str, Floats]:
    """Middle of the measured pixels of each region, and slope of the plane through their light."""
    label = labels[measured]
    count = np.bincount(label, minlength=n)

    def mean(values: NDArray[np.floating[Any]]) -> Floats:
        return np.asarray(np.bincount(label, weights=values, minlength=n) / count)

    rows, columns = np.nonzero(measured)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = np.stack([mean(columns + 0.5), mean(rows + 0.5)])
        x, y = np.stack([columns + 0.5, rows + 0.5]) - middle[:, label]
        xx, xy, yy = mean(x * x), mean(x * y), mean(y * y)
        light = image[measured].astype(np.float64)
        along_x, along_y = mean(x * light), mean(y * light)
        slope = np.stack([yy * along_x - xy * along_y, xx * along_y - xy * along_x]) / (xx * yy - xy**2)
    return {"middle_px": middle.T, "slope": slope.T}


def _noise(image: NDArray[np.floating[Any]], labels: Labels, measured: NDArray[np.bool_], n: int) -> Floats:
    """Estimate the standard deviation of the noise of each region from differences of its measured pixels."""
    both = measured[:-1, :-1] & measured[1:, 1:] & (labels[:-1, :-1] == labels[1:, 1:])
    label = labels[:-1, :-1][both]
    sizes = np.abs(image[1:, 1:][both].astype(np.float64) - image[:-1, :-1][both])
    order = np.lexsort((sizes, label))
    n_sizes = np.bincount(label, minlength=n)
    rank = np.arange(label.size) - np.repeat(np.cumsum(n_sizes) - n_sizes, n_sizes)
    kept = order[rank < np.repeat((1 - _TRIMMED) * n_sizes, n_sizes)]
    with np.errstate(invalid="ignore"):
        mean = np.bincount(label[kept], weights=sizes[kept], minlength=n) / np.bincount(label[kept], minlength=n)
    return np.asarray(mean / (_MEAN_OF_TRIMMED * sqrt(2)))
