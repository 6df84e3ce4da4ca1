"""Shapes the user draws or a file holds, and the polygons they stand for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from math import ceil, cos, pi, radians, sin, sqrt
from numbers import Real
from typing import ClassVar, TypeAlias

from ..core.disk.files import MOST_QUOTED, quoted
from ..core.errors import InputError
from ..core.roi import Roi
from .geometry import require_simple

#: Largest distance of an ellipse from the polygon that stands for it, in pixels, and the most corners that has.
_SAGITTA_PX = 0.01
_MOST_CORNERS_OF_ELLIPSE = 4096

#: More regions, corners of one, or corners of all, are refused; coordinates beyond any image, too.
MOST_REGIONS = 10_000
_MOST_CORNERS, _MOST_CORNERS_OF_ALL = 100_000, 2_000_000
_MOST_PX = 1e7

_Corner: TypeAlias = tuple[float, float]
#: Lowest and highest permitted luminance of a region in cd/m^2.
Limits: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class _Named:
    """Base of all shapes, which converts parameters to numbers or refuses them, naming the key."""

    name: str
    limits_cd_m2: Limits | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        name: object = self.name
        if not (isinstance(name, str) and 0 < len(name) <= MOST_QUOTED and name == name.strip() and name.isprintable()):
            raise InputError(
                f"the name of a region is {quoted(name)}: give 1 to {MOST_QUOTED} printable characters, without spaces "
                "at its ends"
            )
        for parameter in fields(self):
            if parameter.type == "float":
                object.__setattr__(self, parameter.name, self._number(parameter.name, getattr(self, parameter.name)))
        if self.limits_cd_m2 is not None:
            low, high = self._pair("limits_cd_m2", self.limits_cd_m2, "two numbers [low, high]")
            if not 0 <= low < high:
                raise self._error("limits_cd_m2", f"[{low:g}, {high:g}]", "0 <= low < high")
            object.__setattr__(self, "limits_cd_m2", (low, high))

    def _error(self, key: str, value: str, wanted: str) -> InputError:
        return InputError(f"region {quoted(self.name)}: {key} is {value}: give {wanted}")

    def _number(self, key: str, value: object) -> float:
        with suppress(OverflowError):
            if not isinstance(value, bool) and isinstance(value, Real) and abs(number := float(value)) <= _MOST_PX:
                return number
        raise self._error(key, quoted(value), f"a number from {-_MOST_PX:g} to {_MOST_PX:g}")

    def _pair(self, key: str, values: object, wanted: str) -> tuple[float, float]:
        if not (isinstance(values, Sequence) and not isinstance(values, str) and len(values) == 2):
            raise self._error(key, quoted(values), wanted)
        return self._number(f"{key}[0]", values[0]), self._number(f"{key}[1]", values[1])


@dataclass(frozen=True)
class PolygonShape(_Named):
    """A polygon.

    Parameters
    ----------
    name : str
        Name of the region in messages and tables.
    corners : tuple of (float, float)
        At least three (x, y) corners in pixels, in order around the region.
    limits_cd_m2 : (float, float) or None
        Lowest and highest permitted mean luminance; None for no limits.

    Raises
    ------
    InputError
        If the name or a corner cannot be used.

    Examples
    --------
    >>> from labcdp.regions import PolygonShape
    >>> (roof,) = PolygonShape("roof", ((0, 10), (20, 10), (10, 0))).rois()
    >>> roof.area
    100.0
    """

    kind: ClassVar[str] = "polygon"
    corners: tuple[_Corner, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.corners
        if not (isinstance(given, Sequence) and 3 <= len(given) <= _MOST_CORNERS):
            raise self._error("corners", quoted(given), f"a list of 3 to {_MOST_CORNERS} [x, y] corners")
        corners = (self._pair(f"corners[{at}]", corner, "the two numbers [x, y]") for at, corner in enumerate(given))
        object.__setattr__(self, "corners", tuple(corners))

    def rois(self) -> tuple[Roi, ...]:
        """Return the polygon as the one region."""
        return (Roi(self.name, self.corners),)


@dataclass(frozen=True)
class CompositeShape(PolygonShape):
    """A region of several parts, or with holes, as ImageJ's wand and its combinations make them.

    One line leads around all parts; from one to the next and back it passes the same way, and parts may touch. Pixels
    belong to the region by the even-odd rule.
    """

    kind: ClassVar[str] = "composite"


@dataclass(frozen=True)
class _Box(_Named):
    """Base of rectangles, ellipses and grids, which have a box."""

    x: float
    y: float
    width: float
    height: float

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("width", "height"):
            if not getattr(self, key) > 0:
                raise self._error(key, f"{getattr(self, key):g}", "a number of pixels above 0")


@dataclass(frozen=True)
class _TurnedBox(_Box):
    """Base of rectangles and ellipses, whose box may be turned about its middle."""

    angle_deg: float = 0.0

    def _turned(self, corners: Iterable[_Corner]) -> tuple[_Corner, ...]:
        """Return image coordinates of corners given relative to the middle of the unturned box."""
        angle = radians(self.angle_deg)
        c, s = cos(angle), sin(angle)
        x, y = self.x + self.width / 2, self.y + self.height / 2
        return tuple((x + c * dx - s * dy, y + s * dx + c * dy) for dx, dy in corners)


@dataclass(frozen=True)
class RectangleShape(_TurnedBox):
    """A rectangle, upright or turned.

    Parameters
    ----------
    name : str
        Name of the region in messages and tables.
    x, y : float
        Upper left corner before the rectangle is turned, in pixels; an image begins at (0, 0).
    width, height : float
        Size in pixels.
    angle_deg : float
        Turn about its middle, clockwise as the image is seen (from x to y), in degrees.
    limits_cd_m2 : (float, float) or None
        As of `PolygonShape`.

    Raises
    ------
    InputError
        If the name cannot be used, a number is not finite, or width or height is not positive.

    Examples
    --------
    >>> from labcdp.regions import RectangleShape
    >>> (sign,) = RectangleShape("sign", 40, 20, 10, 8).rois()
    >>> sign.bounds
    (40.0, 20.0, 50.0, 28.0)
    """

    kind: ClassVar[str] = "rectangle"

    def rois(self) -> tuple[Roi, ...]:
        """Return the rectangle as the one region."""
        if self.angle_deg == 0:
            # Not through the middle: a corner on a pixel's edge stays exactly there.
            return (Roi.rectangle(self.name, self.x, self.y, self.width, self.height),)
        a, b = self.width / 2, self.height / 2
        return (Roi(self.name, self._turned(((-a, -b), (a, -b), (a, b), (-a, b)))),)


@dataclass(frozen=True)
class EllipseShape(_TurnedBox):
    """An ellipse that fills a box; parameters and errors are those of `RectangleShape` for the box.

    Examples
    --------
    >>> from labcdp.regions import EllipseShape
    >>> (lamp,) = EllipseShape("lamp", 40, 20, 10, 10).rois()
    >>> round(lamp.area, 1)
    78.3
    """

    kind: ClassVar[str] = "ellipse"

    def rois(self) -> tuple[Roi, ...]:
        """Return the ellipse as the one region: a polygon with corners on it, no edge 0.01 pixels from it."""
        a, b = self.width / 2, self.height / 2
        # The edge over an angle of 2 pi / n stays within a (1 - cos(pi / n)) of the arc. A multiple of 4, so that the
        # region reaches the sides of its box.
        n = 4 * ceil(pi * sqrt(max(a, b) / (2 * _SAGITTA_PX)) / 4)
        n = max(16, min(n, _MOST_CORNERS_OF_ELLIPSE))
        angles = (2 * pi * i / n for i in range(n))
        return (Roi(self.name, self._turned((a * cos(t), b * sin(t)) for t in angles)),)


@dataclass(frozen=True)
class GridShape(_Box):
    """Rows and columns of equal upright rectangles; they are called NAME-r1c1, NAME-r1c2 and so on.

    Parameters
    ----------
    name : str
        Start of the names of the regions.
    x, y : float
        Upper left corner of the whole grid in pixels.
    width, height : float
        Size of the whole grid in pixels.
    rows, columns : int
        Numbers of rows and columns of rectangles.
    gap : float
        Distance between neighbouring rectangles in pixels.
    limits_cd_m2 : (float, float) or None
        As of `PolygonShape`, of each rectangle.

    Raises
    ------
    InputError
        If the name cannot be used, a number is out of its range, or the gaps leave nothing of the rectangles.

    Examples
    --------
    >>> from labcdp.regions import GridShape
    >>> [roi.name for roi in GridShape("chart", 0, 0, 60, 40, rows=1, columns=3).rois()]
    ['chart-r1c1', 'chart-r1c2', 'chart-r1c3']
    """

    kind: ClassVar[str] = "grid"
    angle_deg: ClassVar[float] = 0.0
    rows: int
    columns: int
    gap: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("rows", "columns"):
            value: object = getattr(self, key)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise self._error(key, quoted(value), "a whole number of at least 1")
        if self.rows * self.columns > MOST_REGIONS:
            raise InputError(
                f"region {quoted(self.name)}: {self.rows} rows of {self.columns} columns are "
                f"{self.rows * self.columns} regions: give at most {MOST_REGIONS}"
            )
        if self.gap < 0:
            raise self._error("gap", f"{self.gap:g}", "at least 0 pixels")
        if not min(self._cell) > 0:
            raise InputError(
                f"region {quoted(self.name)}: gaps of {self.gap:g} pixels leave nothing of {self.rows} x "
                f"{self.columns} rectangles in {self.width:g} x {self.height:g} pixels: give a smaller gap"
            )

    @property
    def _cell(self) -> tuple[float, float]:
        return (
            (self.width - self.gap * (self.columns - 1)) / self.columns,
            (self.height - self.gap * (self.rows - 1)) / self.rows,
        )

    def rois(self) -> tuple[Roi, ...]:
        """Return the rectangles, row by row."""
        return tuple(self._rectangle(row, column) for row in range(self.rows) for column in range(self.columns))

    def _rectangle(self, row: int, column: int) -> Roi:
        width, height = self._cell
        x, y = self.x + column * (width + self.gap), self.y + row * (height + self.gap)
        return Roi.rectangle(f"{self.name}-r{row + 1}c{column + 1}", x, y, width, height)


Shape: TypeAlias = PolygonShape | RectangleShape | EllipseShape | GridShape


def rois_of(shapes: Iterable[Shape]) -> tuple[Roi, ...]:
    """Return the regions of shapes, in their order.

    Raises
    ------
    InputError
        If there is none, there are more than 10 000 or they have more than 2 000 000 corners, two have the same name,
        or one crosses itself or has no area.

    Examples
    --------
    >>> from labcdp.regions import GridShape, RectangleShape, rois_of
    >>> shapes = RectangleShape("sky", 0, 0, 9, 9), GridShape("chart", 0, 20, 60, 20, rows=1, columns=2)
    >>> [roi.name for roi in rois_of(shapes)]
    ['sky', 'chart-r1c1', 'chart-r1c2']
    """
    rois: list[Roi] = []
    drawn: set[str] = set()
    n_corners = 0
    for shape in shapes:
        shape_rois = shape.rois()
        if shape.kind == "polygon":
            drawn.add(shape.name)
        rois.extend(shape_rois)
        n_corners += sum(len(roi.corners) for roi in shape_rois)
        if len(rois) > MOST_REGIONS or n_corners > _MOST_CORNERS_OF_ALL:
            raise InputError(
                f"there are more than {MOST_REGIONS} regions, or more than {_MOST_CORNERS_OF_ALL} corners (a large "
                "ellipse has thousands): give fewer"
            )
    if not rois:
        raise InputError("there is no region: give at least one")
    name, times = Counter(roi.name for roi in rois).most_common(1)[0]
    if times > 1:
        raise InputError(f"{times} regions have the name {quoted(name)}: give each its own")
    for roi in rois:
        # An ellipse's polygon of thousands of corners need not be looked at for crossings, as long as it has an area.
        if len(roi.corners) <= 4 or roi.area == 0 or roi.name in drawn:
            require_simple(roi)
    return tuple(rois)
