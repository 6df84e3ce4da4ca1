"""Whether a template occurs again near its place, as on a checkerboard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .template import Template
from .view import view_around

#: Correlation from which on two places look the same.
_SAME = 0.85
#: Pixels around that are searched: in parts of the window, and at least.
_REACH, _REACH_LEAST = 1.0, 48.0


def repeat_px(grey: NDArray[np.uint8], template: Template) -> float:
    """Distance in pixels to the nearest other place in the first frame that looks the same; infinite without one.

    Notes
    -----
    Correlation after removal of the mean. What is joined to the place itself (an edge along which the template may
    be shifted) is no other place.
    """
    import cv2

    reach = max(_REACH * max(template.shape) / template.reduction, _REACH_LEAST)
    view = view_around(grey, template, template.to_image, reach)
    if view is None or view.values.shape[0] < template.shape[0] or view.values.shape[1] < template.shape[1]:
        return float("inf")
    answers = cv2.matchTemplate(view.values, template.values, cv2.TM_CCOEFF_NORMED)
    here = (view.from_image @ template.to_image)[:2, 2]
    column = min(max(round(float(here[0])), 0), answers.shape[1] - 1)
    row = min(max(round(float(here[1])), 0), answers.shape[0] - 1)
    same = (answers > _SAME).astype(np.uint8)
    same[row, column] = 1
    count, labels = cv2.connectedComponents(same, connectivity=8)
    nearest = float("inf")
    for label in range(1, count):
        if label != labels[row, column]:
            _, _, _, (x, y) = cv2.minMaxLoc(answers, (labels == label).astype(np.uint8))
            nearest = min(nearest, float(np.hypot(x - here[0], y - here[1])) / template.reduction)
    return nearest
