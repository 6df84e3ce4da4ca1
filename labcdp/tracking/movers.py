"""Rough guesses of where a target went since the last frame, by the trackers of OpenCV and by optical flow."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, inverse, moved, shift, transform
from .template import Template
from .view import View
from .view_kernel import patch_around

#: Longest side in pixels of what a correlation filter of each kind looks at: more costs much time.
_KCF_PX, _CSRT_PX = 12, 40
#: Pixels by which a filter may differ from what was found before it is started anew.
_OFF_PX = 2.0
#: Points followed by optical flow, and their least distance in pixels.
_POINTS, _APART_PX = 60, 3.0
#: Pixels by which a point may miss where it started when it is followed forth and back.
_FORTH_AND_BACK_PX = 0.7


class Mover(Protocol):
    """Guesses where the target is in the next view, and is told where it was found."""

    def propose(self, view: View, expected: Matrix) -> Matrix | None:
        """Template to view pixels, given where the target is `expected`; None without a guess."""
        ...

    def settle(self, view: View, found: Matrix) -> None:
        """Learn where the target is in this view."""
        ...


def make_mover(method: str, template: Template) -> Mover:
    """Mover of a tracking method."""
    if method == "kcf":
        return _FilterMover(template, _KCF_PX, _kcf)
    if method == "csrt":
        return _FilterMover(template, _CSRT_PX, _csrt)
    return _FlowMover(template)


def _kcf() -> Any:
    import cv2

    contrib: Any = cv2
    parameters = contrib.TrackerKCF_Params()
    # What it looks at is grey: names of colours say no more of it than its brightness, and take the most time.
    parameters.desc_pca = parameters.desc_npca = contrib.TrackerKCF_GRAY
    parameters.compressed_size = 1
    return contrib.TrackerKCF_create(parameters)


def _csrt() -> Any:
    import cv2

    contrib: Any = cv2
    parameters = contrib.TrackerCSRT_Params()
    parameters.template_size = 80
    parameters.number_of_scales = 9
    return contrib.TrackerCSRT_create(parameters)


class _FilterMover:
    """A correlation filter that is shown the surroundings of where the target is expected, always in one size.

    So the filter follows what scale it may, and pays for no large image.
    """

    def __init__(self, template: Template, longest: int, make: Any) -> None:
        self._make = make
        height, width = template.shape
        self._middle = width / 2, height / 2
        self._scale = min(longest / max(template.shape), 1.0)
        self._box = max(round(width * self._scale), 4), max(round(height * self._scale), 4)
        self._side = 3 * max(*self._box, 12)
        self._filter: Any = None
        # Middle of the target in the view as expected, and from there to the filter's box, in patch pixels.
        self._expected = self._offset = (0.0, 0.0)
        # From the middle of the box to where the target was found: boxes move by whole pixels.
        self._missed = (0.0, 0.0)

    def propose(self, view: View, expected: Matrix) -> Matrix | None:
        if self._filter is None:
            return None
        self._expected = moved(expected, *self._middle)
        found, box = self._filter.update(self._patch(view))
        if not found:
            self._filter = None
            return None
        self._offset = box[0] + box[2] / 2 - self._side / 2, box[1] + box[3] / 2 - self._side / 2
        x, y = ((offset + missed) / self._scale for offset, missed in zip(self._offset, self._missed, strict=True))
        return shift(x, y) @ expected

    def settle(self, view: View, found: Matrix) -> None:
        here = moved(found, *self._middle)
        self._missed = self._from_box(here)
        if self._filter is not None and max(map(abs, self._missed)) <= _OFF_PX:
            return
        self._expected = here
        self._filter = self._make()
        left, top = (self._side - self._box[0]) // 2, (self._side - self._box[1]) // 2
        self._filter.init(self._patch(view), (left, top, *self._box))
        self._offset = left + self._box[0] / 2 - self._side / 2, top + self._box[1] / 2 - self._side / 2
        self._missed = self._from_box(here)

    def _from_box(self, there: tuple[float, float]) -> tuple[float, float]:
        """From the middle of the filter's box to a point of the view, in patch pixels."""
        (x, y), (u, v), (a, b) = there, self._expected, self._offset
        return (x - u) * self._scale - a, (y - v) * self._scale - b

    def _patch(self, view: View) -> NDArray[np.uint8]:
        """Surroundings of what is expected."""
        image = view.pixels if self._scale == 1 else view.values
        return patch_around(image, *self._expected, self._scale, self._side)


def warped(image: NDArray[Any], matrix: Matrix, size: tuple[int, int]) -> NDArray[Any]:
    """Image of `size` (width, height) that `matrix` makes of an image; its border goes on outside."""
    import cv2

    # OpenCV has the middle of the first pixel at 0, we have its corner there.
    centres = shift(-0.5, -0.5) @ matrix @ shift(0.5, 0.5)
    result: NDArray[Any] = cv2.warpAffine(
        image, centres[:2], size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return result


class _FlowMover:
    """Points on the target followed by optical flow (pyramid of Lucas and Kanade), and their common motion."""

    def __init__(self, template: Template) -> None:
        self._template = template
        self._last: NDArray[np.uint8] | None = None
        self._points = np.empty((0, 2), np.float32)
        self._last_pose = np.eye(3)
        height, width = template.shape
        self._reach = max(12, max(template.shape) // 2)
        self._size = width + 2 * self._reach, height + 2 * self._reach

    def propose(self, view: View, expected: Matrix) -> Matrix | None:
        import cv2

        if self._last is None or len(self._points) < 4:
            return None
        to_patch = self._patch_of(expected)
        patch = warped(view.sharp, to_patch, self._size)
        here, found, _ = cv2.calcOpticalFlowPyrLK(self._last, patch, self._points, None, winSize=(11, 11), maxLevel=2)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(patch, self._last, here, None, winSize=(11, 11), maxLevel=2)
        missed = np.abs(back - self._points).max(axis=1)
        good = (found.ravel() == 1) & (returned.ravel() == 1) & (missed < _FORTH_AND_BACK_PX)
        if np.count_nonzero(good) < 4:
            return None
        half = shift(0.5, 0.5)
        motion = half @ common_motion(self._points[good], here[good]) @ inverse(half)
        pose: Matrix = inverse(to_patch) @ motion @ self._last_pose
        return pose

    def settle(self, view: View, found: Matrix) -> None:
        import cv2

        to_patch = self._patch_of(found)
        self._last = warped(view.sharp, to_patch, self._size)
        self._last_pose = to_patch @ found
        height, width = self._template.shape
        corners = transform(self._last_pose, np.array([(0, 0), (width, 0), (width, height), (0, height)], dtype=float))
        mask = np.zeros(self._last.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.round(corners).astype(np.int32), 255)
        points = cv2.goodFeaturesToTrack(self._last, _POINTS, 0.02, _APART_PX, mask=mask, blockSize=5)
        self._points = np.empty((0, 2), np.float32) if points is None else points.reshape(-1, 2)

    def _patch_of(self, to_view: Matrix) -> Matrix:
        height, width = self._template.shape
        x, y = moved(to_view, width / 2, height / 2)
        return shift(self._size[0] / 2 - x, self._size[1] / 2 - y)


def common_motion(before: NDArray[Any], after: NDArray[Any]) -> Matrix:
    """Shift, scale and rotation that most points share: least squares, reweighted from the median shift on.

    Notes
    -----
    Nothing is drawn at random, so the result is the same each time.
    """
    a, b = before.astype(np.float64), after.astype(np.float64)
    motion = shift(*np.median(b - a, axis=0))
    for _ in range(8):
        off = np.hypot(*(transform(motion, a) - b).T)
        weights = 1 / np.square(1 + np.square(off / max(2.0 * float(np.median(off)), 0.2)))
        middle_a, middle_b = np.average(a, axis=0, weights=weights), np.average(b, axis=0, weights=weights)
        u, v = a - middle_a, b - middle_b
        spread = float((weights * (u * u).sum(axis=1)).sum())
        if spread < 1e-6:
            break
        cosine = float((weights * (u * v).sum(axis=1)).sum()) / spread
        sine = float((weights * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])).sum()) / spread
        turned = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
        motion = shift(*middle_b) @ turned @ shift(*-middle_a)
    return motion
