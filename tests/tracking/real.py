"""Real videos with places that were checked by eye, and how trackers do on them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Folder with the files.
FOLDER = Path(os.environ.get("LABCDP_VIDEOS", "videos"))
VIDEOS: dict[str, dict[str, Any]] = json.loads(Path(__file__).with_name("real_videos.json").read_text())["videos"]
#: Distance at which a place is right, in parts of the square root of its area.
NEAR = 0.35


@dataclass
class Score:
    """How often a region was right, wrong and said to be lost, where it was in sight and where not."""

    right: int = 0
    wrong: int = 0
    lost: int = 0
    unseen: int = 0

    def add(self, found: tuple[float, float] | None, place: list[float] | None, box: list[float]) -> None:
        """Count a frame."""
        if place is None:
            self.wrong += found is not None
            self.unseen += 1
        elif found is None:
            self.lost += 1
        elif np.hypot(found[0] - place[0], found[1] - place[1]) <= NEAR * (box[2] * box[3]) ** 0.5:
            self.right += 1
        else:
            self.wrong += 1


def file_of(name: str) -> Path | None:
    """File of a video; None if it is not here."""
    path = FOLDER / name
    if not path.is_file():
        return None
    assert sha256(path.read_bytes()).hexdigest() == VIDEOS[name]["sha256"], f"{path} is another file"
    return path


def frames_of(name: str, path: Path) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Frames in colour from the first one with regions to the last checked one."""
    import cv2

    start = VIDEOS[name]["start"]
    last = max(int(n) for region in VIDEOS[name]["regions"].values() for n in region["places"])
    video = cv2.VideoCapture(str(path))
    for number in range(last + 1):
        done, image = video.read()
        if not done:
            break
        if number >= start:
            yield number, image
    video.release()
