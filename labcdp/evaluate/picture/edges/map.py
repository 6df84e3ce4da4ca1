"""CDP of the local contrasts of an image: every edge between neighbouring superpixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from ....core.luminance import LuminanceMap
from ....core.quantity import Z_95
from ....core.result import Finding, info, warning
from ....metrics.contrast import each_contrast
from ....regions.superpixels import Neighbours, neighbours
from .edges import FALSE_ALARM, SMALLEST_SIZE_PX, ContrastMapSettings, EdgeKind, MapEdges, map_edges
from .noise import MapNoise, map_noise
from .regions import MapRegions, map_regions, mean_of

#: Noise of neighbouring pixels counts as independent up to this factor of the variance of a mean.
_CORRELATED = 1.5
#: Share of the edges where the minimum contrast is below the noise, from which on other settings are recommended.
_MOSTLY_BLIND = 0.5
#: Share of the borders in sight that must be judged for a statement about the image.
LEAST_JUDGED = 1 / 3
#: Samples along the side of a region at which smooth errors of the calibration are evaluated.
_SAMPLES = 6


@dataclass(frozen=True, eq=False)
class ContrastMap:
    """Local contrasts of an image.

    Parameters
    ----------
    luminance : LuminanceMap
        The image.
    settings : ContrastMapSettings
        Settings by which it was judged.
    regions : MapRegions
        Its superpixels.
    near : Neighbours
        Pairs of regions that share a border, and the border; rows as in `edges`.
    edges : MapEdges
        Their contrasts.
    noise : MapNoise
        Noise of the image.
    findings : tuple of Finding
        Findings about the map.
    has_reference : bool
        Whether edges are asked for the contrast of another image of the scene.
    others : tuple of ContrastMap
        The same edges asked for further contrasts.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp import read_image
    >>> from labcdp.evaluate.picture.edges.edges import EdgeKind
    >>> from labcdp.evaluate.picture.edges.map import contrast_map
    >>> scene = np.kron([[100, 200]], np.ones((120, 80))) + np.random.default_rng(1).normal(0, 2, (120, 160))
    >>> written = cv2.imwrite("two.png", scene.round().astype(np.uint8))
    >>> luminance = read_image("two.png", encoding="linear").luminance
    >>> edges = contrast_map(luminance)
    >>> edges.count(EdgeKind.SEEN) > 0, edges.count(EdgeKind.LOST)
    (True, 0)
    """

    luminance: LuminanceMap
    settings: ContrastMapSettings
    regions: MapRegions
    near: Neighbours
    edges: MapEdges
    noise: MapNoise
    findings: tuple[Finding, ...]
    has_reference: bool = False
    others: tuple[ContrastMap, ...] = ()

    @property
    def each(self) -> tuple[ContrastMap, ...]:
        """The map at each contrast to be detected."""
        return (self, *self.others)

    @property
    def contrast(self) -> float | None:
        """Target contrast for all edges; None if each is judged at its measured contrast."""
        (target,) = each_contrast(self.settings.contrast)
        return target

    @property
    def shape_px(self) -> tuple[int, int]:
        """Height and width in pixels of the image."""
        height, width = self.luminance.shape
        return height * self.luminance.step, width * self.luminance.step

    def count(self, *kinds: EdgeKind) -> int:
        """Count the edges of some kinds."""
        return int(np.count_nonzero(self.mask_of_kinds(*kinds)))

    def mask_of_kinds(self, *kinds: EdgeKind) -> NDArray[np.bool_]:
        """Mask of the edges of some kinds."""
        return np.isin(self.edges.kind, kinds)

    @property
    def is_certain(self) -> NDArray[np.bool_]:
        """Mask of the edges that are evidence: of a contrast above its U (95 %), or one that the reference shows."""
        edges = self.edges
        return np.asarray(self.has_reference | (edges.contrast > Z_95 * edges.contrast_standard_uncertainty))

    @property
    def n_uncertain(self) -> int:
        """Number of detected and lost edges that may be none, as their contrast is not above its U."""
        return int(np.count_nonzero(self.mask_of_kinds(EdgeKind.SEEN, EdgeKind.LOST) & ~self.is_certain))

    @property
    def detected_share(self) -> float:
        """Share of the edges with at least the minimum contrast that are probably detected; nan without any."""
        seen, lost = self.count(EdgeKind.SEEN), self.count(EdgeKind.LOST)
        return seen / (seen + lost) if seen + lost else nan

    @property
    def detected_border_share(self) -> float:
        """The same by length of border."""
        seen, lost = (
            float(self.edges.border_px[self.mask_of_kinds(kind)].sum()) for kind in (EdgeKind.SEEN, EdgeKind.LOST)
        )
        return seen / (seen + lost) if seen + lost else nan

    @property
    def n_in_sight(self) -> int:
        """Number of borders in sight: those judged, and those of at least the minimum contrast that cannot be.

        The latter are of regions that are saturated or not uniform.
        """
        high = self.edges.contrast >= self.settings.minimum_contrast
        left_out = high & self.mask_of_kinds(EdgeKind.UNEVEN, EdgeKind.SATURATED)
        return self.count(EdgeKind.SEEN, EdgeKind.LOST) + int(np.count_nonzero(left_out))

    @property
    def judged_share(self) -> float:
        """Share of the borders in sight that are judged, detected or lost; nan without any."""
        return self.count(EdgeKind.SEEN, EdgeKind.LOST) / self.n_in_sight if self.n_in_sight else nan

    @property
    def too_few_judged(self) -> bool:
        """Whether so few of the borders in sight are judged that their share says little about the image."""
        return self.judged_share < LEAST_JUDGED

    @property
    def blind_share(self) -> float:
        """Share of the edges, of those with a contrast, where the minimum contrast would not be significant."""
        known = np.isfinite(self.edges.significant_contrast) & ~self.mask_of_kinds(EdgeKind.SATURATED, EdgeKind.SMALL)
        blind = self.edges.significant_contrast[known] > self.settings.minimum_contrast
        return float(np.mean(blind)) if known.any() else nan

    @property
    def threshold_sigmas(self) -> float:
        """Standard uncertainties from which on a contrast is significant, for regions of many pixels."""
        from scipy.special import ndtri

        return float(-ndtri(FALSE_ALARM / (2 * max(self.edges.kind.size, 1))))

    def weakest(self, n: int) -> NDArray[np.intp]:
        """Rows of the `n` certain edges of lowest CDP with at least the minimum contrast, the lowest first."""
        judged = np.flatnonzero(self.mask_of_kinds(EdgeKind.SEEN, EdgeKind.LOST) & self.is_certain)
        return judged[np.argsort(self.edges.cdp[judged], kind="stable")][:n]


def contrast_map(
    luminance: LuminanceMap, settings: ContrastMapSettings | None = None, reference: LuminanceMap | None = None
) -> ContrastMap:
    """Measure the contrast between all neighbouring regions of an image, and how probably each is detected.

    Parameters
    ----------
    luminance : LuminanceMap
        The image, in cd/m^2 or relative.
    settings : ContrastMapSettings or None
        None takes those by default.
    reference : LuminanceMap or None
        The same scene from the same place without what took contrast, such as a veil; its edges and their contrasts are
        asked for.

    Raises
    ------
    InputError
        If the image is smaller than a region, no pixel is finite, the reference has another size, or a contrast is
        asked for as well.

    Notes
    -----
    The image is cut into superpixels with one half of its pixels; the other half is measured, away from the borders
    (`map_regions`). The contrast of an edge is the Weber contrast K of the two means. Its CDP is the share of all pairs
    of a pixel of the one and a pixel of the other region that show a contrast of K (1 - epsilon) to K (1 + epsilon), as
    `labcdp.metrics.cdp` of the two. An edge is one if its contrast is significant: Welch's test at 1 % over the
    number of edges, so that noise alone makes an edge in one of 100 images. What the calibration leaves uncertain
    counts as far as it differs between two neighbours; slow changes across the image (flat field, darkness) are alike
    for neighbours and cancel.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp import read_image
    >>> from labcdp.evaluate.picture.edges.map import contrast_map
    >>> scene = np.kron([[100, 200]], np.ones((120, 80))) + np.random.default_rng(1).normal(0, 2, (120, 160))
    >>> written = cv2.imwrite("two.png", scene.round().astype(np.uint8))
    >>> luminance = read_image("two.png", encoding="linear").luminance
    >>> float(contrast_map(luminance).edges.contrast.max().round(1))
    1.0
    """
    chosen = settings or ContrastMapSettings()
    step = luminance.step
    size = max(round(chosen.size_px / step), 1)
    if size < SMALLEST_SIZE_PX:
        raise InputError(
            f"regions of {chosen.size_px} pixels have {size} of each colour plane of this camera along a side: give "
            f"{SMALLEST_SIZE_PX * step} or more"
        )
    if reference is not None:
        _check_reference(luminance, reference, chosen)
    regions, *others = (
        map_regions(luminance, size) if reference is None else map_regions(reference, size, luminance)[::-1]
    )
    near = neighbours(regions.labels)
    noise = map_noise(luminance.luminance_cd_m2, regions)
    errors, smooth, maps = _errors(luminance, regions), _smooth_errors(luminance, regions), []
    for contrast in each_contrast(chosen.contrast):
        scene = others[0] if others else contrast
        edges = map_edges(regions, near, errors, noise, chosen, scene, smooth)
        settings = replace(chosen, contrast=contrast)
        edge_map = ContrastMap(luminance, settings, regions, near, edges, noise, (), reference is not None)
        maps.append(replace(edge_map, findings=_findings(edge_map)))
    return replace(maps[0], others=tuple(maps[1:]))


def _check_reference(luminance: LuminanceMap, reference: LuminanceMap, settings: ContrastMapSettings) -> None:
    if settings.contrast is not None:
        raise InputError("a contrast and a reference image are given: give one of them")
    if reference.shape != luminance.shape:
        raise InputError(
            f"the reference image has {reference.shape[1]} x {reference.shape[0]} pixels, the image "
            f"{luminance.shape[1]} x {luminance.shape[0]}: give an image of the same camera from the same place"
        )


def _errors(luminance: LuminanceMap, regions: MapRegions) -> list[NDArray[np.float64]]:
    """Relative errors of each region's mean by the errors of the calibration that vary over the image."""
    n = regions.mean.size
    mean = mean_of(regions.labels, luminance.luminance_cd_m2, n)
    means = []
    # Without a calibration there are smooth ones only, whose maps are not needed.
    for error in luminance.common if not _has_smooth(luminance) else ():
        if np.ndim(error.relative):
            with np.errstate(divide="ignore", invalid="ignore"):
                # By the light of each pixel: relative errors have no bound where there is hardly any.
                means.append(mean_of(regions.labels, error.relative * luminance.luminance_cd_m2, n) / mean)
    return means


def _smooth_errors(luminance: LuminanceMap, regions: MapRegions) -> list[NDArray[np.float64]]:
    """Relative errors of each region by those that hardly change within it."""
    if not _has_smooth(luminance):
        return []
    # Some rows and columns suffice, and take no memory.
    step = max(regions.size_px // _SAMPLES, 1)
    some = slice(None, None, step), slice(None, None, step)
    errors = (error for error in luminance.common_in(some) if error.smooth)
    means = (mean_of(regions.labels[some], np.asarray(error.relative), regions.mean.size) for error in errors)
    return [np.nan_to_num(error) for error in means]


def _has_smooth(luminance: LuminanceMap) -> bool:
    return any(error.smooth for error in luminance.common_in((slice(0, 1), slice(0, 1))))


def _findings(edge_map: ContrastMap) -> tuple[Finding, ...]:
    findings = []
    if edge_map.settings.contrast is None and not edge_map.has_reference:
        findings.append(info("map-of-own-contrast"))
    least = edge_map.settings.minimum_contrast
    hidden = edge_map.mask_of_kinds(EdgeKind.NOISE) & (edge_map.edges.contrast >= least)
    if hidden.any():
        findings.append(info("edges-in-noise", count=int(hidden.sum()), contrast=least, n_edges=hidden.size))
    if edge_map.noise.inflation > _CORRELATED:
        findings.append(warning("correlated-noise", factor=edge_map.noise.inflation**0.5))
    if edge_map.too_few_judged:
        judged = edge_map.count(EdgeKind.SEEN, EdgeKind.LOST)
        findings.append(warning("few-edges-judged", count=judged, n_edges=edge_map.n_in_sight))
    if edge_map.blind_share > _MOSTLY_BLIND:
        findings.append(warning("mostly-noise", contrast=edge_map.settings.minimum_contrast))
    return tuple(findings)
