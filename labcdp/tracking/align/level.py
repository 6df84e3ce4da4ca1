"""One size of a template, and steps that align it with a view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import Matrix, around, inverse, scaling
from .template import Template, gradients
from .view import View

#: Generators of the ways a target may move: right, down, larger, turned; and sheared, stretched and tilted.
_SIMILAR = (
    [0, 0, 1, 0, 0, 0, 0, 0, 0],
    [0, 0, 0, 0, 0, 1, 0, 0, 0],
    [1, 0, 0, 0, 1, 0, 0, 0, 0],
    [0, -1, 0, 1, 0, 0, 0, 0, 0],
)
_PLANAR = (
    *_SIMILAR,
    [0, 1, 0, 1, 0, 0, 0, 0, 0],
    [1, 0, 0, 0, -1, 0, 0, 0, 0],
    [0, 0, 0, 0, 0, 0, 1, 0, 0],
    [0, 0, 0, 0, 0, 0, 0, 1, 0],
)
#: Step beyond which each of them is held back where the image says little, in parts of half the template.
_STEPS = (1.0, 1.0, 0.02, 0.02, 0.005, 0.005, 0.003, 0.003)
#: Template pixels of a step after which no other one is made.
_STILL_PX = 0.02
#: Residuals from which on pixels count little, in standard deviations of the residuals.
_ROBUST = 2.5
#: Residual that is always allowed, in parts of the template's structure: interpolation, blur.
_ALLOWED = 0.06
#: Pixels without which nothing is said.
_PIXELS_LEAST = 6
#: Factor by which residuals must be smaller for a light that was not expected.
_CHANGED = 0.75
#: Least and most change of the light between the first frame and this one.
_GAIN_LEAST, _GAIN_MOST = 0.05, 12.0
#: Pixels from which on only every fourth one goes into a median.
_MANY = 800

#: Gain and offset of a frame's light: DN = gain * DN of the first frame + offset.
GainOffset = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Seen:
    """What a view shows under a template.

    Parameters
    ----------
    values, trusted : ndarray of float32, shape (n,)
        The view there, and how far each pixel counts: 0 outside the image.
    light : (float, float)
        Gain and offset.
    expected : float or None
        Gain that was expected.
    residuals, robust : ndarray of float32, shape (n,)
        What is left of the view in the template's DN, and how far each pixel fits.
    spread : float
        Standard deviation of most residuals.
    """

    values: NDArray[np.float32]
    trusted: NDArray[np.float32]
    light: GainOffset
    expected: float | None
    residuals: NDArray[np.float32]
    robust: NDArray[np.float32]
    spread: float


class Level:
    """A template in one size, with all that does not change from frame to frame."""

    def __init__(self, template: Template, values: NDArray[np.float32], planar: bool, coarse: bool) -> None:
        import cv2

        height, width = template.shape
        size = (max((width + 1) // 2, 3), max((height + 1) // 2, 3)) if coarse else (width, height)
        if coarse:
            values = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA))
        # Level pixels to template pixels, and these to coordinates of about -1 to 1.
        self._to_template = scaling(width / size[0], height / size[1])
        half = max(width, height) / 2
        self._centred = around(scaling(1 / half), width / 2, height / 2)
        self._centred[:2, 2] = -width / 2 / half, -height / 2 / half
        self._from_centred = inverse(self._centred)
        self._generators = np.array(_PLANAR if planar else _SIMILAR, dtype=float).reshape(-1, 3, 3)
        self._jacobian = _jacobian(values, self._centred @ self._to_template, self._generators)
        self._damping = np.array([*(1 / np.square(_STEPS[: len(self._generators)])), 0.0, 0.0])
        self._size = size
        self._values = values.ravel()
        self._middle = np.float32(values.mean())
        self._deviations = self._values - self._middle
        self._every = 4 if values.size > _MANY else 1
        self._still = _STILL_PX / half
        self._trust = np.ones(values.size, np.float32)
        self.structure = float(values.std())
        self.noise = template.noise_dn

    def trust_in(self, trust: NDArray[np.float32]) -> None:
        """Let each template pixel count as far as it is trusted."""
        import cv2

        if self._size != trust.shape[::-1]:
            trust = np.asarray(cv2.resize(trust, self._size, interpolation=cv2.INTER_AREA))
        self._trust = np.square(trust.ravel())

    @property
    def trust(self) -> NDArray[np.float32]:
        """Weight of each pixel."""
        return self._trust

    def improve(
        self, view: View, place: Matrix, steps: int, lights: list[GainOffset]
    ) -> tuple[Matrix, GainOffset] | None:
        """Make up to `steps` steps from `place`; the new place, and the light before the last one. None: led nowhere.

        `lights` are guesses.
        """
        light, seen = None, None
        for _ in range(steps):
            seen = self.look(view, place, lights) if seen is None else self._look_on(view, place, seen)
            if seen is None:
                return None
            light = seen.light
            step = self._step(seen)
            change = np.eye(3) + np.tensordot(step, self._generators, 1)
            place = place @ self._from_centred @ inverse(change) @ self._centred
            if not np.isfinite(place).all() or place[2, 2] == 0:
                return None
            place = place / place[2, 2]
            if float(np.abs(step).max()) < self._still:
                break
        return None if light is None else (place, light)

    def look(self, view: View, place: Matrix, lights: list[GainOffset]) -> Seen | None:
        """Compare the view at a place with the template, starting from guesses of the light.

        A large bright thing in front of the target spoils a start from all pixels, but not one from a known light.
        """
        values, trusted = self._sample(view, place)
        best: Seen | None = None
        for light in (*lights, None):
            if best is not None and _CHANGED * best.spread <= max(self.noise, _ALLOWED * self.structure):
                break
            seen = self._lit(values, trusted, light)
            # A guess is kept unless the light has clearly changed.
            if seen is not None and (best is None or seen.spread < _CHANGED * best.spread):
                best = seen
        return best

    def _look_on(self, view: View, place: Matrix, before: Seen) -> Seen | None:
        """Compare the view a step further."""
        values, trusted = self._sample(view, place)
        found = self._fit(values, trusted * before.robust, before.expected)
        return None if found is None else self._compare(values, trusted, found, before.expected)

    def _sample(self, view: View, place: Matrix) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        to_view = place @ self._to_template
        values = view.under(view.to_image @ to_view, self._size[::-1])
        trusted = self._trust
        left, top, right, bottom = view.bounds
        width, height = self._size
        corners = np.array([(0, 0, 1), (width, 0, 1), (width, height, 1), (0, height, 1)], dtype=float) @ to_view.T
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = corners[:, 0] / corners[:, 2], corners[:, 1] / corners[:, 2]
        inside = (x >= left) & (x <= right) & (y >= top) & (y <= bottom) & (corners[:, 2] > 0)
        if not inside.all():
            trusted = np.where(self._inside(to_view, view), trusted, np.float32(0))
        return values, trusted

    def _inside(self, to_view: Matrix, view: View) -> NDArray[np.bool_]:
        """Which pixels lie in the image."""
        left, top, right, bottom = view.bounds
        u, v = np.meshgrid(np.arange(self._size[0]) + 0.5, np.arange(self._size[1]) + 0.5)
        x, y, w = (a * u + b * v + c for a, b, c in to_view)
        return np.asarray(
            (x > left * w) & (x < right * w) & (y > top * w) & (y < bottom * w) & (w > 0), dtype=np.bool_
        ).ravel()

    def _lit(self, values: NDArray[np.float32], trusted: NDArray[np.float32], light: GainOffset | None) -> Seen | None:
        """Gain and offset by weighted least squares, weighted anew three times, from a guess or from all pixels."""
        expected = None if light is None else light[0]
        seen = None if light is None else self._compare(values, trusted, light, expected)
        for _ in range(3):
            found = self._fit(values, trusted if seen is None else trusted * seen.robust, expected)
            if found is None:
                return None
            seen = self._compare(values, trusted, found, expected)
        return seen

    def _fit(
        self, values: NDArray[np.float32], weights: NDArray[np.float32], expected: float | None
    ) -> GainOffset | None:
        """Gain and offset.

        An expected gain counts as much as the whole template: a patch and changing surroundings contain little
        information on it.
        """
        total = float(weights.sum())
        if not total >= _PIXELS_LEAST:
            return None
        weighted = weights * self._deviations
        known = values - self._middle
        mean_t, mean_v = float(weighted.sum()) / total, float(weights @ known) / total
        power = float(weighted @ self._deviations) - mean_t * mean_t * total
        gain = (float(weighted @ known) - mean_t * mean_v * total) / power if power > 0 else 0.0
        if expected is not None:
            whole = self.structure**2 * values.size
            gain = (power * gain + whole * expected) / (power + whole)
        if not _GAIN_LEAST < gain < _GAIN_MOST:
            return None
        middle = float(self._middle)
        return gain, mean_v + middle - gain * (middle + mean_t)

    def _compare(
        self, values: NDArray[np.float32], trusted: NDArray[np.float32], light: GainOffset, expected: float | None
    ) -> Seen:
        gain, offset = light
        residuals = values * np.float32(1 / gain) - self._values
        residuals -= np.float32(offset / gain)
        some = np.abs(residuals[:: self._every])
        spread = max(
            1.4826 * float(np.partition(some, some.size // 2)[some.size // 2]),
            self.noise * (1 + 1 / gain**2) ** 0.5,
            _ALLOWED * self.structure,
        )
        robust = np.square(residuals * np.float32(1 / (_ROBUST * spread)))
        robust += 1
        np.square(robust, out=robust)
        np.reciprocal(robust, out=robust)
        return Seen(values, trusted, light, expected, residuals, robust, spread)

    def _step(self, seen: Seen) -> NDArray[np.float64]:
        """Gauss-Newton step along each generator, light found along with it."""
        weights = seen.trusted * seen.robust
        weighted = self._jacobian * weights
        products = (weighted @ self._jacobian.T).astype(np.float64)
        pull = (weighted @ seen.residuals).astype(np.float64)
        scatter = float((weights * seen.residuals) @ seen.residuals)
        least = max(scatter / max(float(weights.sum()), 1e-9), self.noise**2)
        diagonal = np.diag_indices_from(products)
        products[diagonal] += self._damping * least + 1e-6 * products[diagonal] + 1e-9
        try:
            step = np.asarray(np.linalg.solve(products, pull), dtype=np.float64)[: len(self._generators)]
        except np.linalg.LinAlgError:
            return np.zeros(len(self._generators))
        return step


def _jacobian(values: NDArray[np.float32], to_centred: Matrix, generators: NDArray[np.float64]) -> NDArray[np.float32]:
    """Change of each pixel along each generator, deviations of the pixels, and ones: shape (m + 2, n)."""
    height, width = values.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    u, v = to_centred[0, 0] * x + to_centred[0, 2], to_centred[1, 1] * y + to_centred[1, 2]
    dx, dy = gradients(values)
    along, down = dx / to_centred[0, 0], dy / to_centred[1, 1]
    columns = []
    for (a, b, c), (d, e, f), (g, h, i) in generators:
        w = g * u + h * v + i
        columns.append(along * (a * u + b * v + c - u * w) + down * (d * u + e * v + f - v * w))
    rows = np.stack([*columns, values - values.mean(), np.ones_like(values)])
    return rows.reshape(-1, values.size).astype(np.float32)
