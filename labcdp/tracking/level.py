"""One size of a template, and steps that align it with a view."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, around, inverse, scaling, shift
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

#: Residuals from which on pixels count little, in standard deviations of the residuals.
_ROBUST = 2.5
#: Residual that is always allowed, in parts of the template's structure: interpolation, blur.
_ALLOWED = 0.06
#: Pixels without which nothing is said.
_PIXELS_LEAST = 6
#: Template pixels of a step after which no other one is made.
_STILL_PX = 0.02
#: Factor by which residuals must be smaller for a light that was not expected.
_CHANGED = 0.75
#: Least and most change of the light between the first frame and this one.
_GAIN_LEAST, _GAIN_MOST = 0.05, 12.0

#: Coordinates from the middle of the first pixel to its corner, and back.
_TO_MIDDLES, _FROM_MIDDLES = shift(0.5, 0.5), shift(-0.5, -0.5)

#: Gain and offset of a frame's light: DN = gain * DN of the first frame + offset.
GainOffset = tuple[float, float]


class Light(NamedTuple):
    """Light of a view.

    Parameters
    ----------
    gain, offset : float
        DN of the view over those of the template.
    expected : float or None
        Gain that was expected and held on to.
    spread : float
        Standard deviation of most residuals.
    residuals : ndarray of float32, shape (n,)
        What is left of the view, in the template's DN.
    robust, weights : ndarray of float32, shape (n,)
        How far each pixel fits, and how far it counts.
    """

    gain: float
    offset: float
    expected: float | None
    spread: float
    residuals: NDArray[np.float32]
    robust: NDArray[np.float32]
    weights: NDArray[np.float32]


class Level:
    """A template in one size, with all that does not change from frame to frame."""

    def __init__(self, template: Template, planar: bool, coarse: bool) -> None:
        import cv2

        height, width = template.shape
        if coarse:
            size = max((width + 1) // 2, 3), max((height + 1) // 2, 3)
            values = cv2.resize(template.values, size, interpolation=cv2.INTER_AREA)
        else:
            size, values = (width, height), template.values
        # Level pixels to template pixels, and these to coordinates of about -1 to 1.
        self._to_template = scaling(width / size[0], height / size[1])
        half = max(width, height) / 2
        self._centred = around(scaling(1 / half), width / 2, height / 2)
        self._centred[:2, 2] = -width / 2 / half, -height / 2 / half
        self._from_centred = inverse(self._centred)
        x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
        self._points = np.stack([x.ravel(), y.ravel(), np.ones(x.size)]).astype(np.float32)
        self._corners = np.array([(0, 0, 1), (size[0], 0, 1), (*size, 1), (0, size[1], 1)], dtype=float).T
        self._everywhere = np.ones(x.size, np.bool_)
        self._size = size
        self.values: NDArray[np.float32] = values.ravel()
        # Less their mean, so that sums of squares lose no digits.
        self._middle = float(values.mean())
        self._centred_values = self.values - np.float32(self._middle)
        self._moments = np.stack([np.ones_like(self.values), self._centred_values, np.square(self._centred_values)])
        self._structure = float(values.std())
        self._noise = template.noise_dn
        to_centred = self._centred @ self._to_template
        u, v, _ = to_centred @ self._points
        dx, dy = gradients(values)
        along, down = dx.ravel() / to_centred[0, 0], dy.ravel() / to_centred[1, 1]
        self._generators = np.array(_PLANAR if planar else _SIMILAR, dtype=float)
        point = np.stack([u, v, np.ones_like(u)])
        columns = []
        for generator in self._generators:
            moved = generator.reshape(3, 3) @ point
            columns.append(along * (moved[0] - u * moved[2]) + down * (moved[1] - v * moved[2]))
        self._jacobian = np.stack([*columns, self.values, np.ones_like(self.values)]).astype(np.float32)
        self._damping = np.zeros(len(columns) + 2)
        self._damping[: len(columns)] = 1 / np.square(_STEPS[: len(columns)])
        self._identity = np.eye(3)
        self._still = _STILL_PX / half
        self._trust = np.ones(self.values.size, np.float32)

    def trust_in(self, trust: NDArray[np.float32]) -> None:
        """Let each template pixel count as far as it is trusted."""
        import cv2

        if self._size != trust.shape[::-1]:
            trust = cv2.resize(trust, self._size, interpolation=cv2.INTER_AREA)
        self._trust = np.square(trust).ravel()

    def sample(self, view: View, to_view: Matrix) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Values of the view under each pixel, and which of them lie in the image."""
        import cv2

        place = to_view @ self._to_template
        # OpenCV has the middle of the first pixel at 0, we have its corner there.
        from_middles = _FROM_MIDDLES @ place @ _TO_MIDDLES
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        if place[2, 0] == place[2, 1] == 0:
            pixels = cv2.warpAffine(
                view.values, from_middles[:2], self._size, flags=flags, borderMode=cv2.BORDER_REPLICATE
            )
        else:
            pixels = cv2.warpPerspective(
                view.values, from_middles, self._size, flags=flags, borderMode=cv2.BORDER_REPLICATE
            )
        return np.asarray(pixels).ravel(), self._seen(view, place)

    def _seen(self, view: View, place: Matrix) -> NDArray[np.bool_]:
        """Which pixels lie in the image."""
        left, top, right, bottom = view.bounds
        x, y, w = (place @ self._corners).tolist()
        if min(w) > 0 and all(
            left * v < a < right * v and top * v < b < bottom * v for a, b, v in zip(x, y, w, strict=True)
        ):
            return self._everywhere
        x, y, w = place.astype(np.float32) @ self._points
        x, y = x / w, y / w
        seen: NDArray[np.bool_] = (x > left) & (x < right) & (y > top) & (y < bottom)
        return seen

    def first_light(
        self, values: NDArray[np.float32], seen: NDArray[np.bool_], guesses: Sequence[GainOffset | None]
    ) -> Light | None:
        """Gain and offset of the view, starting from each guess, or for None from all pixels alike; the best fit.

        A large bright thing in front of the target spoils a start from all pixels, but not one from the frame before.
        """
        best: Light | None = None
        least = max(self._noise, _ALLOWED * self._structure)
        for guess in guesses:
            if best is not None and _CHANGED * best.spread <= least:
                break
            light: Light | None = None
            known = np.ones_like(values)
            if guess is not None:
                known = self._robust((values - np.float32(guess[1])) * np.float32(1 / guess[0]) - self.values, guess[0])
            for _ in range(3):
                light = self.light(values, seen, known, None if guess is None else guess[0])
                if light is None:
                    break
                known = light.robust
            # A guess is kept unless the light has clearly changed.
            if light is not None and (best is None or light.spread < _CHANGED * best.spread):
                best = light
        return best

    def light(
        self, values: NDArray[np.float32], seen: NDArray[np.bool_], robust: NDArray[np.float32], expected: float | None
    ) -> Light | None:
        """Gain and offset by weighted least squares; None if the view has no such structure.

        An `expected` gain counts as much as the whole template: a patch and changing surroundings tell little of it.
        """
        trusted = self._trust if seen is self._everywhere else seen * self._trust
        weights = trusted * robust
        total, deviated, squared = (self._moments @ weights).tolist()
        if total < _PIXELS_LEAST:
            return None
        viewed, product = (self._moments[:2] @ (weights * values)).tolist()
        mean_t, mean_v = deviated / total, viewed / total
        power = squared - mean_t * deviated
        gain = (product - mean_t * viewed) / power if power > 0 else 0.0
        if expected is not None:
            whole = self._structure**2 * self.values.size
            gain = (power * gain + whole * expected) / (power + whole)
        if not _GAIN_LEAST < gain < _GAIN_MOST:
            return None
        residuals = values * np.float32(1 / gain)
        residuals -= self._centred_values
        residuals -= np.float32(mean_v / gain - mean_t)
        spread = self._spread(residuals, gain)
        robust = _robust_weights(residuals, spread)
        return Light(
            gain, mean_v - gain * (self._middle + mean_t), expected, spread, residuals, robust, trusted * robust
        )

    def _robust(self, residuals: NDArray[np.float32], gain: float) -> NDArray[np.float32]:
        return _robust_weights(residuals, self._spread(residuals, gain))

    def _spread(self, residuals: NDArray[np.float32], gain: float) -> float:
        """Estimate the standard deviation of most residuals, at least what noise and interpolation explain."""
        return max(_spread(residuals), self._noise * hypot(1, 1 / gain), _ALLOWED * self._structure)

    def improve(
        self, view: View, to_view: Matrix, steps: int, guesses: Sequence[GainOffset | None]
    ) -> tuple[Matrix, Light] | None:
        """Make up to `steps` steps; the place and the light before the last step, or None if they lead nowhere."""
        light: Light | None = None
        for _ in range(steps):
            values, seen = self.sample(view, to_view)
            if light is None:
                light = self.first_light(values, seen, guesses)
            else:
                light = self.light(values, seen, light.robust, light.expected)
            if light is None:
                return None
            step = self._step(light)
            change = self._identity + (step @ self._generators).reshape(3, 3)
            moved: Matrix = to_view @ (self._from_centred @ inverse(change) @ self._centred)
            to_view = moved / moved[2, 2]
            if not np.isfinite(to_view).all():
                return None
            if np.abs(step).max() < self._still:
                break
        return None if light is None else (to_view, light)

    def _step(self, light: Light) -> NDArray[np.float64]:
        """Gauss-Newton step along each generator, from the residuals in the template's units."""
        import cv2

        weighted = self._jacobian * light.weights
        products = (weighted @ self._jacobian.T).astype(np.float64)
        pull = (weighted @ light.residuals).astype(np.float64)
        scatter = float(np.vdot(light.weights * light.residuals, light.residuals)) / max(
            float(light.weights.sum()), 1e-9
        )
        diagonal = products.diagonal()
        damped = products + np.diag(self._damping * max(scatter, self._noise**2) + 1e-6 * diagonal + 1e-9)
        # Damped, it is positive definite; if not for all that, the step is none.
        solved, step = cv2.solve(damped, pull[:, None], flags=cv2.DECOMP_CHOLESKY)
        if not solved:
            return np.zeros(len(self._generators))
        return np.asarray(step, dtype=np.float64).ravel()[: len(self._generators)]


def _robust_weights(residuals: NDArray[np.float32], spread: float) -> NDArray[np.float32]:
    weights: NDArray[np.float32] = residuals * np.float32(1 / (_ROBUST * spread))
    weights *= weights
    weights += np.float32(1)
    weights *= weights
    np.reciprocal(weights, out=weights)
    return weights


def _spread(residuals: NDArray[np.float32]) -> float:
    """Estimate a standard deviation from the median of absolute values, of every fourth one if there are many."""
    some = np.abs(residuals[:: 4 if residuals.size > 800 else 1])
    middle = some.size // 2
    some.partition(middle)
    return 1.4826 * float(some[middle])
