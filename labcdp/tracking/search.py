"""Search of a region in the whole frame, by how it looked at a glance."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, dist, floor

import numpy as np
from numpy.typing import NDArray

from .frame import GreyFrame
from .geometry import Matrix, box_of, moved, shift
from .settings import SETTINGS

#: Sizes of the first look that are searched besides the last one's.
_SIZES = (0.87, 1.15)


@dataclass(frozen=True, eq=False)
class Look:
    """How a region looked in a frame.

    Parameters
    ----------
    pixels : ndarray of float32, shape (h, w)
        What lay under the box around it.
    corner : (int, int)
        Left and top end of the box in the frame.
    to_image : ndarray of float, shape (3, 3)
        Template pixels to pixels of that frame.
    """

    pixels: NDArray[np.float32]
    corner: tuple[int, int]
    to_image: Matrix


def look_at(frame: GreyFrame, to_image: Matrix, patch: tuple[float, float, float, float]) -> Look | None:
    """Look of a region whose patch lies at `patch` (left, top, right, bottom) of the template; None if not in frame."""
    left, top, right, bottom = box_of(to_image @ shift(patch[0], patch[1]), patch[2] - patch[0], patch[3] - patch[1])
    height, width = frame.shape
    if not (left > -0.5 and top > -0.5 and right < width + 0.5 and bottom < height + 0.5):
        return None
    x, y = max(floor(left), 0), max(floor(top), 0)
    return Look(frame.part(x, y, min(ceil(right), width), min(ceil(bottom), height)), (x, y), to_image)


def candidates(
    frame: GreyFrame, looks: list[tuple[Look, float]], most: int, peaks: int = SETTINGS.search_peaks
) -> list[Matrix]:
    """Up to `most` places where a region may be, template to frame pixels, best first.

    Parameters
    ----------
    looks : list of (Look, float)
        Appearance, and the size that each is expected in, relative to its own.
    peaks : int
        Places of each look and size.

    Notes
    -----
    Peaks of the correlation after removal of the mean, in the frame reduced until the look is small.
    """
    import cv2

    match: list[tuple[float, float, Matrix]] = []
    height, width = frame.shape
    pictures: dict[tuple[int, int], NDArray[np.float32]] = {}
    for look, expected in looks:
        longest = expected * max(look.pixels.shape)
        reduction = min(SETTINGS.search_side_px / longest, SETTINGS.search_frame_px / max(height, width), 1.0)
        shape = max(round(reduction * width), 1), max(round(reduction * height), 1)
        if shape not in pictures:
            pictures[shape] = frame.reduced(0, 0, width, height, shape)
        picture = pictures[shape]
        for size in (1.0, *_SIZES):
            scale = expected * size
            across, down = (max(round(reduction * scale * side), 1) for side in look.pixels.shape[::-1])
            if across > shape[0] or down > shape[1] or min(across, down) < 3:
                continue
            how = cv2.INTER_AREA if reduction * scale < 1 else cv2.INTER_LINEAR
            pattern = cv2.resize(look.pixels, (across, down), interpolation=how)
            answers = np.nan_to_num(cv2.matchTemplate(picture, pattern, cv2.TM_CCOEFF_NORMED), nan=-1.0)
            for score, x, y in _peaks(
                answers, max(SETTINGS.search_apart_share * across, 2), max(SETTINGS.search_apart_share * down, 2), peaks
            ):
                placed = shift(x * width / shape[0], y * height / shape[1]) @ np.diag([scale, scale, 1.0])
                match.append((score, scale * longest, placed @ shift(-look.corner[0], -look.corner[1]) @ look.to_image))
    return _distinct(match, most)


def _peaks(answers: NDArray[np.float32], across: float, down: float, most: int) -> list[tuple[float, float, float]]:
    """Highest answers that are apart from each other, with their places."""
    import cv2

    peaks = []
    answers = answers.copy()
    for _ in range(most):
        _, best, _, (x, y) = cv2.minMaxLoc(answers)
        if best < SETTINGS.search_correlation:
            break
        peaks.append((best, float(x), float(y)))
        answers[max(y - ceil(down), 0) : y + ceil(down) + 1, max(x - ceil(across), 0) : x + ceil(across) + 1] = -1
    return peaks


def _distinct(match: list[tuple[float, float, Matrix]], most: int) -> list[Matrix]:
    """Keep the best of each place."""
    kept: list[tuple[tuple[float, float], Matrix]] = []
    for _, size, matrix in sorted(match, key=lambda item: -item[0]):
        (middle,) = moved(matrix, (0, 0))
        if all(dist(middle, other) > SETTINGS.search_apart_share * size / 2 for other, _ in kept):
            kept.append((middle, matrix))
    return [matrix for _, matrix in kept[:most]]
