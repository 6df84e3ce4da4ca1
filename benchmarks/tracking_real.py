"""How well regions are followed in real videos, judged by eye at every tenth frame or so, beside CSRT of OpenCV.

Run ``LABCDP_VIDEOS=FOLDER python benchmarks/tracking_real.py [--half develop|judge]`` with the files that
``tests/tracking/real_videos.json`` lists in the folder; missing ones are left out. The tracker is tuned on the
half ``develop`` only; the half ``judge`` tells how it does on videos that were not looked at. Columns: checked
frames in which a place is right, wrong, or said to be lost though in view, returns from a cover after which the
region was right again, and processor milliseconds a frame and region.
"""

from __future__ import annotations

import argparse
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

    name = "labcdp"

    def __init__(self, image: NDArray[np.uint8], box: list[int]) -> None:
        self._tracker = make_tracker("follow", cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), [Roi.rectangle("a", *box)])

    def find(self, image: NDArray[np.uint8]) -> tuple[float, float] | None:
        """Middle of the region in the next frame; None if it is lost."""
        (found,) = self._tracker.update(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        return None if found.lost else found.roi.centre


class Csrt:
    """OpenCV's tracker."""

    name = "CSRT"

    def __init__(self, image: NDArray[np.uint8], box: list[int]) -> None:
        cv2.setRNGSeed(1)
        self._tracker = cv2.TrackerCSRT.create()
        self._tracker.init(image, box)

    def find(self, image: NDArray[np.uint8]) -> tuple[float, float] | None:
        """Middle of the region in the next frame; None if it is lost."""
        found, (x, y, width, height) = self._tracker.update(image)
        return (x + width / 2, y + height / 2) if found else None


KINDS: tuple[type[Ours | Csrt], ...] = (Ours, Csrt)


class Timed:
    """A tracker of a region with its score and the time it took."""

    def __init__(self, kind: type[Ours | Csrt], image: NDArray[np.uint8], box: list[int]) -> None:
        self.score, self._taken_s, self._frames = Score(), 0.0, 0
        self._box, self._tracker = box, kind(image, box)

    def update(self, image: NDArray[np.uint8], number: int, places: dict[str, list[float] | None]) -> None:
        """Follow the region into the next frame and judge the place if the frame is a checked one."""
        start = time.process_time()
        position_px = self._tracker.find(image)
        self._taken_s += time.process_time() - start
        self._frames += 1
        if str(number) in places:
            self.score.add(position_px, places[str(number)], self._box)

    @property
    def frame_ms(self) -> float:
        """Processor milliseconds a frame."""
        return 1e3 * self._taken_s / max(self._frames, 1)


def scores_of(name: str, path: Path) -> dict[str, list[Timed]]:
    """Trackers of each region of a video, one of each kind, after the last checked frame."""
    regions = VIDEOS[name]["regions"]
    trackers: dict[str, list[Timed]] = {}
    for number, image in frames_of(name, path):
        for region, known in regions.items():
            if region not in trackers:
                trackers[region] = [Timed(kind, image, known["box"]) for kind in KINDS]
                continue
            for tracker in trackers[region]:
                tracker.update(image, number, known["places"])
    return trackers


def cells(score: Score, frame_ms: float) -> str:
    """Columns of a tracker."""
    returns = f"{score.found_again}/{score.returns}" if score.returns else ""
    return f"{score.right:9}{score.wrong:6}{score.lost:6}{returns:>7}{frame_ms:6.0f}"


def print_half(half: str) -> None:
    """Print the table of a half and its sum."""
    print(f"{half:58}" + "".join(f"{kind.name:>9}" + " " * 25 for kind in KINDS).rstrip())
    print(f"{'video':40}{'region':18}" + f"{'right':>9} wrong  lost again    ms" * len(KINDS))
    total, taken_ms = [Score() for _ in KINDS], [0.0 for _ in KINDS]
    regions = 0
    for name, video in VIDEOS.items():
        if video["half"] != half:
            continue
        if (path := file_of(name)) is None:
            print(f"{name:40}not here")
            continue
        for region, trackers in scores_of(name, path).items():
            columns = "".join(cells(tracker.score, tracker.frame_ms) for tracker in trackers)
            print(f"{name:40}{region:18}{columns}", flush=True)
            total = [score + tracker.score for score, tracker in zip(total, trackers, strict=True)]
            taken_ms = [ms + tracker.frame_ms for ms, tracker in zip(taken_ms, trackers, strict=True)]
            regions += 1
    print(f"{'all':58}" + "".join(cells(s, ms / max(regions, 1)) for s, ms in zip(total, taken_ms, strict=True)))
    for kind, score in zip(KINDS, total, strict=True):
        in_view = max(score.checked - score.unseen, 1)
        print(
            f"{kind.name}: right {score.right / in_view:.1%} and lost {score.lost / in_view:.1%} of {in_view} places "
            f"in view, wrong {score.wrong / max(score.checked, 1):.1%} of all {score.checked}, "
            f"found again after {score.found_again} of {score.returns} covers"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--half", choices=("develop", "judge"), help="only this half of the videos")
    half = parser.parse_args().half
    for each in ("develop", "judge") if half is None else (half,):
        print_half(each)


if __name__ == "__main__":
    main()
