"""What is remembered of a region's first frame: the window around it, in a size that is quick to compare."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, hypot

import numpy as np
from numpy.typing import NDArray

from ..core.roi import Roi
from .frame import GreyFrame, noise_dn, smooth
from .geometry import Matrix, inverse, scaling, shift, transform
from .settings import SETTINGS

#: Variance of the gradient of a smoothed image (see `smooth` and `gradients`) with noise of variance 1.
_GRADIENT_NOISE = 0.0586


@dataclass(frozen=True, eq=False)
class Template:
    """The window around a region in the first frame.

    Parameters
    ----------
    roi : Roi
        The region in the first frame.
    values : ndarray of float32, shape (h, w)
        The window, reduced to `SETTINGS.template_side_px` and smoothed.
    to_image : ndarray of float, shape (3, 3)
        Template pixels to pixels of the first frame.
    noise_dn : float
        Standard deviation of the noise of `values`, at least what the coding of a video makes of it.
    faint_dn : float
        Contrast below which a codec may not show where a thing is.
    kept_from : float
        Light over that of the first frame from which on it leaves the noise, and with it everything else.
    """

    roi: Roi
    values: NDArray[np.float32]
    to_image: Matrix
    noise_dn: float
    faint_dn: float
    kept_from: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.values.shape[0], self.values.shape[1]

    @cached_property
    def trust(self) -> NDArray[np.float32]:
        """How surely each template pixel moves with the region, 0 to 1, shape (h, w), before anything has moved.

        The region lies in a patch as a rule. The patch ends where its brightness does, and its edge moves with it,
        whatever is beyond: that may be the same thing, or a background that moves otherwise.
        """
        import cv2

        if not self.inside.any():
            return np.ones(self.shape, np.float32)
        edged = (
            cv2.dilate(
                self.patch.astype(np.uint8), np.ones((SETTINGS.edge_template_px, SETTINGS.edge_template_px), np.uint8)
            )
            > 0
        )
        return np.where(edged, np.float32(1), np.float32(SETTINGS.weight_beyond))

    @cached_property
    def patch(self) -> NDArray[np.bool_]:
        """Which template pixels belong to the patch the region lies in: as bright as it, and joined to it; (h, w)."""
        import cv2

        inside = self.inside.reshape(self.shape)
        if not inside.any():
            return inside
        own = self.values[inside]
        alike = np.abs(self.values - np.median(own)) <= max(3 * float(own.std()), 4 * self.noise_dn, SETTINGS.unlike_dn)
        _, labels = cv2.connectedComponents(alike.astype(np.uint8), connectivity=4)
        there = np.unique(labels[inside & alike])
        patch: NDArray[np.bool_] = np.isin(labels, there[there > 0]) | inside
        return patch

    @cached_property
    def shown_from(self) -> float:
        """Light over that of the first frame from which on a codec shows where the region is."""
        weights = self.trust**2
        deviations = self.values - np.average(self.values, weights=weights)
        return self.light_to_show(float(np.average(np.square(deviations), weights=weights)) ** 0.5)

    def light_to_show(self, contrast_dn: float) -> float:
        """Light from which on a codec shows what has a contrast, standard deviation in DN, in that of the first frame.

        It leaves out what differs little, such as the motion of a faint thing, unless it keeps even the noise.
        """
        return min(self.faint_dn / max(contrast_dn, 1e-9), self.kept_from)

    @property
    def reduction(self) -> float:
        """Template pixels for each pixel of the first frame."""
        return 1 / float((self.to_image[0, 0] * self.to_image[1, 1]) ** 0.5)

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Middle (x, y) of each template pixel, row by row, shape (n, 2)."""
        height, width = self.shape
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        return np.stack([x.ravel(), y.ravel()], axis=1)

    @cached_property
    def to_centred(self) -> Matrix:
        """Template pixels to coordinates of -1 to 1 along its longer side, from the middle."""
        height, width = self.shape
        centred: Matrix = scaling(2 / max(width, height)) @ shift(-width / 2, -height / 2)
        return centred

    @cached_property
    def from_centred(self) -> Matrix:
        """These coordinates to template pixels."""
        return inverse(self.to_centred)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners of the region in template pixels, shape (n, 2)."""
        return transform(inverse(self.to_image), np.array(self.roi.corners))

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Which template pixels lie in the region, shape (n,)."""
        corners = self.corners
        x, y = self.points.T
        crossings = np.zeros(x.size, dtype=np.bool_)
        for (xa, ya), (xb, yb) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if ya != yb:
                crossings ^= ((ya > y) != (yb > y)) & (x < xa + (y - ya) * (xb - xa) / (yb - ya))
        return crossings


def plain_template(frame: GreyFrame, roi: Roi) -> Template:
    """Remember a region with hardly anything around it."""
    x0, y0, x1, y1 = roi.bounds
    return _template(frame, roi, max(SETTINGS.margin_share * max(x1 - x0, y1 - y0), SETTINGS.margin_px))


def is_background(template: Template) -> bool:
    """Whether a region lies in a plain patch that extends beyond its window: a part of a road, a wall or the sky."""
    patch = template.patch
    rim = np.concatenate([patch[0], patch[-1], patch[:, 0], patch[:, -1]])
    own = template.values[template.inside.reshape(template.shape)]
    plain = own.size > 0 and float(own.std()) <= max(
        SETTINGS.plain_noise * template.noise_dn, SETTINGS.plain_share * float(np.median(own))
    )
    return plain and bool(rim.mean() > SETTINGS.background_rim_share)


def make_template(frame: GreyFrame, roi: Roi) -> Template | None:
    """Choose the smallest window around a region that fixes its place, and remember it.

    A region is uniform as a rule, so its place is known by the edges around it. The window grows until the noise allows
    its position to be determined within 0.25 pixels in each direction, and not further, as what is far off may move
    otherwise. If none does, the smallest one is taken that is at most twice as unsure as the best, and within 0.5
    pixels.

    Returns
    -------
    Template or None
        None if not even the largest window fixes the place.
    """
    x0, y0, x1, y1 = roi.bounds
    side = max(x1 - x0, y1 - y0)
    most = max(1.5 * side, SETTINGS.margin_most_px, min(frame.shape) / 4)
    margins = [max(SETTINGS.margin_share * side, SETTINGS.margin_px)]
    sure = [place_uncertainty_px(_template(frame, roi, margins[0]))]
    while sure[-1] > SETTINGS.position_px and margins[-1] < most:
        margins.append(min(SETTINGS.margin_growth * margins[-1], most))
        sure.append(place_uncertainty_px(_template(frame, roi, margins[-1])))
    if min(sure) > SETTINGS.position_most_px:
        return None
    enough = min(max(SETTINGS.position_px, SETTINGS.window_worth * min(sure)), SETTINGS.position_most_px)
    margin = next(margin for margin, this in zip(margins, sure, strict=True) if this <= enough)
    margin *= 1 + SETTINGS.margin_beyond_share
    template = _template(frame, roi, margin + SETTINGS.margin_beyond_px)
    wider = SETTINGS.margin_beyond_template_px / template.reduction
    # What ends a background may move otherwise.
    if wider <= SETTINGS.margin_beyond_px or is_background(template):
        return template
    return _template(frame, roi, margin + wider)


def place_uncertainty_px(template: Template) -> float:
    """Compute how far noise leaves the place uncertain along its weakest direction: pixels, standard deviation.

    Notes
    -----
    Cramer-Rao bound of a shift: the noise's variance over the smallest eigenvalue of the summed products of gradients,
    less what noise alone adds to them. Infinite if these are only noise.
    """
    dx, dy = gradients(template.values)
    trust = template.trust**2
    n = float(trust.sum())
    across, x, y = np.vdot(trust * dx, dy), np.vdot(trust * dx, dx), np.vdot(trust * dy, dy)
    products = np.array([[x, across], [across, y]], dtype=np.float64)
    noise_dn = template.noise_dn / SMOOTHED_NOISE
    weakest = float(np.linalg.eigvalsh(products)[0]) - 2 * n * _GRADIENT_NOISE * noise_dn**2
    if weakest <= 0:
        return float("inf")
    return float(hypot(noise_dn, SETTINGS.unlike_dn) / weakest**0.5 / template.reduction)


#: Standard deviation of smoothed noise of standard deviation 1: that of the kernel 1 2 1 along both axes.
SMOOTHED_NOISE = 0.375


def gradients(values: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Central differences along x and y."""
    dy, dx = np.gradient(values)
    return np.asarray(dx), np.asarray(dy)


def _template(frame: GreyFrame, roi: Roi, margin: float) -> Template:
    import cv2

    height, width = frame.shape
    x0, y0, x1, y1 = roi.bounds
    left, top = max(floor(x0 - margin), 0), max(floor(y0 - margin), 0)
    right, bottom = min(ceil(x1 + margin), width), min(ceil(y1 + margin), height)
    window = frame.part(left, top, right, bottom)
    own = frame.part(max(floor(x0), 0), max(floor(y0), 0), ceil(x1), ceil(y1))
    noise = noise_dn(window)
    reduction = min(
        SETTINGS.template_side_px / max(window.shape),
        max(SETTINGS.noisy_dn / noise, SETTINGS.noisy_side_px / max(window.shape)),
        1.0,
    )
    size = max(round(reduction * window.shape[1]), 3), max(round(reduction * window.shape[0]), 3)
    small = cv2.resize(window, size, interpolation=cv2.INTER_AREA) if reduction < 1 else window
    factors = window.shape[1] / small.shape[1], window.shape[0] / small.shape[0]
    # Averaging leaves less noise, as long as it is not correlated.
    noise = noise / (factors[0] * factors[1]) ** 0.5 * SMOOTHED_NOISE
    to_image = shift(left, top) @ scaling(*factors)
    kept_from = SETTINGS.kept_noise_dn * frame.step_dn / noise_dn(own)
    return Template(roi, smooth(small), to_image, max(noise, SETTINGS.coding_noise_dn), frame.faint_dn, kept_from)
