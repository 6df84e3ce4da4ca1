"""Edges of a contrast map: contrast of neighbouring regions, whether it is one at all, and its CDP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from ....metrics import Epsilon
from ....metrics.contrast import TargetContrasts, checked_contrast, detected_ratios, each_contrast
from ....metrics.detection import count_cdp
from ....metrics.pixel_pairs import share_inside
from ....metrics.region import LEAST_FACTOR, SATURATED_SHARE, variance_of_changes
from ....regions.superpixels import Neighbours
from .noise import MapNoise, cdp_of_noise
from .regions import Floats, Labels, MapRegions

#: Smallest superpixels whose inner pixels suffice to judge an edge.
SMALLEST_SIZE_PX = 10

#: Fewest measured pixels of a region that an edge is judged by.
FEWEST_PIXELS = 20

#: Shortest border of an edge, as part of the size of the regions.
_SHORTEST_BORDER = 1 / 8

#: Chance that noise alone makes a single edge of an image, all its edges together (Bonferroni).
FALSE_ALARM = 0.01

#: Part of the pairs that miss a contrast which noise must account for; else the regions are not uniform.
_LEAST_PART_OF_NOISE = 0.5

#: Relative errors of the calibration that differ by less than this between neighbours move no CDP by 0.0001.
_LEAST_ERROR = 1e-5


@dataclass(frozen=True)
class ContrastMapSettings:
    """How an image's edges are judged.

    Parameters
    ----------
    size_px : int
        Side of the regions in pixels of the image, 10 or more: about half the smallest object that matters.
    epsilon : float or DetectionInterval
        Tolerance of a contrast, as for `labcdp.metrics.cdp`.
    minimum_contrast : float
        Weber contrast from which an edge is one of an object, a fraction above 0.
    detected : float
        Smallest CDP of a detected edge, above 0 and up to 1.
    contrast : float, tuple of float or None
        Weber contrast that the objects of the scene have, a fraction above 0, or several to compare; None for that of
        each edge in the image.

    Raises
    ------
    InputError
        If one is out of range.

    Examples
    --------
    >>> from labcdp.evaluate.picture.edges.edges import ContrastMapSettings
    >>> ContrastMapSettings(size_px=20, contrast=0.5).minimum_contrast
    0.1
    """

    size_px: int = 40
    epsilon: Epsilon = 0.5
    minimum_contrast: float = 0.1
    detected: float = 0.9
    contrast: TargetContrasts = None

    def __post_init__(self) -> None:
        if self.size_px < SMALLEST_SIZE_PX:
            raise InputError(
                f"the region size is {self.size_px} pixels: give {SMALLEST_SIZE_PX} or more, so that noise can "
                "be distinguished from contrast"
            )
        if not (isfinite(self.minimum_contrast) and self.minimum_contrast > 0):
            raise InputError(f"the minimum contrast is {self.minimum_contrast}: give a fraction above 0 (1.0 is 100 %)")
        if not 0 < self.detected <= 1:
            raise InputError(f"the CDP of a detected edge is {self.detected}: give a fraction above 0, up to 1")
        # Refuses a tolerance or contrast that is out of range.
        for target in each_contrast(self.contrast):
            checked_contrast(self.minimum_contrast if target is None else target, self.epsilon)


class EdgeKind(IntEnum):
    """Verdict on an edge.

    Examples
    --------
    >>> from labcdp.evaluate.picture.edges.edges import EdgeKind
    >>> EdgeKind(0).name
    'SEEN'
    """

    #: Contrast of at least the requested minimum, and probably detected.
    SEEN = 0
    #: The same, and probably not detected.
    LOST = 1
    #: A contrast below the requested minimum.
    FAINT = 2
    #: Contrast that is not significant, and no more than noise explains.
    NOISE = 3
    #: One of the regions has saturated pixels.
    SATURATED = 4
    #: The darker region has no light above the black, and thus no contrast is defined.
    BLACK = 5
    #: One of the regions has too few pixels, or they touch at a corner only.
    SMALL = 6
    #: Not significant or probably not detected, but more for what the regions are like (two surfaces, texture, shading)
    #: than for noise.
    UNEVEN = 7


@dataclass(frozen=True, eq=False)
class MapEdges:
    """Edges between neighbouring regions, n of them; all arrays have one row for each.

    Parameters
    ----------
    bright, dark : ndarray of int32, shape (n,)
        The regions, the brighter one by its mean first.
    border_px : ndarray of int64, shape (n,)
        Length of the border in sides of pixels of the map.
    middle_px : ndarray of float, shape (n, 2)
        Middle (x, y) of the border in pixels of the map.
    kind : ndarray of int8, shape (n,)
        `EdgeKind`.
    contrast, contrast_standard_uncertainty : ndarray of float, shape (n,)
        Weber contrast of the means, a fraction; nan where it is not defined. Below 0 where the contrast of the scene is
        known and reversed in the image.
    asked_contrast : ndarray of float, shape (n,)
        Contrast whose CDP is stated: that of the scene where it is known, else `contrast`.
    significant_contrast : ndarray of float, shape (n,)
        Contrast from which on it would be significant.
    cdp, cdp_standard_error, cdp_low, cdp_high : ndarray of float, shape (n,)
        Probability that a pair of pixels shows `asked_contrast` within the tolerance, and its 95 % interval; nan for
        edges that are noise, saturated, black or small.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp import read_image
    >>> from labcdp.evaluate.picture.edges.map import contrast_map
    >>> scene = np.kron([[100, 200]], np.ones((120, 80))) + np.random.default_rng(1).normal(0, 2, (120, 160))
    >>> written = cv2.imwrite("two.png", scene.round().astype(np.uint8))
    >>> luminance = read_image("two.png", encoding="linear").luminance
    >>> edges = contrast_map(luminance).edges
    >>> seen = edges.contrast > 0.9  # those between the halves of the scene
    >>> edges.middle_px[seen, 0].round().tolist()
    [80.0, 80.0, 80.0, 80.0, 80.0]
    """

    bright: Labels
    dark: Labels
    border_px: NDArray[np.int64]
    middle_px: Floats
    kind: NDArray[np.int8]
    contrast: Floats
    contrast_standard_uncertainty: Floats
    asked_contrast: Floats
    significant_contrast: Floats
    cdp: Floats
    cdp_standard_error: Floats
    cdp_low: Floats
    cdp_high: Floats


def map_edges(
    regions: MapRegions,
    near: Neighbours,
    errors: Sequence[Floats],
    noise: MapNoise,
    settings: ContrastMapSettings,
    scene: MapRegions | float | None = None,
    smooth: Sequence[Floats] = (),
) -> MapEdges:
    """Judge the edges between regions.

    Parameters
    ----------
    regions : MapRegions
        The regions.
    near : Neighbours
        Pairs of regions that share a border.
    errors : sequence of ndarray of float, shape (number of regions,)
        Independent errors that all regions share: relative error of each region for one standard uncertainty.
    noise : MapNoise
        Noise of the image.
    settings : ContrastMapSettings
        Settings by which edges are judged.
    scene : MapRegions, float or None
        Known of the scene: the same regions without what took contrast, the contrast of its objects, or nothing.
    smooth : sequence of ndarray of float, shape (number of regions,)
        Errors like `errors` that change slowly over the image: they are in the uncertainty of a contrast, but make no
        edge, and take none.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp import read_image
    >>> from labcdp.evaluate.picture.edges.edges import map_edges
    >>> from labcdp.evaluate.picture.edges.map import contrast_map
    >>> scene = np.kron([[100, 200]], np.ones((120, 80))) + np.random.default_rng(1).normal(0, 2, (120, 160))
    >>> written = cv2.imwrite("two.png", scene.round().astype(np.uint8))
    >>> luminance = read_image("two.png", encoding="linear").luminance
    >>> edge_map = contrast_map(luminance)
    >>> again = map_edges(edge_map.regions, edge_map.near, [], edge_map.noise, edge_map.settings)
    >>> np.array_equal(again.kind, edge_map.edges.kind)
    True
    """
    known = scene if isinstance(scene, MapRegions) else regions
    swapped = np.greater(*known.mean[near.pairs.T[::-1]])
    bright, dark = sides = np.where(swapped, near.pairs.T[::-1], near.pairs.T)
    by_calibration = np.sqrt(sum((np.square(x[bright] - x[dark]) for x in errors), start=np.zeros(bright.size)))
    contrast, uncertainty, least = _contrasts(regions, sides, by_calibration, noise.inflation)
    smooth_u = np.sqrt(sum((np.square(x[bright] - x[dark]) for x in smooth), start=np.zeros(bright.size)))
    uncertainty = np.hypot(uncertainty, (1 + contrast) * smooth_u)
    # Where there is no light on the whole, there is no contrast either.
    by_calibration = np.where(np.isfinite(by_calibration), by_calibration, 0.0)
    wanted, significant, shading = contrast, contrast > least, np.zeros(contrast.size, np.bool_)
    # Regions of a texture differ by more than their noise explains, and by less than their texture does.
    textured = contrast > _contrasts(noise.alone(regions), sides, by_calibration, noise.inflation)[2]
    if isinstance(scene, MapRegions):
        wanted, _, least_of_scene = _contrasts(scene, sides, by_calibration, noise.inflation)
        significant = wanted > least_of_scene
    elif scene is not None:
        wanted = np.full(contrast.size, scene)
        shading = regions.steady(sides, near.middle_px)
    kind = np.full(bright.size, EdgeKind.SEEN, dtype=np.int8)
    # Those that are lost are still among those that are seen; what comes later prevails.
    for where, edge_kind in (
        (wanted < settings.minimum_contrast, EdgeKind.FAINT),
        (~significant, EdgeKind.NOISE),
        ((np.where(significant, shading, textured)) & (wanted >= settings.minimum_contrast), EdgeKind.UNEVEN),
        (~(regions.mean[dark] > 0), EdgeKind.BLACK),
        (np.maximum(*regions.saturated_share[sides]) > SATURATED_SHARE, EdgeKind.SATURATED),
        (np.minimum(*regions.n_pixels[sides]) < FEWEST_PIXELS, EdgeKind.SMALL),
        (near.border_px < _SHORTEST_BORDER * regions.size_px, EdgeKind.SMALL),
    ):
        kind[where] = edge_kind
    measured = np.isin(kind, (EdgeKind.SEEN, EdgeKind.FAINT)) & (wanted > 0)
    cdp = _cdps(regions, sides, np.where(measured, wanted, nan), settings.epsilon, by_calibration, noise.inflation)
    missed = (kind == EdgeKind.SEEN) & (cdp[:, 0] < settings.detected)
    by_noise = cdp_of_noise(regions, noise.deviation(regions), sides, wanted, settings.epsilon)
    kind[missed] = EdgeKind.LOST
    kind[missed & (1 - by_noise < _LEAST_PART_OF_NOISE * (1 - cdp[:, 0]))] = EdgeKind.UNEVEN
    return MapEdges(bright, dark, near.border_px, near.middle_px, kind, contrast, uncertainty, wanted, least, *cdp.T)


def _contrasts(
    regions: MapRegions, sides: Labels, by_calibration: Floats, inflation: float
) -> tuple[Floats, Floats, Floats]:
    """Contrast of each edge, its standard uncertainty, and the contrast from which on it is significant.

    The test is Welch's (B. L. Welch, Biometrika 34, 1947) of equal means, at `FALSE_ALARM` over the number of edges.
    """
    from scipy.special import stdtrit

    with np.errstate(divide="ignore", invalid="ignore"):
        variance = inflation * regions.std**2 / regions.n_pixels
        variance_bright, variance_dark = variance[sides]
        means, n_bright, n_dark = regions.mean[sides], *regions.n_pixels[sides]
        contrast = np.where(means[1] > 0, means[0] / means[1] - 1, nan)
        rel = np.sqrt(variance_bright / means[0] ** 2 + variance_dark / means[1] ** 2 + by_calibration**2)
        # Without a contrast the bright region is as bright as the dark one.
        rel_without = np.sqrt((variance_bright + variance_dark) / means[1] ** 2 + by_calibration**2)
        dof = (variance_bright + variance_dark) ** 2 / (
            variance_bright**2 / (n_bright - 1) + variance_dark**2 / (n_dark - 1)
        )
        # Regions without any scatter have no degrees of freedom, and need none.
        k = stdtrit(np.where(np.isfinite(dof), dof, 1.0), 1 - FALSE_ALARM / (2 * max(variance_dark.size, 1)))
        least = np.where(variance_bright + variance_dark > 0, k, 1.0) * rel_without
    known = means[1] > 0
    return contrast, np.where(known, (1 + contrast) * rel, nan), np.where(known, least, nan)


def _cdps(
    regions: MapRegions, sides: Labels, contrast: Floats, epsilon: Epsilon, by_calibration: Floats, inflation: float
) -> Floats:
    """CDP, standard uncertainty and interval of each edge, by pixels and calibration, shape (n, 4); nan for no CDP."""
    results = np.full((contrast.size, 4), nan)
    chosen = np.flatnonzero(np.isfinite(contrast))
    pixels = regions.distributions(np.unique(sides[:, chosen]))
    for edge in chosen:
        a, b = (pixels[int(side)] for side in sides[:, edge])
        target = checked_contrast(float(contrast[edge]), epsilon)
        (result,) = count_cdp(a, b, [target], epsilon, inflation=lambda *_: inflation)
        error, variance = float(by_calibration[edge]), 0.0
        if error >= _LEAST_ERROR:
            factors = (1 + error, max(1 - error, LEAST_FACTOR))
            # All bright pixels `factor` times as bright are the same as other ends of the interval.
            low, high = detected_ratios(target, epsilon)
            changed = [share_inside(a, b, (low / factor, high / factor)) for factor in factors]
            variance = float(variance_of_changes(result.cdp, [changed]))
        result = result.with_calibration(variance)
        results[edge] = (result.cdp, result.u, *result.interval)
    return results
