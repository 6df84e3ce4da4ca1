"""The scene as a whole: whether it changes at once or is not visible, and how it moves in the image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .frame import GreyFrame, median, noise_dn
from .geometry import Matrix, inverse, scaling, shift, transform
from .settings import SETTINGS

#: Most rows and columns of the very small picture; rows and columns of parts of the frame with a point each; pixels
#: around one in which contrast is made the same.
_SIZE, _PARTS, _LOCAL = (32, 48), (8, 12), (17, 17)


class SceneNow:
    """What became of the scene in a frame; its motion is found when it is asked for.

    Parameters
    ----------
    change : str
        ``blank`` for a frame with nothing in it, ``cut`` for another scene, else an empty text.
    light, contrast : float
        Median and standard deviation of the frame in DN.
    motion : callable
        Finds the scene's number and how things at rest moved since it was first seen, in pixels; None if not known.
    """

    def __init__(
        self, change: str, light: float, contrast: float, motion: Callable[[], tuple[int, Matrix] | None]
    ) -> None:
        self.change, self.light, self.contrast = change, light, contrast
        self._motion: Callable[[], tuple[int, Matrix] | None] | None = motion
        self._found: tuple[int, Matrix] | None = None

    def moved_since(self, then: SceneNow) -> Matrix | None:
        """Pixels of an earlier frame to those of this one, for things at rest; None if not known."""
        # The earlier one is found first: what is known of it leads to this one.
        before, now = then._at(), self._at()
        if before is None or now is None or before[0] != now[0]:
            return None
        motion: Matrix = now[1] @ inverse(before[1])
        return motion

    def light_over(self, then: SceneNow) -> float:
        """Light over that of an earlier frame, 1 if it is not known."""
        if self.change == "cut" or min(self.light, then.light) < SETTINGS.scene_light_dn:
            return 1.0
        change = self.light / then.light
        if not 1 / SETTINGS.scene_light_jump < change < SETTINGS.scene_light_jump:
            return change
        # Light on everything changes the contrast as much, a veil against it, and what comes into frame either way.
        low, high = sorted((change, self.contrast / max(then.contrast, 1e-9)))
        return min(max(low, 1.0), high)

    def _at(self) -> tuple[int, Matrix] | None:
        if self._motion is not None:
            self._found, self._motion = self._motion(), None
        return self._found


class SceneMotion:
    """Compares each frame, made small, with the one before and with one in which its points were chosen."""

    _key: NDArray[np.uint8]
    _points: NDArray[np.float32]

    def __init__(self, frame: GreyFrame) -> None:
        self._last = _tiny(frame)
        self._last_cells = frame.shape[0] * frame.shape[1] / self._last.size
        self._epoch = self._epochs = self._frames = 0
        self._median = median(frame.small)
        self._noise = noise_dn(
            frame.part(
                0, 0, min(frame.shape[1], SETTINGS.noise_sample_px), min(frame.shape[0], SETTINGS.noise_sample_px)
            )
        )
        self._start(_grey(frame.small), np.eye(3))
        self._beginning = self._key, self._points

    def look(self, frame: GreyFrame) -> SceneNow:
        """Compare the next frame."""
        this = _tiny(frame)
        power = float(np.vdot(this, this))
        if power < SETTINGS.blank_dn**2 * this.size:
            return SceneNow("blank", self._median, 0.0, lambda: None)
        last, self._last = self._last, this
        powers = power * float(np.vdot(last, last))
        self._median = median(frame.small[::3, ::3])
        cut = powers == 0 or float(np.vdot(this, last)) < SETTINGS.cut_correlation * powers**0.5
        small, factor = frame.small, scaling(frame.reduction)

        def motion() -> tuple[int, Matrix]:
            grey = _grey(small)
            moved = None if cut else self._moved(grey)
            if moved is None:
                moved = self._begun_again(grey)
            return self._epoch, inverse(factor) @ moved @ factor

        now = SceneNow("cut" if cut else "", self._median, (power / this.size) ** 0.5, motion)
        # Another scene begins with its first frame; points that are not followed for long are not found again.
        self._frames += 1
        if cut or self._frames % SETTINGS.scene_every_frames == 0:
            now.moved_since(now)
        return now

    def _begun_again(self, grey: NDArray[np.uint8]) -> Matrix:
        """Start anew with another scene, or with the first one if that is there again."""
        self._key, self._points = self._beginning
        self._key_motion = self._since_key = np.eye(3)
        self._epoch = 0
        small = self._moved(grey)
        if small is not None:
            return small
        self._epochs += 1
        self._epoch = self._epochs
        self._start(grey, np.eye(3))
        return np.eye(3)

    @property
    def now(self) -> SceneNow:
        """The first frame."""
        return SceneNow("", self._median, float(self._last.std()), lambda: (0, np.eye(3)))

    @property
    def holds(self) -> bool:
        """Whether there is enough in the scene to tell where a plain region of it is."""
        pixels = self._last_cells
        return (
            len(self._points) >= SETTINGS.scene_points
            and float(self._last.std()) > SETTINGS.scene_clear_noise * self._noise / pixels**0.5
        )

    def _start(self, grey: NDArray[np.uint8], motion: Matrix) -> None:
        """Choose points in a frame to which the scene moved by `motion`."""
        import cv2

        # The best of each part of the frame, so that no single thing has most of them.
        answers = cv2.cornerMinEigenVal(grey, 5)
        rows, columns = _PARTS
        points: list[tuple[int, int]] = []
        for row in range(rows):
            for column in range(columns):
                top, left = row * grey.shape[0] // rows, column * grey.shape[1] // columns
                part = answers[top : (row + 1) * grey.shape[0] // rows, left : (column + 1) * grey.shape[1] // columns]
                # Of a frame of a few pixels some have none.
                _, best, _, (x, y) = cv2.minMaxLoc(part) if part.size else (0, 0.0, 0, (0, 0))
                if best > SETTINGS.scene_corner:
                    points.append((left + x, top + y))
        self._points = np.array(points, np.float32).reshape(-1, 1, 2)
        self._key = grey
        self._key_motion, self._since_key = motion, np.eye(3)

    def _moved(self, grey: NDArray[np.uint8]) -> Matrix | None:
        """How the scene moved since the start of its epoch, in pixels of the small frame; None if that is lost."""
        import cv2

        if len(self._points) < SETTINGS.scene_points:
            return None
        before = self._points.reshape(-1, 2) + 0.5
        guess = (transform(self._since_key, before) - 0.5).astype(np.float32).reshape(-1, 1, 2)
        there, match, _ = cv2.calcOpticalFlowPyrLK(
            self._key, grey, self._points, guess, winSize=(15, 15), maxLevel=3, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
        good = match.ravel() == 1
        if np.count_nonzero(good) < SETTINGS.scene_points:
            return None
        after = there.reshape(-1, 2) + 0.5

        def near_of(guess: Matrix) -> NDArray[np.bool_]:
            return np.asarray(
                good & (np.hypot(*(transform(guess, before) - after).T) < SETTINGS.scene_with_px), dtype=np.bool_
            )

        # What moves before the scene may have more of the points than the scene itself.
        motion, share = None, 0.0
        for start in (np.eye(3), self._since_key, None):
            if share > 1 - SETTINGS.scene_lead_share:
                break
            near = near_of(common_motion(before[good], after[good]) if start is None else start)
            if float(near.mean()) > max(share + SETTINGS.scene_lead_share, SETTINGS.scene_share):
                motion, share = common_motion(before[near], after[near]), float(near.mean())
        if motion is None:
            return None
        # A few points turn and stretch a scene that only moves.
        plain = shift(*(median(steps) for steps in (after - before)[near_of(motion)].T))
        if float(near_of(plain).mean()) > share - SETTINGS.scene_lead_share / 2:
            motion = plain
        self._since_key = motion
        now: Matrix = motion @ self._key_motion
        if share < SETTINGS.scene_share_new:
            self._start(grey, now)
        return now


def _grey(small: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Small frame with the same contrast everywhere, whatever the light."""
    import cv2

    deviations = small - cv2.blur(small, _LOCAL)
    contrast = cv2.blur(np.abs(deviations), _LOCAL) + np.float32(SETTINGS.scene_contrast_dn)
    return np.asarray(np.clip(128 + 40 * deviations / contrast, 0, 255), dtype=np.uint8)


def _tiny(frame: GreyFrame) -> NDArray[np.float32]:
    """Very small picture of a frame, less its mean."""
    import cv2

    rows, columns = (min(most, side) for most, side in zip(_SIZE, frame.small.shape, strict=True))
    tiny = cv2.resize(frame.small, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(tiny - tiny.mean(dtype=np.float64), dtype=np.float32)


def common_motion(before: NDArray[Any], after: NDArray[Any]) -> Matrix:
    """Shift, scale and rotation that most points share: least squares, reweighted from the median shift on.

    Notes
    -----
    Nothing is drawn at random, so the result is the same each time.
    """
    # A point as a complex number: turning and scaling are a factor.
    a, b = (points.astype(np.float64) @ (1, 1j) for points in (before, after))
    turn, step = 1 + 0j, complex(median((b - a).real), median((b - a).imag))
    for _ in range(8):
        off = np.abs(turn * a + step - b)
        weights = 1 / np.square(1 + np.square(off / max(2.0 * median(off), 0.2)))
        middle_a, middle_b = (complex(weights @ one) / float(weights.sum()) for one in (a, b))
        u, v = a - middle_a, b - middle_b
        spread = float(weights @ np.square(np.abs(u)))
        if spread < 1e-6:
            break
        turn = complex(weights @ (u.conj() * v)) / spread
        step = middle_b - turn * middle_a
    return np.array([[turn.real, -turn.imag, step.real], [turn.imag, turn.real, step.imag], [0.0, 0.0, 1.0]])
