"""One size of a template, and steps that align it with a view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, scaling
from .settings import SETTINGS
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
_Pixels = NDArray[np.float32]
#: Gain and offset of a frame's light: DN = gain * DN of the first frame + offset.
GainOffset = tuple[float, float]


class Level:
    """A template in one size, with all that does not change from frame to frame."""

    def __init__(self, template: Template, values: _Pixels, planar: bool, coarse: bool) -> None:
        import cv2

        from .light_kernel import LevelArrays

        height, width = template.shape
        size = (max((width + 1) // 2, 3), max((height + 1) // 2, 3)) if coarse else (width, height)
        if coarse:
            values = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA))
        to_template = scaling(width / size[0], height / size[1])
        generators = np.array(_PLANAR if planar else _SIMILAR, dtype=float)
        self._size = size
        self.arrays = LevelArrays(
            values.ravel(),
            np.ones(values.size, np.float32),
            size[0],
            _jacobian(values, template.to_centred @ to_template, generators),
            float(values.mean()),
            float(values.std()),
            float(template.noise_dn),
            generators,
            np.array([*(1 / np.square(_STEPS[: len(generators)])), 0.0, 0.0]),
            to_template,
            template.to_centred,
            template.from_centred,
            SETTINGS.still_template_px * 2 / max(width, height),
            SETTINGS.robust_sigma,
            SETTINGS.allowed_share,
            SETTINGS.light_changed_share,
            SETTINGS.gain_least,
            SETTINGS.gain_most,
        )

    def trust_in(self, trust: _Pixels) -> None:
        """Let each template pixel count as far as it is trusted."""
        import cv2

        if trust.shape[::-1] != self._size:
            trust = np.asarray(cv2.resize(trust, self._size, interpolation=cv2.INTER_AREA))
        self.arrays = self.arrays._replace(trust=np.square(trust).ravel())


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
