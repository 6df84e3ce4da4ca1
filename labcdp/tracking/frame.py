"""A frame as trackers see it: of full depth, with the noise of 8 bits, and a part of it at the scale of a template."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, isfinite, isnan, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, box_of, local_scale, shift
from .settings import SETTINGS

#: What the DN of frames are: see `labcdp.tracking.make_tracker`.
Levels = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class GreyFrame:
    """A frame.

    Parameters
    ----------
    dn : ndarray of uint8 or uint16, shape (height, width)
        Its values.
    black, scale : float
        Level that is subtracted from them, and factor on the rest.
    step_dn : float
        DN of the result for one of 8 bits.
    faint_dn : float
        Contrast in the result below which a codec may not show where a thing is.
    """

    dn: NDArray[Any]
    black: float
    scale: float
    step_dn: float
    faint_dn: float

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.dn.shape[0], self.dn.shape[1]

    def part(self, left: int, top: int, right: int, bottom: int) -> NDArray[np.float32]:
        """Pixels of a window."""
        return self._scaled(self.dn[top:bottom, left:right].astype(np.float32))

    def reduced(self, left: int, top: int, right: int, bottom: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """Window in another size (width, height): averaged if smaller, else interpolated."""
        import cv2

        smaller = size[0] <= right - left and size[1] <= bottom - top
        how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        window = self.dn[top:bottom, left:right].astype(np.float32)
        return self._scaled(np.asarray(cv2.resize(window, size, interpolation=how), dtype=np.float32))

    @cached_property
    def small(self) -> NDArray[np.float32]:
        """Whole frame, at most `SETTINGS.small_frame_px` pixels long, averaged."""
        import cv2

        height, width = self.shape
        every = max(1, -(-max(height, width) // SETTINGS.small_frame_px))
        frame = self.dn[: height // every * every, : width // every * every]
        # OpenCV is many times as fast at halves.
        while every > 1:
            step = 2 if every % 2 == 0 else every
            frame = cv2.resize(frame, None, fx=1 / step, fy=1 / step, interpolation=cv2.INTER_AREA)
            every //= step
        return self._scaled(np.asarray(frame, dtype=np.float32))

    @property
    def reduction(self) -> float:
        """Pixels of `small` for each of the frame."""
        return 1 / max(1, -(-max(self.shape) // SETTINGS.small_frame_px))

    def _scaled(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        if self.scale == 1 and self.black == 0:
            return values
        return (values - np.float32(self.black)) * np.float32(self.scale)


def scale_of(frame: NDArray[Any], usual: float = nan) -> float:
    """Factor that gives a frame the noise of one of 8 bits, estimated from its middle.

    Of a coded frame, whose errors are no noise, and of one of 8 bits it is the `usual` one, but more in the dark.
    """
    top, left = (max(side - SETTINGS.noise_sample_px, 0) // 2 for side in frame.shape)
    middle = frame[top : top + SETTINGS.noise_sample_px, left : left + SETTINGS.noise_sample_px].astype(np.float32)
    noise, structure = noise_dn(middle), float(middle.std())
    if isnan(usual):
        return SETTINGS.scaled_noise_dn / noise
    if structure <= SETTINGS.structure_over_noise * noise:
        return usual
    return max(usual, min(SETTINGS.scaled_structure_dn / structure, SETTINGS.scaled_noise_dn / noise))


def smooth(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Image smoothed by 1 2 1 along both axes."""
    import cv2

    kernel = np.array([0.25, 0.5, 0.25], np.float32)
    return np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel))


def median(values: NDArray[Any]) -> float:
    """Median, in a part of the time that NumPy takes for few values."""
    low, high = (values.size - 1) // 2, values.size // 2
    ranked = np.partition(values, (low, high), axis=None)
    return (float(ranked[low]) + float(ranked[high])) / 2


def noise_dn(window: NDArray[np.float32]) -> float:
    """Estimate the standard deviation of the noise, at least that of rounding.

    Notes
    -----
    Median of the absolute answers of the mask (1 -2 1; -2 4 -2; 1 -2 1), which is blind to planes and edges along the
    axes (J. Immerkaer, Fast noise variance estimation, Comput. Vis. Image Underst. 64, 1996; the median instead of the
    mean lets structure count less).
    """
    z = window[2:] - 2 * window[1:-1] + window[:-2]
    answers = z[:, 2:] - 2 * z[:, 1:-1] + z[:, :-2]
    if answers.size == 0:
        return SETTINGS.rounding_noise_dn
    return max(median(np.abs(answers)) / 0.6745 / 6, SETTINGS.rounding_noise_dn)


_FROM_CORNER, _TO_CORNER = shift(-0.5, -0.5), shift(0.5, 0.5)


@dataclass(frozen=True, eq=False)
class View:
    """Part of a frame.

    Parameters
    ----------
    values : ndarray of float32, shape (h, w)
        The part, in another size, smoothed as templates are.
    factors : (float, float)
        Pixels of the view for each of the image, along x and y.
    corner : (int, int)
        Where it begins in the image, x and y.
    image_shape : (int, int)
        Height and width of the frame.
    """

    values: NDArray[np.float32]
    factors: tuple[float, float]
    corner: tuple[int, int]
    image_shape: tuple[int, int]

    @cached_property
    def from_image(self) -> Matrix:
        """Image pixels to the view's pixels."""
        (across, down), (x, y) = self.factors, self.corner
        return np.array([[across, 0.0, -across * x], [0.0, down, -down * y], [0.0, 0.0, 1.0]])

    @cached_property
    def to_image(self) -> Matrix:
        """The view's pixels to image pixels."""
        (across, down), (x, y) = self.factors, self.corner
        return np.array([[1 / across, 0.0, x], [0.0, 1 / down, y], [0.0, 0.0, 1.0]])

    def under(self, to_image: Matrix, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Values under each pixel of a template of `shape` that lies at `to_image`, interpolated, shape (n,)."""
        import cv2

        # OpenCV has the middle of the first pixel at 0, we have its corner there.
        centres = _FROM_CORNER @ self.from_image @ to_image @ _TO_CORNER
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(self.values, centres, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen, dtype=np.float32).ravel()

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom end of the image in the view."""
        (across, down), (x, y), (height, width) = self.factors, self.corner, self.image_shape
        return -across * x, -down * y, across * (width - x), down * (height - y)


def view_around(frame: GreyFrame, shape: tuple[int, int], to_image: Matrix, reach_px: float) -> View | None:
    """View of where a template should be by `to_image`, with `reach_px` pixels of the frame around; None if outside.

    The view has the size the template would have: a target that comes nearer is reduced more.
    """
    height, width = shape
    box = box_of(to_image, width, height)
    scale = local_scale(to_image, (width / 2, height / 2))
    if not isfinite(box[0]) or not isfinite(scale):
        return None
    left, top = max(floor(box[0] - reach_px), 0), max(floor(box[1] - reach_px), 0)
    right, bottom = min(ceil(box[2] + reach_px), frame.shape[1]), min(ceil(box[3] + reach_px), frame.shape[0])
    if right - left < 3 or bottom - top < 3:
        return None
    rows, columns = max(round((bottom - top) / scale), 3), max(round((right - left) / scale), 3)
    values = smooth(frame.reduced(left, top, right, bottom, (columns, rows)))
    return View(values, (columns / (right - left), rows / (bottom - top)), (left, top), frame.shape)
