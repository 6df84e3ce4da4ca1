"""Detection of checkerboards."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.roi import Roi
from .corners import (
    At,
    Corners,
    FloatImage,
    Lattice,
    grey_values,
    locally_stretched,
    real_corners,
    refined,
    sampled,
    stretched,
    without_outliers,
)
from .geometry import inset
from .shapes import PolygonShape

#: Corners are searched in an image of at most this many pixels along its longer side, then refined in the whole one.
_LONGEST_PX = 1600

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
    """
    if not 0 <= margin_rel <= 0.45:
        raise InputError(f"margin_rel is {margin_rel:g}: give a part of a square's side from 0 to 0.45")
    values = grey_values(grey)
    reduced = max(values.shape) > _LONGEST_PX
    for proposal in _proposals(values):
        smooth = _smoothed(values, _side_px(proposal))
        # Corners of a reduced image, or of few neighbours, are not where the whole one shows them.
        coarse = reduced or len(proposal) == _FEWEST
        corners = real_corners(_upright(_sharpened(proposal, smooth) if coarse else proposal), smooth)
        if len(corners) < _FEWEST:
            continue
        squares = _squares(without_outliers(corners), smooth)
        if squares:
            return _shapes(squares, margin_rel)
    raise InputError(
        f"no checkerboard was found in the image of {values.shape[1]} x {values.shape[0]} pixels: show at least "
        "4 x 4 whole squares of at least 8 pixels, in focus and not covered, or draw the regions"
    )


def _proposals(values: FloatImage) -> Iterator[Corners]:
    """Give what OpenCV finds, in the image as it is and made clearer in several ways."""
    import cv2

    scale = min(1.0, _LONGEST_PX / max(values.shape))
    if scale < 1:
        values = cv2.resize(values, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    yield from _corners(stretched(values), scale)
    # Against noise; against non-uniform light; for squares of few pixels.
    yield from _corners(stretched(cv2.GaussianBlur(values, (0, 0), 2.0)), scale)
    yield from _corners(locally_stretched(values, max(values.shape) / 20), scale)
    if max(values.shape) <= _LONGEST_PX / 2:
        twice = cv2.resize(values, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
        yield from _corners(stretched(twice), 2 * scale)


def _corners(grey: NDArray[np.uint8], scale: float) -> Iterator[Corners]:
    import cv2

    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    found, places, meta = cv2.findChessboardCornersSBWithMeta(grey, (_FEWEST_ALONG, _FEWEST_ALONG), flags)
    if found:
        grid = (places.reshape(*meta.shape, 2).astype(np.float64) + 0.5) / scale
        yield {(i, j): grid[i, j] for i, j in product(*map(range, meta.shape))}


def _side_px(corners: Corners) -> float:
    """Return the median side of the squares."""
    sides = [
        np.linalg.norm(place - corners[near])
        for (i, j), place in corners.items()
        for near in ((i + 1, j), (i, j + 1))
        if near in corners
    ]
    return float(np.median(sides))


def _sharpened(corners: Corners, image: FloatImage) -> Corners:
    """Return corners that were found in a reduced image as the whole one shows them."""
    side_px = _side_px(corners)
    found = {at: refined(place, side_px, image) for at, place in corners.items()}
    # Where all is blurred, a corner may run away in its window.
    near = {at for at in found if np.linalg.norm(found[at] - corners[at]) < 0.1 * side_px}
    return {at: found[at] if at in near else corners[at] for at in corners}


def _smoothed(values: FloatImage, side_px: float) -> FloatImage:
    """Take noise off, and leave the squares."""
    import cv2

    return np.asarray(cv2.GaussianBlur(values, (0, 0), float(np.clip(side_px / 16, 0.6, 4))))


def _upright(corners: Corners) -> Corners:
    """Count columns to the right and rows down, as the image is seen."""
    along = np.mean([corners[i, j + 1] - corners[i, j] for i, j in corners if (i, j + 1) in corners], axis=0)
    down = np.mean([corners[i + 1, j] - corners[i, j] for i, j in corners if (i + 1, j) in corners], axis=0)
    if abs(along[0]) + abs(down[1]) < abs(along[1]) + abs(down[0]):
        corners, along, down = {(j, i): place for (i, j), place in corners.items()}, down, along
    right, under = (1 if along[0] > 0 else -1), (1 if down[1] > 0 else -1)
    return {(under * i, right * j): place for (i, j), place in corners.items()}


def _squares(corners: Corners, image: FloatImage) -> dict[At, tuple[PolygonShape, bool]]:
    """Return the squares, and whether each is light; none if light and dark do not alternate."""
    lattice = Lattice(corners)
    around = {near for i, j in corners for near in product((i - 1, i, i + 1), (j - 1, j, j + 1))}
    places = {at: corners[at] if at in corners else lattice.place(at) for at in around}
    inner = {at for at in corners if all(near in corners for near in _square(at))}
    whole = (at for at in places if all(near in places for near in _square(at)))
    tones = {at: tone for at in whole if (tone := _tone(at, places, image)) is not None}
    light = {parity: [tones[at][0] for at in inner & set(tones) if sum(at) % 2 == parity] for parity in (0, 1)}
    if not all(light.values()):
        return {}
    light_parity = 0 if np.mean(light[0]) > np.mean(light[1]) else 1
    agreeing = {at for at in tones if _agrees(at, tones, inner, light_parity)}
    if len(agreeing & inner) < _AGREEING * len(inner & set(tones)):
        return {}
    if not _fill_their_squares(agreeing & inner, places, image, light_parity):
        return {}
    kept = (agreeing & inner) | _outer(agreeing, set(tones), inner)
    return {
        at: (
            PolygonShape("square", tuple(tuple(places[near].tolist()) for near in _square(at))),
            sum(at) % 2 == light_parity,
        )
        for at in sorted(kept)
    }


def _square(at: At) -> tuple[At, At, At, At]:
    i, j = at
    return (i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)


def _tone(at: At, places: Corners, image: FloatImage) -> tuple[float, float] | None:
    """Return mean of a square and how far its parts are from it, or None where it reaches out of the image."""
    height, width = image.shape
    # The margin is wider than the pixel by which a square may seem to reach out.
    if not all(-1 <= x <= width + 1 and -1 <= y <= height + 1 for x, y in (places[near] for near in _square(at))):
        return None
    steps = np.linspace(0.2, 0.8, 5)
    values = _values_within(at, places, np.array([(u, v) for v in steps for u in steps]), image)
    if np.isnan(values).any():
        return None
    return float(values.mean()), float(values.max() - values.min())


def _values_within(at: At, places: Corners, parts: NDArray[np.float64], image: FloatImage) -> NDArray[np.float64]:
    """Return the values of a square at parts of its sides, shape (n, 2), from its first corner."""
    a, b, c, d = (places[near] for near in _square(at))
    u, v = parts.T[:, :, None]
    return sampled(image, (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * d + u * c))


def _agrees(at: At, known: dict[At, Any], inner: set[At], light_parity: int) -> bool:
    """Whether a square is as light as the like ones next to it, and uniform against what is between light and dark."""
    i, j = at
    near = [n for n in product(range(i - 2, i + 3), range(j - 2, j + 3)) if n != at and n in inner and n in known]
    like = [known[n][0] for n in near if sum(n) % 2 == sum(at) % 2]
    unlike = [known[n][0] for n in near if sum(n) % 2 != sum(at) % 2]
    if not (like and unlike):
        return False
    contrast = np.median(like) - np.median(unlike)
    if (contrast > 0) != (sum(at) % 2 == light_parity):
        return False
    mean, spread = known[at]
    return bool(abs(mean - np.median(like)) < 0.35 * abs(contrast) and spread < 0.5 * abs(contrast))


def _fill_their_squares(squares: set[At], places: Corners, image: FloatImage, light_parity: int) -> bool:
    """Whether light and dark reach into the corners of their squares: those of rows of dots do not."""
    middle, corner = np.array([[0.5, 0.5]]), np.array([[a, b] for a in (0.12, 0.88) for b in (0.12, 0.88)])
    contrasts = []
    for within in (middle, corner):
        tones: tuple[list[float], list[float]] = ([], [])
        for at in squares:
            tones[sum(at) % 2 == light_parity].append(float(_values_within(at, places, within, image).mean()))
        contrasts.append(np.mean(tones[True]) - np.mean(tones[False]))
    return bool(contrasts[1] > _CORNER_CONTRAST * contrasts[0])


def _outer(agreeing: set[At], known: set[At], inner: set[At]) -> set[At]:
    """Return the squares of the outermost rows and columns, where both light and dark ones are as they should be.

    Paper next to a board may look like its light squares, but not like the dark ones between them.
    """
    kept: set[At] = set()
    outer = known - inner
    for axis, step in ((0, -1), (0, 1), (1, -1), (1, 1)):
        # Each outer square belongs to the line of those whose neighbour towards the board is an inner one.
        lines: dict[int, set[At]] = {}
        for at in outer:
            towards = (at[0] - step, at[1]) if axis == 0 else (at[0], at[1] - step)
            if towards in inner:
                lines.setdefault(at[axis], set()).add(at)
        for line in lines.values():
            right = line & agreeing
            if len({sum(at) % 2 for at in right}) == 2 and len(right) >= _AGREEING * len(line):
                kept |= right
    # A corner of the board hangs on two accepted lines.
    for i, j in outer & agreeing - kept:
        rows, columns = {(i - 1, j), (i + 1, j)} & kept, {(i, j - 1), (i, j + 1)} & kept
        if rows and columns:
            kept.add((i, j))
    return kept


def _shapes(squares: dict[At, tuple[PolygonShape, bool]], margin_rel: float) -> tuple[PolygonShape, ...]:
    top, left = min(i for i, _ in squares), min(j for _, j in squares)
    shapes = []
    for (i, j), (square, light) in squares.items():
        name = f"r{i - top + 1}c{j - left + 1}-{'light' if light else 'dark'}"
        ends = np.array((*square.corners, square.corners[0]))
        side_px = float(np.linalg.norm(np.diff(ends, axis=0), axis=1).min())
        shapes.append(
            PolygonShape(name, inset(Roi(name, square.corners), max(_LEAST_MARGIN_PX, margin_rel * side_px)).corners)
        )
    return tuple(shapes)
