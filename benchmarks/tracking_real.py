"""How well regions are followed in real videos, judged by eye at every tenth frame, beside CSRT of OpenCV.

Run ``LABCDP_VIDEOS=FOLDER python benchmarks/tracking_real.py`` with the files that ``tests/tracking/real_videos.json``
lists in the folder; missing ones are left out. Columns: checked frames in which a place is right, wrong, or said to be
lost though in sight, and milliseconds a frame and region.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from labcdp.core.roi import Roi
from labcdp.tracking import make_tracker

sys.path.append(str(Path(__file__).parents[1]))
from tests.tracking.real import VIDEOS, Score, file_of, frames_of


class Ours:
    """labcdp's tracker."""

    def __init__(self, image: NDArray[np.uint8], box: list[int]) -> None:
        self._tracker = make_tracker("follow", cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), [Roi.rectangle("a", *box)])

    def find(self, image: NDArray[np.uint8]) -> tuple[float, float] | None:
        """Middle of the region in the next frame; None if it is lost."""
        (found,) = self._tracker.update(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        return None if found.lost else found.roi.centre


class Csrt:
    """OpenCV's tracker."""

    def __init__(self, image: NDArray[np.uint8], box: list[int]) -> None:
        cv2.setRNGSeed(1)
        self._tracker = cv2.TrackerCSRT.create()
        self._tracker.init(image, box)

    def find(self, image: NDArray[np.uint8]) -> tuple[float, float] | None:
        """Middle of the region in the next frame; None if it is lost."""
        found, (x, y, width, height) = self._tracker.update(image)
        return (x + width / 2, y + height / 2) if found else None


def main() -> None:
    print(f"{'video':24}{'region':10}" + "".join(f"{name:>8} right wrong  lost   ms" for name in ("labcdp", "CSRT")))
    total = {kind: Score() for kind in (Ours, Csrt)}
    for name in VIDEOS:
        path = file_of(name)
        if path is None:
            print(f"{name:24}not here")
            continue
        for region, known in VIDEOS[name]["regions"].items():
            line = f"{name:24}{region:10}"
            for kind, sum_of in total.items():
                score, tracker, taken, n = Score(), None, 0.0, 0
                for number, image in frames_of(name, path):
                    if tracker is None:
                        tracker = kind(image, known["box"])
                        continue
                    start = time.process_time()
                    found = tracker.find(image)
                    taken, n = taken + time.process_time() - start, n + 1
                    if str(number) in known["places"]:
                        for one in (score, sum_of):
                            one.add(found, known["places"][str(number)], known["box"])
                line += f"{score.right:14}{score.wrong:6}{score.lost:6}{1e3 * taken / n:5.0f}"
            print(line, flush=True)
    for kind, score in total.items():
        print(f"{kind.__name__}: right {score.right}, wrong {score.wrong}, lost {score.lost}")


if __name__ == "__main__":
    main()
