"""Charts: patches of stated values, and where they are in a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite, log
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.disk.files import quoted, shortened
from ..core.errors import InputError
from ..core.quantity import Quantity
from ..core.roi import Roi

#: What the values of the patches of a chart are.
ChartQuantity: TypeAlias = Literal["luminance_cd_m2", "density", "reflectance"]
#: Corners of a chart in a picture: upper left, upper right, lower right, lower left, as the chart is read.
Corners: TypeAlias = Sequence[tuple[float, float]]

#: Share of a patch that is left out at each side: blur and misplaced corners reach into it.
MARGIN = 0.2
_Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChartPatch:
    """A patch of a chart.

    Parameters
    ----------
    roi : Roi
        Its name and outline, in the unit of the chart.
    value : float or None
        Its stated luminance in cd/m², density or reflectance; None if it is not stated.
    u : float
        Standard uncertainty of the value; nan if it is not known.
    black : bool
        Whether it shows no light of its own, such as the opening of a box that is black inside: what a camera sees
        there is veiling glare.
    """

    roi: Roi
    value: float | None = None
    u: float = float("nan")
    black: bool = False


@dataclass(frozen=True)
class ChartMark:
    """A square mark of the dictionary ArUco 4x4_50, by which a chart is found in a picture.

    Parameters
    ----------
    number : int
        Its number in the dictionary, 0 to 49.
    x, y : float
        Its upper left corner, in the unit of the chart.
    side : float
        Length of its black square.
    """

    number: int
    x: float
    y: float
    side: float

    @property
    def corners(self) -> _Array:
        """Upper left, upper right, lower right and lower left corner, shape (4, 2)."""
        return np.array([self.x, self.y]) + self.side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@dataclass(frozen=True)
class Chart:
    """Patches of stated values.

    Parameters
    ----------
    name : str
        Name of the chart.
    width, height : float
        Size, in a unit of the user's choice.
    patches : tuple of ChartPatch
        At least two, in that unit from the upper left corner.
    quantity : {'luminance_cd_m2', 'density', 'reflectance'}
        What their values are.
    white_cd_m2 : Quantity or None
        Luminance of density 0 or reflectance 1; None if it is not known: the luminances are then relative.
    marks : tuple of ChartMark
        By which it is found.
    margin : float
        Share of each patch that is left out at each side, 0 or more and below 0.5.

    Raises
    ------
    InputError
        If there are fewer than two patches, two have one name, a value is not possible, or the margin leaves nothing.

    Examples
    --------
    >>> from labcdp.core.roi import Roi
    >>> steps = [ChartPatch(Roi.rectangle(str(n), 10 * n, 0, 10, 10), 0.3 * n) for n in range(3)]
    >>> chart = Chart("steps", 30, 10, tuple(steps), "density")
    >>> [round(value.value, 2) for value in chart.luminances().values()]
    [1.0, 0.5, 0.25]
    """

    name: str
    width: float
    height: float
    patches: tuple[ChartPatch, ...]
    quantity: ChartQuantity = "luminance_cd_m2"
    white_cd_m2: Quantity | None = None
    marks: tuple[ChartMark, ...] = ()
    margin: float = MARGIN

    def __post_init__(self) -> None:
        if len(self.patches) < 2:
            raise InputError(f"chart {quoted(self.name)} has {len(self.patches)} patches: give two or more")
        names = self.names
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise InputError(f"two patches of the chart are called {quoted(min(twice))}: give each its own name")
        if not (self.width > 0 and self.height > 0):
            raise InputError(f"the chart is {self.width:g} x {self.height:g}: give a width and a height above 0")
        if not 0 <= self.margin < 0.5:
            raise InputError(f"margin is {self.margin:g}: give a share of each patch of at least 0 and below 0.5")
        for patch in self.patches:
            if patch.value is not None and not _possible(patch.value, self.quantity):
                raise InputError(
                    f"the {self.quantity} of patch {quoted(patch.roi.name)} is {patch.value:g}: give "
                    f"{'a number' if self.quantity == 'density' else 'a number above 0'}"
                )

    @property
    def unit(self) -> str:
        """Unit of `luminances`: ``cd/m²``, or ``relative``."""
        return "relative" if self.quantity != "luminance_cd_m2" and self.white_cd_m2 is None else "cd/m²"

    @property
    def u_white_rel(self) -> float:
        """Relative standard uncertainty that all `luminances` have in common; 0 for luminances that are stated."""
        return 0.0 if self.quantity == "luminance_cd_m2" or self.white_cd_m2 is None else self.white_cd_m2.u_rel

    @property
    def is_stated(self) -> bool:
        """Whether all patches but black ones have a value."""
        return all(patch.value is not None for patch in self.patches if not patch.black)

    @property
    def names(self) -> list[str]:
        """Names of the patches, in their order."""
        return [patch.roi.name for patch in self.patches]

    @property
    def neighbouring_pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of patches next to each other in stated luminance, the brighter one first; else in their order."""
        names = [patch.roi.name for patch in self.patches if not patch.black]
        if not self.is_stated:
            return tuple(pairwise(names))
        stated = {name: luminance.value for name, luminance in self.luminances().items()}
        ordered = sorted(names, key=lambda name: -stated[name])
        return tuple((a, b) for a, b in pairwise(ordered) if stated[a] > stated[b])

    def contrast(self, bright: str, dark: str) -> float | None:
        """Return the Weber contrast of two patches by their stated values; None if that is not known or above 0."""
        stated = self.luminances()
        if bright not in stated or dark not in stated:
            return None
        contrast = stated[bright].value / stated[dark].value - 1
        return contrast if contrast > 0 else None

    def with_values(self, values: Mapping[str, tuple[float, float]]) -> Chart:
        """Return the chart with values and their standard uncertainties by the names of patches.

        Raises
        ------
        InputError
            If there is no patch of a name.
        """
        for name in values:
            if name not in self.names:
                raise InputError(
                    f"the chart has no patch {quoted(name)}, only {shortened(', '.join(self.names))}: correct the name"
                )
        stated = [
            replace(patch, value=values[patch.roi.name][0], u=values[patch.roi.name][1])
            if patch.roi.name in values
            else patch
            for patch in self.patches
        ]
        return replace(self, patches=tuple(stated))

    def luminances(self) -> dict[str, Quantity]:
        """Stated luminances by the names of patches, in `unit`, of the patches that have one.

        Notes
        -----
        L = L_white 10^-D of a density D, and L_white times a reflectance, with the law of propagation (JCGM 100:2008,
        5.1.2). That of white is common to all patches: it is part of each u, and cancels in their contrasts.
        """
        white = self.white_cd_m2 or Quantity(1.0, 0.0)
        stated = {}
        for patch in self.patches:
            if patch.value is None:
                continue
            value, u_rel = patch.value, patch.u / abs(patch.value) if patch.value else 0.0
            if self.quantity == "density":
                value, u_rel = 10**-patch.value, log(10) * patch.u
            if self.quantity != "luminance_cd_m2":
                value, u_rel = value * white.value, float(np.hypot(u_rel, white.u_rel))
            stated[patch.roi.name] = Quantity(value, value * u_rel, self.unit)
        return stated

    def regions(self, corners: Corners) -> tuple[Roi, ...]:
        """Return the patches in a picture, less `margin`, in perspective.

        Parameters
        ----------
        corners : sequence of four (x, y)
            Upper left, upper right, lower right and lower left corner of the chart in pixels, as the chart is read.

        Raises
        ------
        InputError
            If these are no corners of a convex quadrilateral.

        Examples
        --------
        >>> from labcdp.core.roi import Roi
        >>> halves = [ChartPatch(Roi.rectangle(name, x, 0, 1, 1)) for x, name in enumerate("ab")]
        >>> chart = Chart("two", 2, 1, tuple(halves), margin=0.0)
        >>> second = chart.regions([(0, 0), (200, 0), (200, 100), (0, 100)])[1]
        >>> [abs(round(edge, 6)) for edge in second.bounds]
        [100.0, 0.0, 200.0, 100.0]
        """
        points = np.array(corners, dtype=np.float64)
        if points.shape != (4, 2) or not np.isfinite(points).all() or not _is_convex(points):
            raise InputError(
                "the corners of the chart are no quadrilateral: give upper left, upper right, lower right and lower "
                "left in pixels"
            )
        outline = [(0.0, 0.0), (self.width, 0.0), (self.width, self.height), (0.0, self.height)]
        return self._projected(perspective(outline, points))

    def found(self, grey: NDArray[Any]) -> tuple[Roi, ...]:
        """Return the patches in a picture in which the marks of the chart are seen, less `margin`.

        Parameters
        ----------
        grey : ndarray, shape (height, width)
            Picture, of any range of values.

        Raises
        ------
        InputError
            If the chart has no marks, or fewer than two of them are seen.
        """
        if not self.marks:
            raise InputError(
                f"chart {quoted(self.name)} has no marks: give its corners in the picture, or a file of regions with "
                "the names of its patches"
            )
        seen = seen_marks(grey)
        there = [mark for mark in self.marks if mark.number in seen]
        if len(there) < min(2, len(self.marks)):
            raise InputError(
                f"{len(there)} of the {len(self.marks)} marks of chart {quoted(self.name)} are seen in the picture: "
                "give its corners in the picture"
            )
        return self._projected(
            perspective(
                np.concatenate([mark.corners for mark in there]), np.concatenate([seen[mark.number] for mark in there])
            )
        )

    def _projected(self, matrix: _Array) -> tuple[Roi, ...]:
        rois = []
        for patch in self.patches:
            corners = np.array(patch.roi.corners)
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
            x, y, w = matrix @ np.vstack(
                [((1 - 2 * self.margin) * (corners - middle) + middle).T, np.ones(len(corners))]
            )
            rois.append(Roi(patch.roi.name, tuple(zip((x / w).tolist(), (y / w).tolist(), strict=True))))
        return tuple(rois)


def perspective(outline: ArrayLike, image: ArrayLike) -> _Array:
    """Return the 3 x 3 matrix of the perspective from points of a plane to those of a picture, by least squares.

    Parameters
    ----------
    outline, image : array_like of float, shape (n, 2)
        Four points or more of the plane, and where they are in the picture.

    Notes
    -----
    Direct linear transformation with normalised points (R. Hartley and A. Zisserman, Multiple View Geometry, 2004,
    algorithm 4.2): exact for four points.

    Examples
    --------
    >>> square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    >>> matrix = perspective(square, [(10, 20), (30, 20), (30, 40), (10, 40)])
    >>> abs(matrix.round(6)).tolist()
    [[20.0, 0.0, 10.0], [0.0, 20.0, 20.0], [0.0, 0.0, 1.0]]
    """
    (source, from_source), (target, from_target) = (
        _normalised(np.asarray(p, dtype=np.float64)) for p in (outline, image)
    )
    (x, y), (u, v), one, zero = source.T, target.T, np.ones(len(source)), np.zeros((3, len(source)))
    plane = np.array([x, y, one])
    rows = np.vstack([np.vstack([plane, zero, -u * plane]).T, np.vstack([zero, plane, -v * plane]).T])
    solved = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    projected = np.linalg.inv(from_target) @ solved @ from_source
    matrix: _Array = projected / projected[2, 2]
    return matrix


def _normalised(points: _Array) -> tuple[_Array, _Array]:
    """Points about their middle at a mean distance of about 1, and the matrix that makes them of the given ones."""
    middle = points.mean(axis=0)
    scale = 1 / max(float(np.abs(points - middle).mean()), 1e-300)
    matrix = np.array([[scale, 0, -scale * middle[0]], [0, scale, -scale * middle[1]], [0, 0, 1.0]])
    return (points - middle) * scale, matrix


def seen_marks(grey: NDArray[Any]) -> dict[int, _Array]:
    """Return the corners, shape (4, 2) in pixels, of the ArUco marks (4x4_50) that are seen in a picture, by number."""
    import cv2

    values = np.asarray(grey, dtype=np.float64)
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, (0.5, 99.5)) if finite.size else (0.0, 1.0)
    # As an eye sees it: marks may be much darker than the brightest patches of a chart.
    light = np.clip((np.nan_to_num(values) - low) / max(high - low, 1e-300), 0, 1)
    seen: dict[int, _Array] = {}
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    for gamma in (1.0, 0.45, 0.2):
        corners, numbers, _ = detector.detectMarkers((255 * light**gamma).astype(np.uint8))
        for quadrilateral, number in zip(corners, [] if numbers is None else numbers.ravel().tolist(), strict=True):
            # The centre of the first pixel is at (0.5, 0.5) here.
            seen.setdefault(int(number), quadrilateral.reshape(4, 2).astype(np.float64) + 0.5)
    return seen


def _possible(value: float, quantity: ChartQuantity) -> bool:
    return isfinite(value) and (value > 0 or quantity == "density")


def _is_convex(points: _Array) -> bool:
    sides = np.roll(points, -1, axis=0) - points
    after = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    return bool((turns > 0).all() or (turns < 0).all())
