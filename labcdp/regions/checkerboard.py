"""Detection of checkerboards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.roi import Roi
from .corners import (
    LONGEST_PX,
    Corners,
    FloatImage,
    expected,
    grey_values,
    known,
    locally_stretched,
    odd_places,
    real_corners,
    reduced,
    sampled,
    stretched,
    without_outliers,
)
from .geometry import inset
from .shapes import PolygonShape

#: Fewest inner corners along each side of a board, and in all.
_FEWEST_ALONG, _FEWEST = 3, 9

#: Parts of the squares in a row that must be light and dark in turn.
_AGREEING = 0.85

#: Least contrast near the corners of the squares, in parts of that of their middles: boards whose blur reaches over a
#: tenth of a square have 0.44, rows of dots 0.27.
_CORNER_CONTRAST = 0.35

#: Least margin, in pixels: edges of real images are this wide.
_LEAST_MARGIN_PX = 1.5


def detect_checkerboard(grey: NDArray[Any], *, margin_rel: float = 0.15) -> tuple[PolygonShape, ...]:
    """Find the squares of a checkerboard, whole or cropped, turned, in perspective.

    Corners by `cv2.findChessboardCornersSB` (Duda and Frese, "Accurate detection and localization of checkerboard
    corners for calibration", BMVC 2018), checked one by one.

    Parameters
    ----------
    grey : ndarray, shape (height, width)
        Image, in any unit that rises with light. A board has at least 4 x 4 squares of at least 8 pixels.
    margin_rel : float
        Part of a square's shortest side that is left out along its edges, at least 1.5 pixels.

    Returns
    -------
    tuple of PolygonShape
        The squares row by row, called ``r1c1-light``, ``r1c2-dark`` and so on; r1c1 is the upper left one as the image
        is seen. Squares that the image shows in part only are left out.

    Raises
    ------
    InputError
        If no board is found for sure, its squares are too small for the margin, or the margin is not from 0 to 0.45.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.regions import detect_checkerboard
    >>> squares = np.kron(np.indices((5, 7)).sum(axis=0) % 2, np.ones((40, 40)))
    >>> len(detect_checkerboard((50 + 150 * squares).astype(np.uint8)))
    35
    """
    if not 0 <= margin_rel <= 0.45:
        raise InputError(f"margin_rel is {margin_rel:g}: give a part of a square's side from 0 to 0.45")
    values = grey_values(grey)
    for proposal in _proposals(values):
        side_px = _side_px(proposal)
        smooth = _smoothed(values, side_px)
        # Corners of a reduced image, or of few neighbours, are not where the whole one shows them.
        coarse = max(values.shape) > LONGEST_PX or known(proposal).sum() == _FEWEST
        corners = real_corners(_upright(_sharpened(proposal, side_px, smooth) if coarse else proposal), smooth)
        if known(corners).sum() >= _FEWEST and (squares := _squares(without_outliers(corners), smooth, margin_rel)):
            return squares
    raise InputError(
        f"no checkerboard was found in the image of {values.shape[1]} x {values.shape[0]} pixels: show at least "
        "4 x 4 whole squares of at least 8 pixels, in focus and not covered, or draw the regions"
    )


def _proposals(values: FloatImage) -> Iterator[Corners]:
    """Give what OpenCV finds, in the image as it is and made clearer in several ways."""
    import cv2

    # It draws at random: an image has the same corners, whatever was searched before.
    cv2.setRNGSeed(0)
    values, scale = reduced(values)
    yield from _corners(stretched(values), scale)
    # Against noise; against non-uniform light; for squares of few pixels.
    yield from _corners(stretched(cv2.GaussianBlur(values, (0, 0), 2.0)), scale)
    yield from _corners(locally_stretched(values, max(values.shape) / 20), scale)
    if max(values.shape) <= LONGEST_PX / 2:
        twice = cv2.resize(values, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
        yield from _corners(stretched(twice), 2 * scale)


def _corners(grey: NDArray[np.uint8], scale: float) -> Iterator[Corners]:
    import cv2

    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    detected, places, meta = cv2.findChessboardCornersSBWithMeta(grey, (_FEWEST_ALONG, _FEWEST_ALONG), flags)
    if detected:
        yield (places.reshape(*meta.shape, 2).astype(np.float64) + 0.5) / scale


def _side_px(corners: Corners) -> float:
    """Return the median side of the squares."""
    sides = [np.linalg.norm(np.diff(corners, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    return float(np.median(np.concatenate(sides)))


def _sharpened(corners: Corners, side_px: float, image: FloatImage) -> Corners:
    """Return corners that were found in a reduced image as the whole one shows them, within a quarter of a square."""
    import cv2

    window = int(np.clip(side_px / 4, 2, 12))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.005)
    start = (corners - 0.5).astype(np.float32).reshape(-1, 1, 2)
    end: NDArray[np.float32] = cv2.cornerSubPix(image, start, (window, window), (-1, -1), stop)
    refined = end.reshape(corners.shape).astype(np.float64) + 0.5
    # Where all is blurred, a corner may run away in its window.
    near = np.linalg.norm(refined - corners, axis=-1, keepdims=True) < 0.1 * side_px
    return np.where(near, refined, corners)


def _smoothed(values: FloatImage, side_px: float) -> FloatImage:
    """Take noise off, and leave the squares."""
    import cv2

    return np.asarray(cv2.GaussianBlur(values, (0, 0), float(np.clip(side_px / 16, 0.6, 4))))


def _upright(corners: Corners) -> Corners:
    """Order corners so that columns count to the right and rows downwards in the image."""
    along, down = (np.diff(corners, axis=axis).reshape(-1, 2).mean(axis=0) for axis in (1, 0))
    if abs(along[0]) + abs(down[1]) < abs(along[1]) + abs(down[0]):
        corners, along, down = corners.swapaxes(0, 1), down, along
    return corners[:: 1 if down[1] > 0 else -1, :: 1 if along[0] > 0 else -1]


def _squares(corners: Corners, image: FloatImage, margin_rel: float) -> tuple[PolygonShape, ...]:
    """Return the squares within corners and around them; none if light and dark do not alternate."""
    squares, inner = _quadrilaterals(corners)
    tones, spread = _tones(squares, image)
    odd, usable = odd_places(tones.shape), inner & np.isfinite(tones)
    if not ((usable & odd).any() and (usable & ~odd).any()):
        return ()
    light = odd if tones[usable & odd].mean() >= tones[usable & ~odd].mean() else ~odd
    agreeing = _agreeing(tones, spread, inner, light)
    if (agreeing & inner).sum() < _AGREEING * usable.sum():
        return ()
    if not _fill_their_squares(squares[agreeing & inner], light[agreeing & inner], image):
        return ()
    kept = np.argwhere((agreeing & inner) | _outer(agreeing, np.isfinite(tones) & ~inner, inner, light))
    first = kept.min(axis=0) - 1
    shapes = []
    for at in kept:
        row, column = at - first
        name = f"r{row}c{column}-{'light' if light[tuple(at)] else 'dark'}"
        ends = squares[tuple(at)]
        side_px = float(np.linalg.norm(ends - np.roll(ends, -1, axis=0), axis=1).min())
        whole = Roi(name, tuple(map(tuple, ends.tolist())))
        shapes.append(PolygonShape(name, inset(whole, max(_LEAST_MARGIN_PX, margin_rel * side_px)).corners))
    return tuple(shapes)


def _quadrilaterals(corners: Corners) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the corners of all squares at known corners, shape (rows, columns, 4, 2), and which have only such."""
    from scipy.ndimage import binary_dilation

    padded = np.pad(corners, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    seen = known(padded)
    near = binary_dilation(seen, np.ones((3, 3), dtype=np.bool_))[..., None]
    places = np.where(seen[..., None], padded, np.where(near, expected(padded), np.nan))

    def around_squares(values: NDArray[Any]) -> NDArray[Any]:
        return np.stack([values[:-1, :-1], values[:-1, 1:], values[1:, 1:], values[1:, :-1]], axis=2)

    return around_squares(places), np.asarray(around_squares(seen).all(axis=2))


def _tones(squares: NDArray[np.float64], image: FloatImage) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean of each square and how far its parts are from it, nan for those that reach out of the image."""
    steps = np.linspace(0.2, 0.8, 5)
    values = _values_within(squares, np.array([(u, v) for v in steps for u in steps]), image)
    # The margin is wider than the pixel by which a square may seem to reach out.
    inside = ((squares >= -1) & (squares <= np.array(image.shape[::-1]) + 1)).all(axis=(2, 3))
    return np.where(inside, values.mean(axis=-1), np.nan), np.ptp(values, axis=-1)


def _values_within(squares: NDArray[np.float64], parts: NDArray[np.float64], image: FloatImage) -> NDArray[np.float64]:
    """Return the values of squares (..., 4, 2) at parts of their sides, shape (n, 2), from their first corners."""
    a, b, c, d = (squares[..., corner, None, :] for corner in range(4))
    u, v = parts.T[:, :, None]
    return sampled(image, (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * d + u * c))


def _agreeing(
    tones: NDArray[np.float64], spread: NDArray[np.float64], inner: NDArray[np.bool_], light: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which squares are as light as the like ones next to them, and uniform against light and dark."""
    around = sliding_window_view(np.pad(np.where(inner, tones, np.nan), 2, constant_values=np.nan), (5, 5))
    unlike = odd_places((5, 5))
    like = ~unlike
    # All but the square itself.
    like[2, 2] = False
    like_tone, unlike_tone = (_median(around[..., which]) for which in (like, unlike))
    contrast = like_tone - unlike_tone
    as_others = np.abs(tones - like_tone) < 0.35 * np.abs(contrast)
    return np.asarray(((contrast > 0) == light) & as_others & (spread < 0.5 * np.abs(contrast)))


def _median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median along the last axis of all that is not nan; nan if there is nothing."""
    ordered, count = np.sort(values, axis=-1), np.isfinite(values).sum(axis=-1, keepdims=True)
    middle = np.concatenate([np.maximum(count - 1, 0) // 2, count // 2], axis=-1)
    return np.asarray(np.take_along_axis(ordered, middle, axis=-1).mean(axis=-1))


def _fill_their_squares(squares: NDArray[np.float64], light: NDArray[np.bool_], image: FloatImage) -> bool:
    """Whether light and dark reach into the corners of their squares: those of rows of dots do not."""
    middle, corner = np.array([[0.5, 0.5]]), np.array([[a, b] for a in (0.12, 0.88) for b in (0.12, 0.88)])
    tones = [_values_within(squares, within, image).mean(axis=-1) for within in (middle, corner)]
    middle_contrast, corner_contrast = (tone[light].mean() - tone[~light].mean() for tone in tones)
    return bool(corner_contrast > _CORNER_CONTRAST * middle_contrast)


def _outer(
    agreeing: NDArray[np.bool_], outer: NDArray[np.bool_], inner: NDArray[np.bool_], light: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return the squares of the outermost rows and columns, where both light and dark ones are as they should be.

    Paper next to a board may look like its light squares, but not like the dark ones between them.
    """
    from scipy.ndimage import binary_dilation

    kept = np.zeros_like(inner)
    for axis, step in ((0, -1), (0, 1), (1, -1), (1, 1)):
        # Each outer square belongs to the line of those whose neighbour towards the board is an inner one.
        line = outer & np.roll(inner, step, axis)
        right = line & agreeing
        n_line, n_light, n_dark = (
            np.sum(marked, 1 - axis, keepdims=True) for marked in (line, right & light, right & ~light)
        )
        kept |= right & (n_light > 0) & (n_dark > 0) & (n_light + n_dark >= _AGREEING * n_line)
    # A corner of the board hangs on two accepted lines, or on corners beside it.
    beside = np.array([[1, 0, 1]])
    while True:
        corners = agreeing & outer & ~kept & binary_dilation(kept, beside) & binary_dilation(kept, beside.T)
        if not corners.any():
            return kept
        kept |= corners
