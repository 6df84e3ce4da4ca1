"""One size of a template, and steps that align it with a view."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isnan, nan

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, inverse, scaling
from .sight import View
from .template import Template, gradients

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
#: Change of the light after which no other one is looked for: of the gain, and of the middle in parts of the structure.
_SETTLED = 1e-4
#: Pixels from which on only every fourth one goes into a median.
_MANY = 800

_Pixels = NDArray[np.float32]
#: Gain and offset of a frame's light: DN = gain * DN of the first frame + offset.
GainOffset = tuple[float, float]

_UNKNOWN: GainOffset = nan, 0.0


@dataclass(frozen=True, eq=False)
class Seen:
    """What a view shows under a template.

    Parameters
    ----------
    values, trusted : ndarray of float32, shape (n,)
        The view there, and how far each pixel counts: 0 outside the image.
    gain, offset : float
        Light: DN = gain * DN of the first frame + offset.
    residuals, robust : ndarray of float32, shape (n,)
        What is left of the view in the template's DN, and how far each pixel fits.
    spread : float
        Standard deviation of most residuals.
    """

    values: _Pixels
    trusted: _Pixels
    gain: float
    offset: float
    residuals: _Pixels
    robust: _Pixels
    spread: float


class Level:
    """A template in one size, with all that does not change from frame to frame.

    Attributes
    ----------
    trust : ndarray of float32, shape (n,)
        Weight of each pixel.
    structure, noise : float
        Standard deviation of the pixels, and that of their noise.
    """

    def __init__(self, template: Template, values: _Pixels, planar: bool, coarse: bool) -> None:
        import cv2

        height, width = template.shape
        size = (max((width + 1) // 2, 3), max((height + 1) // 2, 3)) if coarse else (width, height)
        if coarse:
            values = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA))
        # Level pixels to template pixels, and these to coordinates of about -1 to 1.
        self._size, self._to_template = size, scaling(width / size[0], height / size[1])
        half = max(width, height) / 2
        self._centred = scaling(1 / half)
        self._centred[:2, 2] = -width / 2 / half, -height / 2 / half
        self._from_centred, self._still = inverse(self._centred), _STILL_PX / half
        self._generators = np.array(_PLANAR if planar else _SIMILAR, dtype=float)
        self._damping = np.array([*(1 / np.square(_STEPS[: len(self._generators)])), 0.0, 0.0])
        self._jacobian = _jacobian(values, self._centred @ self._to_template, self._generators)
        self._values, self._middle = values.ravel(), float(values.mean())
        self.trust = np.ones(values.size, np.float32)
        self.structure, self.noise = float(values.std()), float(template.noise_dn)

    def trust_in(self, trust: _Pixels) -> None:
        """Let each template pixel count as far as it is trusted."""
        import cv2

        if trust.shape[::-1] != self._size:
            trust = np.asarray(cv2.resize(trust, self._size, interpolation=cv2.INTER_AREA))
        self.trust = np.square(trust).ravel()

    def improve(
        self, view: View, place: Matrix, steps: int, light: GainOffset | None
    ) -> tuple[Matrix, GainOffset] | None:
        """Make up to `steps` steps from `place`; the new place, and the light before the last one. None: led nowhere.

        `light` is a guess.
        """
        expected = light[0] if light else nan
        seen = self.look(view, place, light)
        for number in range(steps):
            if number and seen is not None:
                seen = self._relit(*self._sampled(view, place), seen, expected)
            if seen is None:
                return None
            try:
                step = self._step(seen)
                place = place @ self._from_centred @ inverse(np.eye(3) + (step @ self._generators).reshape(3, 3))
                place = place @ self._centred
            except np.linalg.LinAlgError:
                return None
            if not np.isfinite(place).all() or place[2, 2] == 0:
                return None
            place = place / place[2, 2]
            if np.abs(step).max() < self._still:
                break
        return None if seen is None else (place, (seen.gain, seen.offset))

    def look(self, view: View, place: Matrix, light: GainOffset | None) -> Seen | None:
        """Compare the view at a place with the template, starting from a guess of the light.

        A large bright thing in front of the target spoils a start from all pixels, but not one from a known light.
        """
        values, trusted = self._sampled(view, place)
        guessed = self._in_light(values, trusted, light or _UNKNOWN)
        # None fits better than one that leaves only noise.
        if light is None or (guessed is not None and _CHANGED * guessed.spread <= self._least_spread(guessed.gain)):
            return guessed
        seen = self._in_light(values, trusted, _UNKNOWN)
        # A guess is kept unless the light has clearly changed.
        return seen if seen and (guessed is None or seen.spread < _CHANGED * guessed.spread) else guessed

    def _sampled(self, view: View, place: Matrix) -> tuple[_Pixels, _Pixels]:
        """Values of a view under the template, interpolated, and how far they count."""
        values, inside = view.sampled(place @ self._to_template, self._size)
        return values, self.trust if inside is None else np.where(inside, self.trust, np.float32(0))

    def _in_light(self, values: _Pixels, trusted: _Pixels, light: GainOffset) -> Seen | None:
        """Compare a view in the light that is found in three steps: from a guess, or from all pixels without one."""
        if isnan(light[0]):
            seen: Seen | None = Seen(values, trusted, *light, values, np.ones_like(values), 0.0)
        else:
            seen = self._compared(values, trusted, light)
        for _ in range(3):
            before, seen = seen, seen and self._relit(values, trusted, seen, light[0])
            if before is None or seen is None or self._settled(before, seen):
                break
        return seen

    def _settled(self, before: Seen, now: Seen) -> bool:
        gain = now.gain - before.gain
        middle = gain * self._middle + now.offset - before.offset
        return max(abs(gain), abs(middle) / max(self.structure, 1e-9)) < _SETTLED * now.gain

    def _relit(self, values: _Pixels, trusted: _Pixels, seen: Seen, expected: float) -> Seen | None:
        """Compare a view in the light found by weighted least squares; None if that is not possible.

        An expected gain counts as much as the whole template: a patch and changing surroundings contain little
        information on it.
        """
        weights = trusted * seen.robust
        # Deviations of the template, and ones.
        of_light = self._jacobian[-2:]
        weighted = of_light * weights
        (square, of_template), (_, total) = (weighted @ of_light.T).tolist()
        if not total >= _PIXELS_LEAST:
            return None
        of_both, of_view = (weighted @ values).tolist()
        mean_t, mean_v = of_template / total, of_view / total
        power = square - mean_t * of_template
        gain = (of_both - mean_t * of_view) / power if power > 0 else 0.0
        if not isnan(expected):
            whole = self.structure**2 * values.size
            gain = (power * gain + whole * expected) / (power + whole)
        if not _GAIN_LEAST < gain < _GAIN_MOST:
            return None
        return self._compared(values, trusted, (gain, mean_v - gain * (self._middle + mean_t)))

    def _compared(self, values: _Pixels, trusted: _Pixels, light: GainOffset) -> Seen:
        """Compare a view with the template in a light."""
        gain, offset = light
        residuals = values * np.float32(1 / gain) - self._values - np.float32(offset / gain)
        some = np.abs(residuals[:: 4 if residuals.size > _MANY else 1])
        middle = 1.4826 * float(np.partition(some, some.size // 2)[some.size // 2])
        spread = max(middle, self._least_spread(gain))
        robust = 1 / np.square(1 + np.square(residuals * np.float32(1 / (_ROBUST * spread))))
        return Seen(values, trusted, gain, offset, residuals, robust, spread)

    def _least_spread(self, gain: float) -> float:
        """Spread of the residuals that noise, interpolation and blur leave in a light."""
        return max(self.noise * hypot(1, 1 / gain), _ALLOWED * self.structure)

    def _step(self, seen: Seen) -> NDArray[np.float64]:
        """Gauss-Newton step along each generator, light found along with it."""
        weights = seen.trusted * seen.robust
        weighted = self._jacobian * weights
        products = (weighted @ self._jacobian.T).astype(float)
        # The last row is of ones.
        scatter = float((weights * seen.residuals) @ seen.residuals) / max(float(products[-1, -1]), 1e-9)
        held_back = self._damping * max(scatter, self.noise**2) + 1e-6 * products.diagonal() + 1e-9
        products.flat[:: len(products) + 1] += held_back
        step = np.linalg.solve(products, (weighted @ seen.residuals).astype(float))
        return step[: len(self._generators)]


def _jacobian(values: _Pixels, to_centred: Matrix, generators: NDArray[np.float64]) -> _Pixels:
    """Change of each pixel along each generator, deviations of the pixels, and ones: shape (m + 2, n)."""
    height, width = values.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    u, v = to_centred[0, 0] * x + to_centred[0, 2], to_centred[1, 1] * y + to_centred[1, 2]
    dx, dy = gradients(values)
    along, down = dx / to_centred[0, 0], dy / to_centred[1, 1]
    columns = []
    for a, b, c, d, e, f, g, h, i in generators:
        w = g * u + h * v + i
        columns.append(along * (a * u + b * v + c - u * w) + down * (d * u + e * v + f - v * w))
    rows = np.stack([*columns, values - values.mean(), np.ones_like(values)])
    return rows.reshape(-1, values.size).astype(np.float32)
