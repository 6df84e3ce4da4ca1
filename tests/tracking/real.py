"""Real videos with places that were checked by eye, and how trackers do on them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
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
#: Checked frames in view after a cover within which the region has to be found again.
RETURN_FRAMES = 3


@dataclass
class Score:
    """How often a region was right, wrong and said to be lost, where it was in view and where not.

    ``returns`` counts covers after which the region came into view again, ``found_again`` those after which it was
    right in one of the next checked frames.
    """

    checked: int = 0
    right: int = 0
    wrong: int = 0
    lost: int = 0
    unseen: int = 0
    returns: int = 0
    found_again: int = 0
    _since_cover: int | None = field(default=None, repr=False)

    def add(self, found: tuple[float, float] | None, place: list[float] | None, box: list[float]) -> None:
        """Count a frame; frames come in their order."""
        right = False
        self.checked += 1
        if place is None:
            self.wrong += found is not None
            self.unseen += 1
        elif found is None:
            self.lost += 1
        elif np.hypot(found[0] - place[0], found[1] - place[1]) <= NEAR * (box[2] * box[3]) ** 0.5:
            self.right += 1
            right = True
        else:
            self.wrong += 1
        self._count_return(place is not None, right)

    def _count_return(self, in_view: bool, right: bool) -> None:
        if not in_view:
            self._since_cover = 0
        elif self._since_cover is not None:
            self.returns += self._since_cover == 0
            self._since_cover += 1
            self.found_again += right
            if right or self._since_cover == RETURN_FRAMES:
                self._since_cover = None

    def __add__(self, other: Score) -> Score:
        names = ("checked", "right", "wrong", "lost", "unseen", "returns", "found_again")
        return Score(**{name: getattr(self, name) + getattr(other, name) for name in names})


def digest(path: Path) -> str:
    """SHA-256 of a file, or of the files of a folder one after another in the order of their names."""
    parts = sorted(path.iterdir()) if path.is_dir() else [path]
    total = sha256()
    for part in parts:
        total.update(part.read_bytes())
    return total.hexdigest()


def file_of(name: str) -> Path | None:
    """File of a video, or folder with its frames; None if it is not here."""
    path = FOLDER / name
    if not path.exists():
        return None
    assert digest(path) == VIDEOS[name]["sha256"], f"{path} is another file"
    return path


def frames_of(name: str, path: Path) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Frames in colour from the first one with regions to the last checked one."""
    start = VIDEOS[name]["start"]
    last = max(int(n) for region in VIDEOS[name]["regions"].values() for n in region["places"])
    for number, image in enumerate(_images(path)):
        if number > last:
            break
        if number >= start:
            yield number, image


def _images(path: Path) -> Iterator[NDArray[np.uint8]]:
    import cv2

    if path.is_dir():
        for part in sorted(path.iterdir()):
            yield cv2.imread(str(part))
        return
    video = cv2.VideoCapture(str(path))
    while True:
        done, image = video.read()
        if not done:
            break
        yield image
    video.release()
