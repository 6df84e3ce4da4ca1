"""How well the colours of regions can be told apart in a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.quantity import Quantity
from ...core.result import Finding, warning
from ...core.roi import Roi
from ...metrics.colour import ColourRegion, ColourSeparation, chromaticity, separation
from ...metrics.region import SATURATED_SHARE

if TYPE_CHECKING:
    from xarray import Dataset

#: Pixels of a region that are drawn.
_DRAWN = 1500
_Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SeenColours:
    """Colours of a region, which may be too few, saturated or without noise.

    Parameters
    ----------
    name : str
        Its name.
    pixels : ndarray of float, shape (n, planes)
        Values of its pixels.
    mask : ndarray of bool, shape (height, width)
        Where they are in its bounding box.
    saturated_share : float
        Share of them that are saturated in a plane.
    """

    name: str
    pixels: _Array
    mask: NDArray[np.bool_]
    saturated_share: float


@dataclass(frozen=True, eq=False)
class Colours:
    """Linear values of the planes of a picture.

    Parameters
    ----------
    values : ndarray of float, shape (height, width, planes)
        Values of each pixel, or of each cell of 2 x 2 pixels of a colour filter.
    names : tuple of str
        Names of the planes.
    saturated : ndarray of bool, shape (height, width)
        Pixels of which a plane is saturated.
    step : int
        Pixels of the picture from one to the next: 2 of a colour filter.
    """

    values: NDArray[np.floating[Any]]
    names: tuple[str, ...]
    saturated: NDArray[np.bool_]
    step: int

    def region(self, roi: Roi) -> SeenColours:
        """Return the colours of a region; raises InputError if it lies outside the picture."""
        height, width = self.saturated.shape
        roi.window((self.step * height, self.step * width))
        scaled = roi.divided(self.step)
        window, mask = scaled.window((height, width)), scaled.mask((height, width))
        pixels = np.asarray(self.values[window][mask], dtype=np.float64)
        return SeenColours(roi.name, pixels, mask, float(np.mean(self.saturated[window][mask])))


@dataclass(frozen=True, eq=False)
class Cloud:
    """Pixels of a region in two coordinates, to be drawn.

    Parameters
    ----------
    name : str
        Name of the region.
    points : ndarray of float, shape (n, 2)
        Some of its pixels, evenly spread over it.
    mean : ndarray of float, shape (2,)
        Mean of all.
    covariance : ndarray of float, shape (2, 2)
        Covariance of all.
    """

    name: str
    points: _Array
    mean: _Array
    covariance: _Array


@dataclass(frozen=True, eq=False)
class PairColours:
    """Colours of two regions, and how well they can be told apart.

    Parameters
    ----------
    first, second : Cloud
        Pixels of the regions, in the first two chromaticities; with two planes, in the values themselves.
    axes : (str, str)
        What the coordinates are.
    separation : ColourSeparation
        The separation; nan where a region is saturated.
    saturated : bool
        Whether a region is.
    """

    first: Cloud
    second: Cloud
    axes: tuple[str, str]
    separation: ColourSeparation
    saturated: bool

    @property
    def name(self) -> str:
        """Names of both regions."""
        return f"{self.first.name} / {self.second.name}"


def measure_colours(
    colours: Colours, rois: Sequence[Roi], pairs: Sequence[tuple[str, str]], epsilon: float
) -> tuple[PairColours, ...]:
    """Separate the colours of pairs of regions.

    Parameters
    ----------
    colours : Colours
        The picture.
    rois : sequence of Roi
        Its regions.
    pairs : sequence of (str, str)
        Names of their pairs.
    epsilon : float
        Relative tolerance of the difference of chromaticity.

    Raises
    ------
    InputError
        If a region lies outside the picture.
    """
    regions = {roi.name: colours.region(roi) for roi in rois}
    clouds = {name: _cloud(seen) for name, seen in regions.items()}
    axes, measured = _axes(colours.names), []
    for first, second in pairs:
        result, saturated = separated([regions[first], regions[second]], len(colours.names), epsilon)
        measured.append(PairColours(clouds[first], clouds[second], axes, result, saturated))
    return tuple(measured)


def separated(pair: Sequence[SeenColours], planes: int, epsilon: float) -> tuple[ColourSeparation, bool]:
    """Separate the colours of two regions; nan, with a finding, where they cannot be compared.

    Returns
    -------
    (ColourSeparation, bool)
        The separation, and whether a region is saturated.
    """
    fullest = max(pair, key=lambda seen: seen.saturated_share)
    if fullest.saturated_share > SATURATED_SHARE:
        finding = warning("colours-saturated", fullest.name, share=fullest.saturated_share)
        return _unknown(planes, epsilon, finding), True
    try:
        first, second = (ColourRegion(seen.name, seen.pixels, seen.mask) for seen in pair)
        return separation(first, second, epsilon), False
    except InputError as error:
        # Of other pairs, and of the contrast of this one, it takes nothing.
        finding = warning("colours-not-measured", " / ".join(seen.name for seen in pair), reason=str(error))
        return _unknown(planes, epsilon, finding), False


def _unknown(planes: int, epsilon: float, finding: Finding) -> ColourSeparation:
    """Return a separation without values: what clips the noise of a plane tells colours apart that are not."""
    unknown = Quantity(nan, nan)
    return ColourSeparation(unknown, unknown, unknown, nan, np.full(planes, nan), unknown, epsilon, findings=(finding,))


def _axes(names: tuple[str, ...]) -> tuple[str, str]:
    if len(names) == 2:
        return names[0], names[1]
    total = "+".join(names)
    return f"{names[0]} / ({total})", f"{names[1]} / ({total})"


def _cloud(seen: SeenColours) -> Cloud:
    name, pixels = seen.name, seen.pixels
    values = pixels if pixels.shape[1] == 2 else chromaticity(pixels)[:, :2]
    defined = values[np.isfinite(values[:, 0])]
    if len(defined) < 2:
        return Cloud(name, np.empty((0, 2)), np.full(2, nan), np.full((2, 2), nan))
    shown = defined[np.unique(np.linspace(0, len(defined) - 1, _DRAWN).astype(int))]
    return Cloud(name, shown, defined.mean(axis=0), np.cov(defined, rowvar=False))


def colour_dataset(pairs: Sequence[PairColours], attributes: dict[str, Any]) -> Dataset:
    """Return the separation of pairs of regions, over pair."""
    from xarray import Dataset

    data: dict[str, Any] = {}
    quantities = {
        "colour_distance": ("distance", "Mahalanobis distance of the colours"),
        "csp": ("csp", "colour separation probability, pooled covariance"),
        "csp_counted": ("csp_counted", "share of pixels nearer to their own region, covariances of their own"),
        "colours_detected": ("detected", "share of the pairs of pixels that keep the difference of chromaticity"),
    }
    for name, (attribute, meaning) in quantities.items():
        values: list[Quantity] = [getattr(pair.separation, attribute) for pair in pairs]
        data[name] = ("pair", [value.value for value in values], {"long_name": meaning, "units": "1"})
        for end, what in (("low", "lower"), ("high", "upper")):
            ends = [getattr(value.interval, end) for value in values]
            data[f"{name}_{end}"] = ("pair", ends, {"long_name": f"{what} end of its 95 % interval", "units": "1"})
        data[f"u_{name}"] = ("pair", [value.u for value in values], {"long_name": "standard uncertainty", "units": "1"})
    return Dataset(data, {"pair": [pair.name for pair in pairs]}, attributes)
