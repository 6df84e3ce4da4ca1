"""Simulated videos of a target that moves in a known way, to test trackers with.

The scene is a far background, the target in front of it and what covers it. All are drawn from fine textures, several
samples a pixel averaged over its area, so the place of the target is known exactly in each frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import cos, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from labcdp.core.roi import Roi
from labcdp.tracking.geometry import Matrix, carried, scaling, shift, transform

#: Texels of a texture for each pixel, samples of a pixel along each axis.
_TEXELS, _SAMPLES = 3, 4
Textures = Sequence[NDArray[np.float32]]


def pose(x: float, y: float, scale: float = 1.0, angle_rad: float = 0.0, tilt: tuple[float, float] = (0, 0)) -> Matrix:
    """Matrix that puts the target's middle at (`x`, `y`) of the image; `tilt` is in parts for each target pixel."""
    turned = np.array([[cos(angle_rad), -sin(angle_rad), 0], [sin(angle_rad), cos(angle_rad), 0], [0, 0, 1.0]])
    tilted = np.array([[1.0, 0, 0], [0, 1.0, 0], [tilt[0], tilt[1], 1.0]])
    placed: Matrix = shift(x, y) @ scaling(scale) @ turned @ tilted
    return placed


@dataclass(frozen=True)
class Cover:
    """Something in front of the target: a rectangle of the image with corner (x, y), and its brightness 0 to 1."""

    x: float
    y: float
    width: float
    height: float
    brightness: float = 0.35


@dataclass(frozen=True)
class Moment:
    """The scene at one time.

    Parameters
    ----------
    target : ndarray of float, shape (3, 3)
        Target pixels, from its middle, to image pixels.
    background : ndarray of float, shape (3, 3)
        The same for the background.
    gain, veil : float
        Light on everything, and light of the windscreen or lens on top of it, in parts of full scale.
    covers : sequence of Cover
        What hides the target.
    scene : int
        Number of the scene; only scene 0 has the target.
    others : sequence of (ndarray of float, int)
        Things beside the target that look like it: where, and the seed of their texture; 0 is the target's own.
    """

    target: Matrix
    background: Matrix = field(default_factory=lambda: np.eye(3))
    gain: float = 1.0
    veil: float = 0.0
    covers: Sequence[Cover] = ()
    scene: int = 0
    others: Sequence[tuple[Matrix, int]] = ()


@dataclass(frozen=True)
class SimulatedFrame:
    """One frame with the truth: the regions, and the share of each that is seen (0 to 1)."""

    grey: NDArray[np.uint8] | NDArray[np.uint16]
    rois: tuple[Roi, ...]
    seen: tuple[float, ...]


@dataclass(frozen=True)
class SimulatedVideo:
    """A video of a target with two uniform patches.

    Parameters
    ----------
    path : function of the frame number (a float within the exposure) to Moment
        What moves and changes.
    n_frames : int
        Length.
    size : (int, int)
        Width and height in pixels.
    patches : ((x, y, width, height, brightness), ...)
        Patches of the target, in pixels from its middle.
    target_size : (float, float)
        Width and height of the target in pixels.
    inset : float
        Pixels from a patch's edge to its region, in the first frame.
    full_scale_e, read_noise_e : float
        Electrons at full scale, and their noise in dark signal.
    bits : int
        Of the frames: 8, or up to 16.
    exposure : float
        Share of the frame time the shutter is open: blur by motion. 0 for none.
    seed : int
        Of textures and noise.
    """

    path: Callable[[float], Moment]
    n_frames: int = 60
    size: tuple[int, int] = (480, 320)
    patches: tuple[tuple[float, float, float, float, float], ...] = ((-42, -14, 34, 28, 0.6), (8, -14, 34, 28, 0.3))
    target_size: tuple[float, float] = (110, 60)
    inset: float = 3.0
    full_scale_e: float = 8000.0
    read_noise_e: float = 10.0
    bits: int = 8
    exposure: float = 0.0
    seed: int = 1

    def frames(self) -> Iterator[SimulatedFrame]:
        """Render one frame after the other."""
        rng = np.random.default_rng((self.seed, 7))
        textures = [_background(self.size, np.random.default_rng((self.seed, number))) for number in range(2)]
        targets = [self._target_texture(number) for number in range(2)]
        start = np.linalg.inv(self.path(0.0).target)
        first = self._rois_of_the_first_frame()
        for number in range(self.n_frames):
            steps = 1 if self.exposure == 0 else 5
            # The exposure lies around the time of the frame, so that the truth is in the middle of the blur.
            times = number + self.exposure * ((np.arange(steps) + 0.5) / steps - 0.5)
            light = np.mean([self._light(self.path(float(time)), textures, targets) for time in times], axis=0)
            moment = self.path(float(number))
            rois = tuple(carried(roi, moment.target @ start) for roi in first)
            yield SimulatedFrame(self._exposed(light, rng), rois, tuple(self._seen(roi, moment) for roi in rois))

    def _rois_of_the_first_frame(self) -> tuple[Roi, ...]:
        here = self.path(0.0).target
        rois = []
        for name, (x, y, width, height, _) in zip("abcdefgh", self.patches, strict=False):
            corners = np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)], dtype=float)
            corners += self.inset * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
            rois.append(Roi(name, tuple((float(u), float(v)) for u, v in transform(here, corners))))
        return tuple(rois)

    def _target_texture(self, number: int) -> NDArray[np.float32]:
        """Brightness of a target, `_TEXELS` a pixel: a panel with some structure, and the patches on it."""
        width, height = (round(_TEXELS * side) for side in self.target_size)
        rng = np.random.default_rng((self.seed, 99, number) if number else (self.seed, 99))
        noise = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), 2.5 * _TEXELS)
        panel = 0.45 + 0.05 * noise / noise.std()
        for x, y, w, h, brightness in self.patches:
            left, top = (_TEXELS * (x + self.target_size[0] / 2)), (_TEXELS * (y + self.target_size[1] / 2))
            panel[round(top) : round(top + _TEXELS * h), round(left) : round(left + _TEXELS * w)] = brightness
        texture: NDArray[np.float32] = np.clip(panel, 0.02, 1).astype(np.float32)
        return texture

    def _light(self, moment: Moment, textures: Textures, targets: Textures) -> NDArray[np.float64]:
        """Light on each pixel in parts of full scale."""
        fine = _SAMPLES * self.size[0], _SAMPLES * self.size[1]
        # OpenCV has the middle of the first pixel at 0, we have its corner there.
        to_fine = shift(-0.5, -0.5) @ scaling(_SAMPLES)
        texels = scaling(1 / _TEXELS) @ shift(0.5, 0.5)
        backdrop = textures[moment.scene]
        middle = shift(-backdrop.shape[1] / 2 / _TEXELS, -backdrop.shape[0] / 2 / _TEXELS)
        placed = to_fine @ shift(self.size[0] / 2, self.size[1] / 2) @ moment.background @ middle @ texels
        picture = cv2.warpPerspective(backdrop, placed, fine, borderMode=cv2.BORDER_REFLECT)
        things = [*moment.others, (moment.target, 0)] if moment.scene == 0 else moment.others
        for place, number in things:
            target = targets[number]
            onto = to_fine @ place @ shift(-self.target_size[0] / 2, -self.target_size[1] / 2) @ texels
            sheet = cv2.warpPerspective(target, onto, fine, borderMode=cv2.BORDER_REPLICATE)
            there = cv2.warpPerspective(np.ones_like(target), onto, fine, flags=cv2.INTER_NEAREST) > 0
            picture[there] = sheet[there]
        for cover in moment.covers:
            x, y = np.clip((_SAMPLES * cover.x, _SAMPLES * cover.y), 0, None).round().astype(int)
            right, bottom = round(_SAMPLES * (cover.x + cover.width)), round(_SAMPLES * (cover.y + cover.height))
            picture[y : max(bottom, 0), x : max(right, 0)] = cover.brightness
        area: NDArray[np.float32] = cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA)
        return moment.gain * area.astype(np.float64) + moment.veil

    def _exposed(self, light: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint8] | NDArray[np.uint16]:
        electrons = rng.poisson(np.clip(light, 0, 4) * self.full_scale_e)
        electrons = electrons + self.read_noise_e * rng.standard_normal(light.shape)
        most = 2**self.bits - 1
        dn = np.clip(np.rint(electrons * (most / self.full_scale_e)), 0, most)
        return dn.astype(np.uint8 if self.bits == 8 else np.uint16)

    def _seen(self, roi: Roi, moment: Moment) -> float:
        """Share of the region inside the image, in the light and in front of everything, from a grid of points."""
        if moment.scene != 0 or moment.gain <= 0:
            return 0.0
        u, v = np.meshgrid((np.arange(24) + 0.5) / 24, (np.arange(24) + 0.5) / 24)
        (a, b, c, d) = (np.array(corner) for corner in roi.corners)
        across, down = u.reshape(-1, 1), v.reshape(-1, 1)
        points = (1 - down) * ((1 - across) * a + across * b) + down * ((1 - across) * d + across * c)
        x, y = points.T
        seen = (x > 0) & (y > 0) & (x < self.size[0]) & (y < self.size[1])
        for cover in moment.covers:
            inside = (x > cover.x) & (x < cover.x + cover.width) & (y > cover.y) & (y < cover.y + cover.height)
            seen &= ~inside
        return float(seen.mean())


def _background(size: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    """Brightness of a street-like backdrop, larger than the image: clouds of several sizes and many rectangles."""
    width, height = (round(1.3 * _TEXELS * side) for side in size)
    picture = np.full((height, width), 0.4, np.float32)
    for across in (6, 24, 96):
        coarse = rng.standard_normal((max(height * across // width, 2), across)).astype(np.float32)
        picture += 0.06 * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(140):
        x, y = rng.integers(0, width), rng.integers(0, height)
        w, h = rng.integers(width // 100 + 2, width // 12 + 3), rng.integers(height // 60 + 2, height // 6 + 3)
        picture[y : y + h, x : x + w] = rng.uniform(0.08, 0.85)
    return np.clip(picture, 0.02, 1).astype(np.float32)
