"""Evaluation of a picture: contrasts of its regions, and of neighbouring pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.finding import Finding, info, unique, warning
from ...core.luminance import LuminanceMap
from ...core.roi import Roi
from ...files.picture.picture import Picture
from ...metrics import ContrastDistribution, contrast_histogram
from ...metrics.regions.pair import PairResult, RegionResult, evaluate_pair, evaluate_region
from .neighbours import NeighbourEvaluation, evaluate_neighbours
from .request import ImageRequest


@dataclass(frozen=True)
class ImagePair:
    """Two regions of a picture.

    Parameters
    ----------
    result : PairResult
        Contrast and CDP.
    distribution : ContrastDistribution or None
        Of the contrasts of all pairs of pixels, for plots; None where no contrast is finite.
    """

    result: PairResult
    distribution: ContrastDistribution | None

    @property
    def name(self) -> str:
        """Return "bright / dark"."""
        return f"{self.result.bright_region.roi.name} / {self.result.dark_region.roi.name}"


@dataclass(frozen=True, eq=False)
class ImageEvaluation:
    """Contrasts of a picture.

    Parameters
    ----------
    path : Path
        The file.
    sha256 : str
        Hash of its bytes.
    shape : (int, int)
        Height and width in pixels.
    unit : str
        ``cd/m²``, or ``relative`` without a scale.
    exposure_s : float or None
        Exposure, where it is known.
    camera : str or None
        Camera, if known.
    simulated : bool
        Whether the camera is simulated.
    regions : tuple of RegionResult
        All regions, in the order of the request.
    pairs : tuple of ImagePair
        In the order of the request.
    neighbours : NeighbourEvaluation or None
        Of neighbouring pixels.
    findings : tuple of Finding
        What a user should know.
    """

    path: Path
    sha256: str
    shape: tuple[int, int]
    unit: str
    exposure_s: float | None
    camera: str | None
    simulated: bool
    regions: tuple[RegionResult, ...]
    pairs: tuple[ImagePair, ...]
    neighbours: NeighbourEvaluation | None
    findings: tuple[Finding, ...]


def evaluate_image(
    picture: Picture, luminance: LuminanceMap, unit: str, request: ImageRequest, findings: Sequence[Finding] = ()
) -> ImageEvaluation:
    """Evaluate a picture.

    Parameters
    ----------
    picture : Picture
        The picture.
    luminance : LuminanceMap
        What it was converted to.
    unit : str
        Unit of that, ``cd/m^2`` or ``relative``.
    request : ImageRequest
        The request.
    findings : sequence of Finding
        Of picture and conversion.

    Raises
    ------
    InputError
        As `evaluate_pair` and `evaluate_neighbours`.
    """
    rois = {roi.name: roi for roi in request.rois}
    pairs = [_pair(luminance, rois[a], rois[b], request) for a, b in request.chosen_pairs]
    evaluated = {region.roi.name: region for pair in pairs for region in (pair.result.a, pair.result.b)}
    regions = [evaluated.get(name) or evaluate_region(luminance, roi) for name, roi in rois.items()]
    neighbours = None
    if request.neighbours:
        neighbours = evaluate_neighbours(luminance, request.contrasts, request.epsilon, request.rectangle)
    frame = picture.frame
    simulated = frame is not None and frame.camera.simulated
    found = [*([info("camera-simulated")] if simulated else []), *findings]
    if any(pair.result.of_measured_contrast for pair in pairs) and request.contrasts is None:
        found.append(info("contrast-is-measured"))
    found += [
        warning("pair-swapped", bright=pair.result.b.roi.name, dark=pair.result.a.roi.name)
        for pair in pairs
        if request.pairs is not None and pair.result.bright == "b"
    ]
    found += [one for pair in pairs for one in pair.result.findings]
    found += neighbours.findings if neighbours is not None else ()
    return ImageEvaluation(
        path=picture.path,
        sha256=picture.sha256,
        shape=picture.shape,
        unit=unit.replace("^2", "²"),
        exposure_s=frame.exposure_s if frame is not None and picture.exposure_known else None,
        camera=str(frame.camera) if frame is not None and picture.camera_stated else None,
        simulated=simulated,
        regions=tuple(regions),
        pairs=tuple(pairs),
        neighbours=neighbours,
        findings=unique(found),
    )


def _pair(luminance: LuminanceMap, a: Roi, b: Roi, request: ImageRequest) -> ImagePair:
    result = evaluate_pair(luminance, a, b, request.contrasts, request.epsilon)
    first, second = (luminance.select(roi).astype(np.float64) for roi in (a, b))
    highest = max((one.result.interval[1] for one in result.results), default=1.0)
    return ImagePair(result, contrast_histogram(first, second, highest))
