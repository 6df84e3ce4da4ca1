"""Videos of known patches, written without loss."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from labcdp.core.roi import Roi
from labcdp.evaluate.video.settings import VideoSettings

Images = Sequence[np.ndarray]


def exposed(image: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def write(path: Path, frames: Images, codec: str = "FFV1") -> Path:
    height, width = frames[0].shape
    flags = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), 25, (width, height), flags)
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


#: Regions of `scenes`, and of `driving`.
BRIGHT, DARK = Roi.rectangle("bright", 20, 20, 24, 20), Roi.rectangle("dark", 60, 20, 24, 20)
MOVING, STILL = Roi.rectangle("moving", 20, 40, 30, 30), Roi.rectangle("still", 20, 80, 30, 30)


def scenes(n: int = 8) -> list[Any]:
    """Two patches whose contrast falls from frame to frame."""
    rng = np.random.default_rng(3)
    made = []
    for number in range(n):
        image = rng.normal(40, 3, (80, 120))
        image[20:40, 20:44] = rng.normal(150 - 8 * number, 12, (20, 24))
        image[20:40, 60:84] = rng.normal(60, 8, (20, 24))
        made.append(exposed(image))
    return made


def driving(n: int, step: int, noise_dn: float = 0.0, seed: int = 5) -> list[Any]:
    """A patch with a mark that moves by `step` pixels a frame, at most 30 times, and one that stays."""
    rng = np.random.default_rng(seed)
    ground = cv2.GaussianBlur(rng.normal(90, 60, (120, 160)), (0, 0), 2)
    frames = []
    for number in range(n):
        image, left = ground.copy(), 20 + step * (number % 30)
        image[40:70, left : left + 30] = 200
        image[50:60, left + 8 : left + 20] = 150
        image[80:110, 20:50] = 60
        image[90:100, 30:40] = 30
        frames.append(exposed(image + rng.normal(0, noise_dn, image.shape)))
    return frames


CONTRASTS = (0.5, 1.0, 2.0)


def fixed(**changes: Any) -> VideoSettings:
    return VideoSettings(**{"contrasts": CONTRASTS, "rois": (BRIGHT, DARK), "method": "fixed"} | changes)


def brute_force(a: np.ndarray, b: np.ndarray, contrast: float, epsilon: float = 0.5) -> tuple[float, float, float]:
    """Below, inside and above, pair by pair."""
    measured = np.divide.outer(max(a, b, key=np.mean).astype(float), min(a, b, key=np.mean)) - 1
    below, up_to = measured < contrast * (1 - epsilon) - 1e-9, measured <= contrast * (1 + epsilon) + 1e-9
    return float(below.mean()), float(up_to.mean() - below.mean()), float(1 - up_to.mean())
