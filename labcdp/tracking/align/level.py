"""One size of a template, and steps that align it with a view."""

from __future__ import annotations

from math import nan

import numpy as np
from numpy.typing import NDArray

from ..geometry import Matrix, around, inverse, scaling
from .level_kernel import Pattern, Seen, improve, look
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
#: Gain and offset of a frame's light: DN = gain * DN of the first frame + offset.
GainOffset = tuple[float, float]


_UNKNOWN: GainOffset = nan, 0.0


class Level:
    """A template in one size, with all that does not change from frame to frame."""

    def __init__(self, template: Template, values: NDArray[np.float32], planar: bool, coarse: bool) -> None:
        import cv2

        height, width = template.shape
        size = (max((width + 1) // 2, 3), max((height + 1) // 2, 3)) if coarse else (width, height)
        if coarse:
            values = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA))
        # Level pixels to template pixels, and these to coordinates of about -1 to 1.
        to_template = scaling(width / size[0], height / size[1])
        half = max(width, height) / 2
        centred = around(scaling(1 / half), width / 2, height / 2)
        centred[:2, 2] = -width / 2 / half, -height / 2 / half
        generators = np.array(_PLANAR if planar else _SIMILAR, dtype=float).reshape(-1, 3, 3)
        self._pattern = Pattern(
            values=np.ascontiguousarray(values),
            trust=np.ones(values.shape, np.float32),
            jacobian=_jacobian(values, centred @ to_template, generators),
            generators=generators,
            damping=np.array([*(1 / np.square(_STEPS[: len(generators)])), 0.0, 0.0]),
            to_template=to_template,
            centred=centred,
            from_centred=inverse(centred),
            middle=float(values.mean()),
            structure=float(values.std()),
            noise=float(template.noise_dn),
            still=_STILL_PX / half,
        )

    def trust_in(self, trust: NDArray[np.float32]) -> None:
        """Let each template pixel count as far as it is trusted."""
        import cv2

        rows, columns = self._pattern.values.shape
        if trust.shape != (rows, columns):
            trust = np.asarray(cv2.resize(trust, (columns, rows), interpolation=cv2.INTER_AREA))
        self._pattern = self._pattern._replace(trust=np.square(trust))

    @property
    def trust(self) -> NDArray[np.float32]:
        """Weight of each pixel."""
        return self._pattern.trust.ravel()

    @property
    def structure(self) -> float:
        """Standard deviation of the pixels."""
        return self._pattern.structure

    @property
    def noise(self) -> float:
        """Standard deviation of their noise."""
        return self._pattern.noise

    def improve(
        self, view: View, place: Matrix, steps: int, light: GainOffset | None
    ) -> tuple[Matrix, GainOffset] | None:
        """Make up to `steps` steps from `place`; the new place, and the light before the last one. None: led nowhere.

        `light` is a guess.
        """
        try:
            found, place, gain, offset = improve(
                view.values, view.bounds, np.ascontiguousarray(place), light or _UNKNOWN, steps, self._pattern
            )
        except np.linalg.LinAlgError:
            return None
        return (place, (gain, offset)) if found else None

    def look(self, view: View, place: Matrix, light: GainOffset | None) -> Seen | None:
        """Compare the view at a place with the template, starting from a guess of the light."""
        seen = look(view.values, view.bounds, np.ascontiguousarray(place), light or _UNKNOWN, self._pattern)
        return seen if seen.known else None


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
