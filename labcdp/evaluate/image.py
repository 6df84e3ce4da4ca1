"""Evaluation of a picture: contrasts of its regions, and from pixel to pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contrast import ContrastDistribution, Epsilon, contrast_distribution
from ..errors import InputError
from ..luminance import LuminanceMap
from ..roi import Roi
from ..sources.picture import Picture
from .image_neighbours import NeighbourEvaluation, Rectangle, evaluate_neighbours
from .pair import PairResult, RegionResult, evaluate_pair, evaluate_region

#: More regions than this make so many pairs that nobody wants them all.
MOST_REGIONS_FOR_ALL_PAIRS = 6
#: Bars of the contrast histogram, and how many times the highest detected contrast they reach at the most: a dark pixel
#: close to 0 makes contrasts of any size.
_N_BINS, _MOST_TIMES = 200, 10.0


@dataclass(frozen=True)
class ImageRequest:
    """What is asked of a picture.

    Parameters
    ----------
    contrasts : tuple of float
        Contrasts to be detected, fractions.
    epsilon : float
        Their tolerance.
    rois : tuple of Roi
        Regions.
    pairs : tuple of (str, str) or None
        Bright and dark regions, by name; None for all pairs.
    neighbours : bool
        Whether CDP from pixel to pixel is wanted.
    rectangle : (int, int, int, int) or None
        Corner pixels x0, y0, x1, y1, both in, that it is limited to.

    Raises
    ------
    InputError
        If nothing is asked, a pair names a region that is not there or one region twice, one region is alone, or there
        are too many for all pairs.
    """

    contrasts: tuple[float, ...]
    epsilon: float
    rois: tuple[Roi, ...] = ()
    pairs: tuple[tuple[str, str], ...] | None = None
    neighbours: bool = False
    rectangle: Rectangle | None = None

    def __post_init__(self) -> None:
        names = [roi.name for roi in self.rois]
        if not names and not self.neighbours:
            raise InputError("nothing is asked of the pictures: give regions, or ask for CDP from pixel to pixel")
        for pair in self.pairs or ():
            for name in pair:
                if name not in names:
                    raise InputError(f"there is no region {name!r}: choose from {', '.join(names) or 'none'}")
            if pair[0] == pair[1]:
                raise InputError(f"region {pair[0]!r} is paired with itself: give two regions")
        if self.pairs is None and len(names) == 1 and not self.neighbours:
            raise InputError(f"region {names[0]!r} is alone: a contrast needs two regions")
        if self.pairs is None and len(names) > MOST_REGIONS_FOR_ALL_PAIRS:
            raise InputError(
                f"{len(names)} regions make {len(names) * (len(names) - 1) // 2} pairs: choose pairs among "
                f"{', '.join(names)}"
            )

    @property
    def chosen_pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the pairs, each pair once."""
        if self.pairs is None:
            return tuple(combinations((roi.name for roi in self.rois), 2))
        found: dict[frozenset[str], tuple[str, str]] = {}
        for pair in self.pairs:
            found.setdefault(frozenset(pair), pair)
        return tuple(found.values())


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

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        result = self.result
        return {
            "bright": result.bright_region.roi.name,
            "dark": result.dark_region.roi.name,
            "measured_contrast": result.contrast.value,
            "measured_contrast_standard_uncertainty": result.contrast.standard_error,
            "csnr": result.csnr.value,
            "csnr_standard_uncertainty": result.csnr.standard_error,
            "contrasts": [
                {
                    **asdict(one.result),
                    "calibration_standard_uncertainty": one.calibration_standard_uncertainty,
                    "standard_uncertainty": one.standard_uncertainty,
                    "confidence_interval": list(one.confidence_interval),
                }
                for one in result.results
            ],
        }


@dataclass(frozen=True, eq=False)
class ImageEvaluation:
    """What a picture says.

    Parameters
    ----------
    path : Path
        The file.
    sha256 : str
        Hash of its bytes.
    shape : (int, int)
        Height and width in pixels.
    unit : str
        ``cd/m^2``, or ``relative`` without a scale.
    exposure_s : float or None
        Exposure, where it is known.
    camera : str or None
        Who took it, where that is known.
    notes : tuple of str
        What was done with the values of the file.
    regions : tuple of RegionResult
        All regions, in the order of the request.
    pairs : tuple of ImagePair
        In the order of the request.
    neighbours : NeighbourEvaluation or None
        From pixel to pixel.
    warnings : tuple of str
        What to mind.
    """

    path: Path
    sha256: str
    shape: tuple[int, int]
    unit: str
    exposure_s: float | None
    camera: str | None
    notes: tuple[str, ...]
    regions: tuple[RegionResult, ...]
    pairs: tuple[ImagePair, ...]
    neighbours: NeighbourEvaluation | None
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        return {
            "file": str(self.path),
            "sha256": self.sha256,
            "width": self.shape[1],
            "height": self.shape[0],
            "unit": self.unit,
            "exposure_s": self.exposure_s,
            "camera": self.camera,
            "notes": list(self.notes),
            "regions": [_region_values(region) for region in self.regions],
            "pairs": [pair.to_dict() for pair in self.pairs],
            "neighbours": None if self.neighbours is None else self.neighbours.to_dict(),
            "warnings": list(self.warnings),
        }


def _region_values(region: RegionResult) -> dict[str, Any]:
    return {
        "name": region.roi.name,
        "pixels": region.n_pixels,
        "mean": region.mean,
        "mean_standard_uncertainty": region.standard_uncertainty,
        "std": region.std,
        "snr": region.snr.value,
        "snr_standard_uncertainty": region.snr.standard_error,
        "invalid_shares": dict(region.invalid_shares),
    }


def evaluate_image(
    picture: Picture, luminance: LuminanceMap, unit: str, request: ImageRequest, warnings: Sequence[str] = ()
) -> ImageEvaluation:
    """Evaluate a picture.

    Parameters
    ----------
    picture : Picture
        The picture.
    luminance : LuminanceMap
        What it was converted to.
    unit : str
        Unit of that.
    request : ImageRequest
        What is asked.
    warnings : sequence of str
        Of the conversion.

    Raises
    ------
    InputError
        As `evaluate_pair` and `evaluate_neighbours`.
    """
    rois = {roi.name: roi for roi in request.rois}
    pairs = [_pair(luminance, rois[a], rois[b], request.contrasts, request.epsilon) for a, b in request.chosen_pairs]
    evaluated = {region.roi.name: region for pair in pairs for region in (pair.result.a, pair.result.b)}
    regions = [evaluated.get(name) or evaluate_region(luminance, roi) for name, roi in rois.items()]
    neighbours = None
    if request.neighbours:
        neighbours = evaluate_neighbours(luminance, request.contrasts, request.epsilon, request.rectangle)
    swapped = [
        f"region {pair.result.b.roi.name!r} is brighter than {pair.result.a.roi.name!r}, which was given as the bright "
        "one"
        for pair in pairs
        if request.pairs is not None and pair.result.bright == "b"
    ]
    of_pairs = [warning for pair in pairs for warning in pair.result.warnings]
    frame = picture.frame
    simulated = ["the camera is simulated"] if frame is not None and frame.camera.simulated else []
    return ImageEvaluation(
        path=picture.path,
        sha256=picture.sha256,
        shape=picture.shape,
        unit=unit,
        exposure_s=frame.exposure_s if frame is not None and picture.exposure_known else None,
        camera=str(frame.camera) if frame is not None and picture.camera_stated else None,
        notes=picture.notes,
        regions=tuple(regions),
        pairs=tuple(pairs),
        neighbours=neighbours,
        warnings=tuple(dict.fromkeys([*simulated, *warnings, *swapped, *of_pairs])),
    )


def _pair(luminance: LuminanceMap, a: Roi, b: Roi, contrasts: Sequence[float], epsilon: Epsilon) -> ImagePair:
    result = evaluate_pair(luminance, a, b, contrasts, epsilon)
    first, second = (luminance.select(roi).astype(np.float64) for roi in (a, b))
    return ImagePair(result, _distribution(first, second, max(one.result.interval[1] for one in result.results)))


def _distribution(a: NDArray[np.float64], b: NDArray[np.float64], highest: float) -> ContrastDistribution | None:
    """Distribution of the contrasts, with bars no wider than what is of interest up to the `highest` contrast."""
    try:
        found = contrast_distribution(a, b, _N_BINS)
    except InputError:
        # No dark pixel is above 0.
        return None
    first, last = float(found.edges[0]), _MOST_TIMES * highest
    if not first < last < found.edges[-1]:
        return found
    return contrast_distribution(a, b, np.linspace(max(first, -1.0), last, _N_BINS + 1))
