"""One size of a template, and steps that align it with a view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, around, inverse, scaling
from .level_kernel import Pixels
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

#: Gain and offset of a frame's light: DN = gain * DN of the first frame + offset.
GainOffset = tuple[float, float]


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
        to_template = scaling(width / size[0], height / size[1])
        half = max(width, height) / 2
        centred = around(scaling(1 / half), width / 2, height / 2)
        centred[:2, 2] = -width / 2 / half, -height / 2 / half
        generators = np.array(_PLANAR if planar else _SIMILAR, dtype=float).reshape(-1, 3, 3)
        self._size = size
        self.pixels = Pixels(
            jacobian=_jacobian(values, centred @ to_template, generators),
            trust=np.ones(values.size, np.float32),
            generators=generators,
            damping=np.array([*(1 / np.square(_STEPS[: len(generators)])), 0.0, 0.0]),
            to_template=to_template,
            centred=centred,
            from_centred=inverse(centred),
            columns=size[0],
            middle=float(values.mean()),
            structure=float(values.std()),
            noise=template.noise_dn,
            still=_STILL_PX / half,
        )

    def trust_in(self, trust: NDArray[np.float32]) -> None:
        """Let each template pixel count as far as it is trusted."""
        import cv2

        if self._size != trust.shape[::-1]:
            trust = cv2.resize(trust, self._size, interpolation=cv2.INTER_AREA)
        np.square(trust.ravel(), out=self.pixels.trust)


def _jacobian(values: NDArray[np.float32], to_centred: Matrix, generators: NDArray[np.float64]) -> NDArray[np.float32]:
    """Change of each pixel along each generator, the pixels themselves, and ones: shape (m + 2, n)."""
    height, width = values.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    u, v = to_centred[0, 0] * x + to_centred[0, 2], to_centred[1, 1] * y + to_centred[1, 2]
    dx, dy = gradients(values)
    along, down = dx / to_centred[0, 0], dy / to_centred[1, 1]
    columns = []
    for (a, b, c), (d, e, f), (g, h, i) in generators:
        w = g * u + h * v + i
        columns.append(along * (a * u + b * v + c - u * w) + down * (d * u + e * v + f - v * w))
    return np.stack([*columns, values, np.ones_like(values)]).reshape(-1, values.size).astype(np.float32)
