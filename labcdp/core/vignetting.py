"""Vignetting of the light towards the edge of the image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, hypot, radians, sqrt, tan
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .disk.arrays import EqualByContent, StoredArray, read_only
from .errors import InputError
from .frame import Readout

#: Relative standard uncertainty of cos^4 vignetting in the corners of the image, unless the user states it or measures
#: a flat field. A judgement for lenses that are stopped down: limits of 9 %, which are 5 %. Wide open it is too small:
#: good lenses then lose 30 to 40 % (D. B. Goldman and J.-H. Chen, "Vignette and exposure calibration and compensation",
#: ICCV 2005).
VIGNETTING_REL = 0.05
#: Beyond any lens.
_LARGEST_LOG = 10.0
#: Side of the middle field a flat field is 1 on, as a share of the sensor's height and width.
MIDDLE_SHARE = 0.1


class Vignetting(Protocol):
    """Responsivity of the pixels relative to a reference; two are equal if they correct alike."""

    def relative_illuminance(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Responsivity of each pixel of a sensor of `shape` (height, width), relative to the reference."""


class _Radial:
    """Errors of a vignetting that depend on the distance r from the axis only, over half the image's diagonal."""

    centre_px: tuple[float, float] | None

    def squared_radius(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """r^2 of each pixel of an image of `shape` (height, width)."""
        return _squared_distance(shape, self.centre_px, 2 / hypot(*shape))

    def common_patterns(self, shape: tuple[int, int]) -> list[NDArray[np.float64]]:
        """Relative errors of V for one standard uncertainty of each independent error, at each pixel; none if exact."""
        return self._patterns(self.squared_radius(shape))

    def common_errors_at(self, shape: tuple[int, int], place_px: tuple[float, float]) -> list[float]:
        """Return the values of `common_patterns` at one place.

        Parameters
        ----------
        shape : (int, int)
            Height and width in pixels.
        place_px : (float, float)
            The place (x, y); the upper left corner of the image is (0, 0).
        """
        return [float(error) for error in self._patterns(np.float64(self.squared_radius_at(shape, place_px)))]

    def squared_radius_at(self, shape: tuple[int, int], place_px: tuple[float, float]) -> float:
        """r^2 at one place (x, y) of an image of `shape` (height, width)."""
        height, width = shape
        x0, y0 = self.centre_px or (width / 2, height / 2)
        return ((place_px[0] - x0) ** 2 + (place_px[1] - y0) ** 2) / (hypot(height, width) / 2) ** 2

    def patterns_at(
        self, shape: tuple[int, int], y_px: NDArray[np.float64], x_px: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Return `common_patterns` at rows and columns of places in an image of `shape`; each of shape (rows, columns).

        Parameters
        ----------
        shape : (int, int)
            Height and width in pixels.
        y_px, x_px : ndarray of float, shape (rows,) and (columns,)
            The places; the upper left corner of the image is (0, 0).
        """
        x0, y0 = self.centre_px or (shape[1] / 2, shape[0] / 2)
        scale = 2 / hypot(*shape)
        return self._patterns(np.add.outer(((y_px - y0) * scale) ** 2, ((x_px - x0) * scale) ** 2))

    def _patterns(self, r2: Any) -> list[Any]:
        raise NotImplementedError


@dataclass(frozen=True)
class Cos4Vignetting(_Radial):
    """Natural light vignetting of a lens, cos^4 of the off-axis angle; 1 on the axis.

    Real lenses differ from it, by mechanical vignetting and by aberrations of the pupil (M. Aggarwal, H. Hua and N.
    Ahuja, "On cosine-fourth and vignetting effects in real lenses", ICCV 2001, 472).

    Parameters
    ----------
    focal_length_m, pixel_pitch_m : float
        Image-side focal length and distance of pixel centres, in metres.
    centre_px : (float, float) or None
        The axis, (x, y) in pixels of the image; None for its middle.
    corner_rel : float
        Relative standard uncertainty in the corners of an image; it grows with the squared distance from the axis.
    log_corner : float
        Logarithm of what the lens' corners have more than cos^4, as patches have shown; it grows alike.

    Raises
    ------
    InputError
        If a length is not a positive number, or the uncertainty negative.
    """

    focal_length_m: float
    pixel_pitch_m: float
    centre_px: tuple[float, float] | None = None
    corner_rel: float = 0.0
    log_corner: float = 0.0

    def __post_init__(self) -> None:
        for name in ("focal_length_m", "pixel_pitch_m"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"{name} is {value}: give a positive number of metres")
        if not (np.isfinite(self.corner_rel) and self.corner_rel >= 0):
            raise InputError(f"corner_rel is {self.corner_rel}: give a fraction of at least 0")
        if not abs(self.log_corner) <= _LARGEST_LOG:
            raise InputError(
                f"log_corner is {self.log_corner}: give a number from -{_LARGEST_LOG:g} to {_LARGEST_LOG:g}"
            )

    def relative_illuminance(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Illuminance relative to the axis, for an image of `shape` (height, width).

        cos(theta) = 1 / sqrt(1 + r^2 / f^2) with r the distance from the axis and f the focal length.
        """
        result = _squared_distance(shape, self.centre_px, self.pixel_pitch_m / self.focal_length_m, 1.0)
        # In place: for a large sensor each intermediate would be a third of all memory.
        result *= result
        np.reciprocal(result, out=result)
        if self.log_corner:
            result *= np.exp(self.log_corner * self.squared_radius(shape))
        return result

    def is_but_for_corners(self, other: object) -> bool:
        """Whether another one differs at most by what patches have shown."""
        if not isinstance(other, Cos4Vignetting):
            return False
        return replace(other, corner_rel=self.corner_rel, log_corner=self.log_corner) == self

    def more_than(self, other: Cos4Vignetting, shape: tuple[int, int], place_px: tuple[float, float]) -> float:
        """Ratio to another one at a place (x, y) of an image of `shape`, as far as patches have shown it."""
        return exp((self.log_corner - other.log_corner) * self.squared_radius_at(shape, place_px))

    def _patterns(self, r2: Any) -> list[Any]:
        return [self.corner_rel * r2] if self.corner_rel else []


#: Half the field of view, from corner to corner, that is assumed of a lens of which nothing is known: that of the main
#: cameras of phones, of wide driver-assistance cameras and of 6 mm on a sensor of 2/3". Its cos^4 leaves 34 % in the
#: corners, less than most lenses do.
ASSUMED_HALF_FIELD_RAD = radians(40)
#: How far its axis may be from the middle of the image, as a share of half the diagonal.
ASSUMED_DECENTRING = 0.05


@dataclass(frozen=True)
class UnknownVignetting:
    """Vignetting of a lens of which nothing is known: values stay as they are, with the errors that this may be.

    All vignetting is equally likely that lies between that of cos^4 at `ASSUMED_HALF_FIELD_RAD` and as much the other
    way, as of a camera that corrects more than there is. The axis is as likely anywhere within `ASSUMED_DECENTRING` of
    the middle. Errors therefore grow with the distance from the axis, and those of two places differ the more, the
    farther these are from each other.

    Parameters
    ----------
    centre_px : (float, float) or None
        Middle of the sensor, (x, y) in pixels of the image; None for that of the image.
    half_diagonal_px : float or None
        Half the diagonal of the sensor in pixels of the image; None for that of the image.
    """

    centre_px: tuple[float, float] | None = None
    half_diagonal_px: float | None = None

    def patterns_at(
        self, shape: tuple[int, int], y_px: NDArray[np.float64], x_px: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Return errors of the logarithm of V, as `Cos4Vignetting.patterns_at`: by the lens, and by its axis."""
        x0, y0 = self.centre_px or (shape[1] / 2, shape[0] / 2)
        half = self.half_diagonal_px or hypot(*shape) / 2
        y, x = (y_px[:, None] - y0) / half, (x_px - x0) / half
        squared_tangent = tan(ASSUMED_HALF_FIELD_RAD) ** 2
        growth = squared_tangent * y**2 + (1 + squared_tangent * x**2)
        # Standard uncertainties of even distributions; those of the axis by the slope of cos^4 in x and y.
        slope = 4 * squared_tangent * ASSUMED_DECENTRING / sqrt(3) / growth
        return [np.log(growth) * (2 / sqrt(3)), slope * x, slope * y]


@dataclass(frozen=True)
class RadialVignetting(_Radial):
    """Vignetting 1 + a2 r^2 + a4 r^4 + a6 r^6; r is the distance from the axis over half the image's diagonal.

    Parameters
    ----------
    a2, a4, a6 : float
        Coefficients, without unit; 1 on the axis.
    centre_px : (float, float) or None
        The axis, (x, y) in pixels of the image; None for its middle.
    covariance : tuple of tuple of float
        Covariance matrix of (a2, a4, a6), shape (3, 3).
    slow_rel : float
        Relative standard uncertainty of slow changes across the image that are not radial, or that the source of the
        light had when it was measured.

    Raises
    ------
    InputError
        If a value is not finite or the covariance not 3 x 3.
    """

    a2: float
    a4: float
    a6: float
    centre_px: tuple[float, float] | None = None
    covariance: tuple[tuple[float, float, float], ...] = ((0.0,) * 3,) * 3
    slow_rel: float = 0.0

    def __post_init__(self) -> None:
        covariance = np.array(self.covariance)
        if covariance.shape != (3, 3):
            raise InputError(f"the covariance of the vignetting has the shape {covariance.shape}: give 3 x 3 numbers")
        values = [self.a2, self.a4, self.a6, self.slow_rel, *(self.centre_px or ()), *covariance.ravel()]
        if not (np.isfinite(values).all() and self.slow_rel >= 0):
            raise InputError(f"the vignetting {self} has a value that is not finite, or a negative uncertainty")

    def relative_illuminance(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """V for an image of `shape` (height, width).

        Raises
        ------
        InputError
            If it is not positive everywhere on the image.
        """
        r2 = self.squared_radius(shape)
        result: NDArray[np.float64] = self._at(r2)
        if result.min() <= 0:
            raise InputError(
                f"the vignetting {self.a2:g} r^2 {self.a4:+g} r^4 {self.a6:+g} r^6 leaves no light at the edge: "
                "measure it again over the whole image"
            )
        return result

    def _at(self, r2: Any) -> Any:
        return 1 + r2 * (self.a2 + r2 * (self.a4 + r2 * self.a6))

    def _patterns(self, r2: Any) -> list[Any]:
        """Relative errors of V, each for one standard uncertainty along an eigenvector of the covariance."""
        values, vectors = np.linalg.eigh(np.array(self.covariance))
        errors = [
            np.sqrt(value) * vector
            for value, vector in zip(values, vectors.T, strict=True)
            if value > 1e-12 * values.max() > 0
        ]
        return [r2 * (a2 + r2 * (a4 + r2 * a6)) / self._at(r2) for a2, a4, a6 in errors]


@dataclass(frozen=True, eq=False)
class FlatField(EqualByContent):
    """Measured responsivity of every pixel; its mean over the middle of the image is 1.

    The middle is a tenth of height and width (`MIDDLE_SHARE`), so that R stays the responsivity on the axis and one
    pixel's own sensitivity does not set it. Two flat fields are equal if all their values are.

    Parameters
    ----------
    relative : ndarray of float32, shape (height, width)
        Responsivity of each pixel relative to the middle; made read-only.
    random_rel : float
        Relative standard uncertainty of one pixel's value by the noise of the frames; independent between pixels, the
        same in every frame that is corrected.
    slow_rel : float
        Relative standard uncertainty of slow changes across the image: how non-uniform the uniform source may be.
    n_frames : int
        Light frames it was made from.
    middle : float
        Mean over the middle; not 1 for a part of a flat field.

    Raises
    ------
    InputError
        If a value is not positive and finite, or the mean over the middle is not `middle`.
    """

    relative: Annotated[NDArray[np.float32], StoredArray("float32", 2)]
    random_rel: float
    slow_rel: float
    n_frames: int
    middle: float = 1.0

    def __post_init__(self) -> None:
        relative = np.asarray(self.relative)
        if relative.ndim != 2 or not (np.isfinite(relative).all() and relative.min() > 0):
            raise InputError("a flat field is a 2-D array of positive numbers: measure it from uniform light again")
        if not (self.random_rel >= 0 and self.slow_rel >= 0 and self.n_frames >= 1):
            raise InputError(
                f"random_rel {self.random_rel}, slow_rel {self.slow_rel} and n_frames {self.n_frames} of a flat field: "
                "give uncertainties of at least 0, and at least 1 frame"
            )
        middle = _mean_of_middle(relative)
        if abs(middle - self.middle) > 1e-3:
            raise InputError(
                f"the middle of the flat field is {middle:.4g}, not {self.middle:g}: divide by the mean over the middle"
            )
        object.__setattr__(self, "relative", read_only(relative, np.float32))

    def relative_illuminance(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Return the values as float64, shape (height, width); raises InputError for an image of another size."""
        if shape != self.relative.shape:
            height, width = self.relative.shape
            raise InputError(
                f"the flat field is {width} x {height} pixels, the image {shape[1]} x {shape[0]}: measure one with "
                "this image size"
            )
        return self.relative.astype(np.float64)


#: Fall-offs a calibration can have.
AnyVignetting = Cos4Vignetting | RadialVignetting | FlatField
#: What is taken of the vignetting without a calibration.
AssumedVignetting = Cos4Vignetting | UnknownVignetting


def cropped(
    vignetting: AnyVignetting, whole: tuple[int, int], corner: tuple[int, int], shape: tuple[int, int]
) -> AnyVignetting:
    """Return the vignetting of a part of the image, with the same reference.

    Parameters
    ----------
    vignetting : AnyVignetting
        Of the whole image.
    whole, shape : (int, int)
        Height and width of the image, and of the part.
    corner : (int, int)
        First column and row of the part.
    """
    (x, y), (height, width) = corner, shape
    if isinstance(vignetting, FlatField):
        part = vignetting.relative[y : y + height, x : x + width]
        return replace(vignetting, relative=part, middle=_mean_of_middle(part))
    x0, y0 = vignetting.centre_px or (whole[1] / 2, whole[0] / 2)
    centre_px = (x0 - x, y0 - y)
    # The unit of r is half the diagonal.
    scale = np.array([(hypot(*shape) / hypot(*whole)) ** power for power in (2, 4, 6)])
    if isinstance(vignetting, Cos4Vignetting):
        r2 = float(scale[0])
        corners = {"corner_rel": r2 * vignetting.corner_rel, "log_corner": r2 * vignetting.log_corner}
        return replace(vignetting, centre_px=centre_px, **corners)
    a2, a4, a6 = scale * (vignetting.a2, vignetting.a4, vignetting.a6)
    rows = scale[:, None] * np.array(vignetting.covariance) * scale
    covariance = tuple((float(a), float(b), float(c)) for a, b, c in rows)
    return replace(vignetting, a2=float(a2), a4=float(a4), a6=float(a6), centre_px=centre_px, covariance=covariance)


def illuminance_in(
    vignetting: AnyVignetting, shape: tuple[int, int], window: tuple[slice, slice]
) -> NDArray[np.float64]:
    """Return the illuminance relative to the axis in some rows and columns of an image of `shape` (height, width).

    Examples
    --------
    >>> lens = Cos4Vignetting(focal_length_m=6e-3, pixel_pitch_m=3.45e-6)
    >>> corner = illuminance_in(lens, (2056, 2452), (slice(0, 2), slice(0, 3)))
    >>> corner.shape, bool(corner.max() < 0.5)
    ((2, 3), True)
    """
    if isinstance(vignetting, FlatField):
        return vignetting.relative_illuminance(shape)[window]
    (top, bottom), (left, right) = (part.indices(n)[:2] for part, n in zip(window, shape, strict=True))
    part = bottom - top, right - left
    return cropped(vignetting, shape, (left, top), part).relative_illuminance(part)


def assumed_in_part(
    vignetting: AssumedVignetting, whole: tuple[int, int], corner: tuple[int, int], shape: tuple[int, int]
) -> AssumedVignetting:
    """Return what is assumed for a part of the image; the parameters are those of `cropped`."""
    if isinstance(vignetting, Cos4Vignetting):
        part = cropped(vignetting, whole, corner, shape)
        assert isinstance(part, Cos4Vignetting)
        return part
    x0, y0 = vignetting.centre_px or (whole[1] / 2, whole[0] / 2)
    half_diagonal_px = vignetting.half_diagonal_px or hypot(*whole) / 2
    return UnknownVignetting((x0 - corner[0], y0 - corner[1]), half_diagonal_px)


@dataclass(frozen=True)
class Lens:
    """What decides natural vignetting.

    Parameters
    ----------
    focal_length_m, pixel_pitch_m : float
        Of the lens, and of the sensor before pixels are joined.
    vignetting_rel : float
        Relative standard uncertainty of cos^4 in the corners of the sensor, of an image where that is not known.
    """

    focal_length_m: float
    pixel_pitch_m: float
    vignetting_rel: float = VIGNETTING_REL

    def on(self, shape: tuple[int, int], readout: Readout | None = None) -> Cos4Vignetting:
        """Vignetting of an image of `shape` (height, width) that shows a part of the sensor; None for all of it."""
        seen = readout or Readout()
        pitch_m = self.pixel_pitch_m * seen.pitches
        # The corners that are meant are those of the sensor: beyond the middle, a part's would make it larger.
        part = 1.0 if seen.sensor_size is None else (hypot(*shape) / hypot(*seen.sensor_size)) ** 2
        return Cos4Vignetting(self.focal_length_m, pitch_m, seen.axis_px(shape), part * self.vignetting_rel)


def with_doubt(vignetting: Cos4Vignetting, shape: tuple[int, int]) -> Cos4Vignetting:
    """Return it for an image of `shape` that the camera may have corrected already, in part or wholly."""
    corner = (hypot(*shape) / 2 * vignetting.pixel_pitch_m / vignetting.focal_length_m) ** 2
    # The slope of cos^4 on the axis, which is the steepest.
    return replace(vignetting, corner_rel=hypot(vignetting.corner_rel, 2 * corner / sqrt(3)))


def unknown_vignetting(shape: tuple[int, int], readout: Readout | None = None) -> UnknownVignetting:
    """Vignetting of an image of `shape` (height, width), or of a part of a sensor, by an unknown lens."""
    axis_px, size = (None, None) if readout is None else (readout.axis_px(shape), readout.sensor_size)
    return UnknownVignetting(axis_px, None if axis_px is None or size is None else hypot(*size) / 2)


def _squared_distance(
    shape: tuple[int, int], centre_px: tuple[float, float] | None, scale: float, start: float = 0.0
) -> NDArray[np.float64]:
    """Squared distance of each pixel from the axis, times a squared scale and added to a start."""
    x0, y0 = centre_px or (shape[1] / 2, shape[0] / 2)
    y, x = ((np.arange(n) + 0.5 - middle) * scale for n, middle in zip(shape, (y0, x0), strict=True))
    result: NDArray[np.float64] = np.add.outer(start + y**2, x**2)
    return result


def _mean_of_middle(relative: NDArray[Any]) -> float:
    return float(relative[middle_of(relative.shape)].mean(dtype=float))


def middle_of(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the middle field of an image of `shape` (height, width), at least one pixel."""
    height, width = shape
    half = [max(round(n * MIDDLE_SHARE / 2), 1) for n in (height, width)]
    return (
        slice(max(height // 2 - half[0], 0), height // 2 + half[0]),
        slice(max(width // 2 - half[1], 0), width // 2 + half[1]),
    )
