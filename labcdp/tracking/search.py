"""Search for a template in a part of a frame, in several sizes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, scaling, shift
from .template import Template
from .view import View

#: Longest side of the template that is searched with.
_LONGEST = 24
#: Sizes that are looked for, over that of the view.
SIZES = (1.0, 0.87, 1.15)


def candidates(view: View, template: Template, most: int) -> list[Matrix]:
    """Up to `most` guesses, template to view pixels, best first.

    Notes
    -----
    Peaks of the correlation after removal of the mean, in an image reduced until the template is small.
    """
    import cv2

    reduction = min(_LONGEST / max(template.shape), 1.0)
    picture = _reduced(view.values, reduction)
    found: list[tuple[float, Matrix]] = []
    for size in SIZES:
        pattern = _reduced(template.values, reduction * size)
        if pattern.shape[0] > picture.shape[0] or pattern.shape[1] > picture.shape[1] or min(pattern.shape) < 3:
            continue
        answers = cv2.matchTemplate(picture, pattern, cv2.TM_CCOEFF_NORMED)
        answers[~np.isfinite(answers)] = -1
        for _ in range(2):
            _, best, _, (x, y) = cv2.minMaxLoc(answers)
            if best < 0.3:
                break
            scale_x, scale_y = pattern.shape[1] / template.shape[1], pattern.shape[0] / template.shape[0]
            in_picture = shift(x, y) @ scaling(scale_x, scale_y)
            back = scaling(view.values.shape[1] / picture.shape[1], view.values.shape[0] / picture.shape[0])
            found.append((best, back @ in_picture))
            away_x, away_y = max(pattern.shape[1] // 3, 2), max(pattern.shape[0] // 3, 2)
            answers[max(y - away_y, 0) : y + away_y + 1, max(x - away_x, 0) : x + away_x + 1] = -1
    found.sort(key=lambda item: -item[0])
    return [matrix for _, matrix in found[:most]]


def _reduced(image: NDArray[np.float32], reduction: float) -> NDArray[np.float32]:
    import cv2

    size = max(round(image.shape[1] * reduction), 1), max(round(image.shape[0] * reduction), 1)
    how = cv2.INTER_AREA if reduction < 1 else cv2.INTER_LINEAR
    smaller: NDArray[np.float32] = cv2.resize(image, size, interpolation=how)
    return smaller
