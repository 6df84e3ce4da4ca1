"""How fast the shape of a region may change in the image."""

from __future__ import annotations

from .align.alignment import Fit
from .align.template import Template
from .geometry import Matrix, local_scale, scaling, shape_change, shift

#: Share of the template that must lie in the image.
_IN_IMAGE_LEAST = 0.4
#: Largest change of size from frame to frame, and over all.
_SIZE_STEP, _SIZE_LEAST, _SIZE_MOST = 1.25, 0.15, 8.0
#: Largest change of its shape from frame to frame: stretched, turned (rad), tilted (perspective over half its size).
_STRETCH_STEP, _TURN_STEP, _TILT_STEP = 1.1, 0.25, 0.05


class Shape:
    """The shape of one region in its template."""

    def __init__(self, template: Template) -> None:
        height, width = template.shape
        self._template, self._centre = template, (width / 2, height / 2)
        # Template pixels to coordinates of -1 to 1 along its longer side.
        self._to_centred = scaling(2 / max(width, height)) @ shift(-width / 2, -height / 2)

    def allows(self, before: Matrix, fit: Fit, frames: int) -> bool:
        """Whether it can have got from one place to that of a fit in some frames: in the image, of about its shape."""
        if fit.in_image < _IN_IMAGE_LEAST:
            return False
        long, short, turned, tilted = shape_change(before, fit.to_image, self._to_centred)
        size = (long * short) ** 0.5
        over_all = local_scale(fit.to_image, self._centre) * self._template.reduction
        return (
            1 / _SIZE_STEP**frames < size < _SIZE_STEP**frames
            and long < _STRETCH_STEP**frames * short
            and abs(turned) < _TURN_STEP * frames
            and tilted < _TILT_STEP * frames
            and _SIZE_LEAST < over_all < _SIZE_MOST
        )
