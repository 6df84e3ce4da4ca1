"""LuminanceMap: luminance of each pixel with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntFlag
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from .errors import InputError
from .result import html_table, number
from .roi import Roi

#: Standard deviations of its noise a pixel may lie beyond the calibrated range.
RANGE_MARGIN = 3.0


class Invalid(IntFlag):
    """Why a pixel of a luminance map is not valid; 0 means it is."""

    SATURATED = 1
    BELOW_BLACK = 2
    OUTSIDE_CALIBRATED = 4
    DEFECT = 8
    INCONSISTENT = 16


@dataclass(frozen=True, eq=False)
class CommonError:
    """An error that all pixels share: one unknown number, times a known pattern.

    Parameters
    ----------
    source : str
        Where it comes from, as a budget names it (``meter scale``, ``fit``, ``dark and temperature``).
    relative : ndarray of float, shape (height, width), or float
        Signed relative error of the luminance for one standard uncertainty of that number.
    rectangular : bool
        True if the number is distributed evenly between limits (sqrt 3 standard uncertainties), False for normal.
    dof : float
        Degrees of freedom of the standard uncertainty; infinite if it is known.
    smooth : bool
        True if it hardly changes within a region: of a region, its mean counts.
    """

    source: str
    relative: NDArray[np.floating[Any]] | float
    rectangular: bool = False
    dof: float = inf
    smooth: bool = False


#: Rows and columns of a map.
Window = tuple[slice, slice]
#: All of them.
WHOLE: Window = (slice(None), slice(None))


class LuminanceMap:
    """Luminance for each pixel, with its uncertainty and the reasons why a pixel is not valid.

    Uncertainties are standard uncertainties. Maps of frames are made by subclasses, which compute all but the luminance
    where it is asked for: the luminance of a frame takes little longer than reading it.

    Parameters
    ----------
    luminance_cd_m2 : ndarray of float32 or float64, shape (height, width)
        Luminance; also given for pixels that are not valid.
    random_rel : ndarray of float, shape (height, width)
        Relative uncertainty that differs from pixel to pixel (noise, pixel pattern), as a fraction.
    common : tuple of CommonError, or float, or ndarray of float, shape (height, width)
        Errors that all pixels share and that are independent of each other; patterns have the map's shape. A number or
        an array is one error.
    invalid : ndarray of uint8, shape (height, width)
        `Invalid` flags, 0 where the pixel is valid.
    slow_rel : float
        Relative uncertainty of slow changes across the image (flat field): alike for near pixels, independent for far
        ones, so it neither averages down in a region nor cancels between regions.
    slow_cd_m2 : float or ndarray of float, shape (height, width)
        The same for changes that are not in parts of the luminance (dark signal).
    fixed_rel : float
        Part of `random_rel` that is the same in every frame (sensitivity of the pixel, or noise of the flat field):
        several frames do not average it down.
    fixed_cd_m2 : float or ndarray of float, shape (height, width)
        The same for what is not in parts of the luminance (noise of a dark library), in addition to `fixed_rel`.
    step : int
        Image pixels, along each side, that one pixel of the map stands for; 2 for maps of Bayer frames.

    Raises
    ------
    InputError
        If the arrays are not of one 2-D shape.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> import labcdp
    >>> written = cv2.imwrite("grey.png", np.full((20, 30), 100, np.uint8))
    >>> luminance = labcdp.read_image("grey.png", encoding="linear").luminance
    >>> luminance.shape, int(luminance.invalid.max())
    ((20, 30), 0)
    """

    # Of subclasses that have no such errors.
    slow_rel = fixed_rel = 0.0
    _slow_cd_m2: NDArray[np.floating[Any]] | float = 0.0
    _fixed_cd_m2: NDArray[np.floating[Any]] | float = 0.0

    def __init__(
        self,
        luminance_cd_m2: NDArray[np.floating[Any]],
        random_rel: NDArray[np.floating[Any]],
        common: tuple[CommonError, ...] | NDArray[Any] | float,
        invalid: NDArray[np.uint8],
        *,
        slow_rel: float = 0.0,
        slow_cd_m2: NDArray[np.floating[Any]] | float = 0.0,
        fixed_rel: float = 0.0,
        fixed_cd_m2: NDArray[np.floating[Any]] | float = 0.0,
        step: int = 1,
    ) -> None:
        errors = common if isinstance(common, tuple) else (CommonError("calibration", common),)
        shapes = {luminance_cd_m2.shape, random_rel.shape, invalid.shape}
        shapes |= {np.shape(error.relative) for error in errors} - {()}
        if len(shapes) != 1 or luminance_cd_m2.ndim != 2:
            raise InputError(f"the arrays of a luminance map are 2-D of one shape, got {sorted(shapes)}")
        if step < 1:
            raise InputError(f"step of a luminance map is {step}: give at least 1 image pixel")
        self.luminance_cd_m2, self.step = luminance_cd_m2, step
        self.slow_rel, self.fixed_rel = slow_rel, fixed_rel
        self._random_rel, self._invalid, self._errors = random_rel, invalid, errors
        self._slow_cd_m2, self._fixed_cd_m2 = slow_cd_m2, fixed_cd_m2

    def __repr__(self) -> str:
        height, width = self.shape
        return f"<LuminanceMap of {width} x {height} pixels>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        known = self.luminance_cd_m2[np.isfinite(self.luminance_cd_m2)]
        levels = [f"{number(v)} cd/m²" for v in np.percentile(known, (0, 50, 100))] if known.size else 3 * ["-"]
        return html_table(("map", "lowest", "median", "highest"), [(repr(self)[17:-1], *levels)])

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the luminance."""
        return np.array(self.luminance_cd_m2, dtype=dtype)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the map."""
        height, width = self.luminance_cd_m2.shape
        return height, width

    @property
    def random_rel(self) -> NDArray[np.floating[Any]]:
        """Relative standard uncertainty that differs from pixel to pixel, shape (height, width)."""
        return self._random_rel

    @property
    def slow_cd_m2(self) -> NDArray[np.floating[Any]] | float:
        """Standard uncertainty of slow changes across the image, in addition to `slow_rel`."""
        return self._slow_cd_m2

    @property
    def fixed_cd_m2(self) -> NDArray[np.floating[Any]] | float:
        """Part of a pixel's standard uncertainty that is the same in every frame, in addition to `fixed_rel`."""
        return self._fixed_cd_m2

    @property
    def invalid(self) -> NDArray[np.uint8]:
        """`Invalid` flags, shape (height, width); 0 where the pixel is valid."""
        return self._invalid

    @cached_property
    def common(self) -> tuple[CommonError, ...]:
        """Errors that all pixels share, over the whole map; `common_of` has those of a region."""
        return self.common_in(WHOLE)

    @cached_property
    def common_rel(self) -> NDArray[np.floating[Any]] | float:
        """Relative standard uncertainty of all common errors together: a number, or one for each pixel."""
        squares = sum((np.square(error.relative) for error in self.common), start=np.zeros(()))
        total: NDArray[np.float64] = np.sqrt(squares)
        return float(total) if total.ndim == 0 else total

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask of the pixels that are valid."""
        return np.equal(self.invalid, 0)

    def scaled(self, roi: Roi) -> Roi:
        """Region of the image in pixels of the map; raises InputError as `Roi.window`, in pixels of the image."""
        height, width = self.shape
        roi.window((self.step * height, self.step * width))
        return roi.divided(self.step)

    def select(self, roi: Roi) -> NDArray[np.floating[Any]]:
        """Luminances of a region of the image, shape (n,); raises InputError as `Roi.select`."""
        return self.scaled(roi).select(self.luminance_cd_m2)

    def common_of(self, roi: Roi) -> tuple[CommonError, ...]:
        """Return the common errors of a region of the image; patterns have the shape (n,) of `select`.

        Raises
        ------
        InputError
            As `Roi.select`.
        """
        region = self.scaled(roi)
        return _part(self.common_in(region.window(self.shape)), region.mask(self.shape))

    def dn_step_in(self, window: Window) -> NDArray[np.floating[Any]] | None:
        """Return the difference of luminance from a DN to the next in some rows and columns; None if not known."""
        return None

    def common_in(self, window: Window) -> tuple[CommonError, ...]:
        """Return the common errors of some rows and columns of the map."""
        return _part(self._errors, window)


def _part(errors: tuple[CommonError, ...], where: Window | NDArray[np.bool_]) -> tuple[CommonError, ...]:
    return tuple(e if np.ndim(e.relative) == 0 else replace(e, relative=np.asarray(e.relative)[where]) for e in errors)


class MergedMap(LuminanceMap):
    """Luminance map of the pixels of one map where a mask says so, and of another one elsewhere.

    Parameters
    ----------
    where : ndarray of bool, shape (height, width)
        Which pixels come from `new`.
    new, old : LuminanceMap
        Of one calibration, so that their common errors are the same unknown numbers in the same order.

    Raises
    ------
    InputError
        If they have different common errors or steps.
    """

    def __init__(self, where: NDArray[np.bool_], new: LuminanceMap, old: LuminanceMap) -> None:
        require_alike([new, old])
        self.luminance_cd_m2, self.step = np.where(where, new.luminance_cd_m2, old.luminance_cd_m2), old.step
        self.slow_rel, self.fixed_rel = max(new.slow_rel, old.slow_rel), max(new.fixed_rel, old.fixed_rel)
        self._where, self._new, self._old = where, new, old

    @cached_property
    def random_rel(self) -> NDArray[np.floating[Any]]:
        """Relative standard uncertainty that differs from pixel to pixel, shape (height, width)."""
        return np.where(self._where, self._new.random_rel, self._old.random_rel)

    @cached_property
    def slow_cd_m2(self) -> NDArray[np.floating[Any]] | float:
        """Standard uncertainty of slow changes across the image, in addition to `slow_rel`."""
        return np.where(self._where, self._new.slow_cd_m2, self._old.slow_cd_m2)

    @cached_property
    def fixed_cd_m2(self) -> NDArray[np.floating[Any]] | float:
        """Part of a pixel's standard uncertainty that is the same in every frame, in addition to `fixed_rel`."""
        return np.where(self._where, self._new.fixed_cd_m2, self._old.fixed_cd_m2)

    @cached_property
    def invalid(self) -> NDArray[np.uint8]:
        """`Invalid` flags, shape (height, width); 0 where the pixel is valid."""
        return np.where(self._where, self._new.invalid, self._old.invalid)

    def common_in(self, window: Window) -> tuple[CommonError, ...]:
        """Return the common errors of some rows and columns of the map."""
        return tuple(
            a
            if np.ndim(a.relative) == np.ndim(b.relative) == 0 and a.relative == b.relative
            else replace(a, relative=np.where(self._where[window], a.relative, b.relative))
            for a, b in zip(self._new.common_in(window), self._old.common_in(window), strict=True)
        )


def require_alike(maps: Sequence[LuminanceMap]) -> None:
    """Refuse maps that cannot be joined pixel by pixel.

    Raises
    ------
    InputError
        If they differ in shape, in step, or in what their common errors are.
    """
    corner = slice(0, 1), slice(0, 1)
    sources = [[(e.source, e.rectangular) for e in map_.common_in(corner)] for map_ in maps]
    first = maps[0]
    for other, of_other in zip(maps, sources, strict=True):
        if (other.shape, other.step) != (first.shape, first.step):
            raise InputError(f"maps of {first.shape} and {other.shape} pixels cannot be joined: give one size")
        if of_other != sources[0]:
            raise InputError("maps of different calibrations cannot be joined: convert all frames with one")
