"""How well regions are followed on simulated driving-like videos, and how soon a loss is noticed.

Run ``python benchmarks/tracking_accuracy.py [METHOD ...]``, with ``--seeds N`` for more than two scenes. Each
disturbance is a video of 60 frames of 480 x 320 pixels with two regions whose true places are known to a fraction of a
pixel. Columns, over the frames in which both regions are wholly in sight:

- centre: share of places within 2 pixels of the truth, not lost; and the 95 % quantile of the error in pixels,
- CDP: share of frames whose 95 % interval, from the followed regions, holds the CDP of the true ones (the contrast
  is chosen so that the CDP is about 0.5, where it is most sensitive),
- off: places said to be found that are more than 2 pixels off,
- lost: share of places said to be lost though in sight, without those up to 5 frames after the target came back,
- noticed: frames until a loss is said, the most of all losses (`-`: there is none; `never` if it is missed),
- wrong: places said to be found though less than half of the region is in sight, beyond the first 5 frames.

The last lines are the time for each frame of 1920 x 1080 pixels with two regions.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, field
from itertools import count
from math import isnan, nan
from pathlib import Path
from statistics import median

import cv2
import numpy as np

from labcdp.metrics import cdp
from labcdp.tracking import METHODS, TrackedRoi, make_tracker

sys.path.append(str(Path(__file__).parents[1]))
from tracking_disturbances import CASES, frames_of

from tests.tracking.simulated import Moment, SimulatedFrame, SimulatedVideo, pose, shift

NEAR_PX, NOTICED_WITHIN = 2.0, 5
#: Upper end of the interval of detection is at the contrast of the patches, 1.
CONTRAST, EPSILON = 2 / 3, 0.5


@dataclass
class Tally:
    """What is counted over the videos of a disturbance."""

    errors: list[float] = field(default_factory=list)
    places: int = 0
    near: int = 0
    off: int = 0
    frames: int = 0
    right: int = 0
    false_losses: int = 0
    noticed: list[float] = field(default_factory=list)
    wrong: int = 0
    _gone: dict[str, int] = field(default_factory=dict)
    _noticed: set[str] = field(default_factory=set)
    _back: dict[str, int] = field(default_factory=dict)

    def start(self) -> None:
        """Begin a video."""
        self._gone, self._back, self._noticed = {}, {}, set()

    def add(self, frame: SimulatedFrame, found: tuple[TrackedRoi, ...]) -> None:
        """Count a frame."""
        for one, true, seen in zip(found, frame.rois, frame.seen, strict=True):
            self._add_place(one, true.centre, seen)
        if min(frame.seen) < 1:
            return
        self.frames += 1
        if not any(one.lost for one in found):
            bright, dark = (roi.select(frame.grey) for roi in frame.rois)
            seen_bright, seen_dark = (region.roi.select(frame.grey) for region in found)
            truth = cdp(bright, dark, CONTRAST, EPSILON)
            low, high = cdp(seen_bright, seen_dark, CONTRAST, EPSILON).interval
            self.right += low <= truth.cdp <= high

    def _add_place(self, one: TrackedRoi, truth: tuple[float, float], seen: float) -> None:
        name = one.roi.name
        if seen < 0.5:
            self._gone[name] = self._gone.get(name, 0) + 1
            self._back[name] = 0
            if one.lost and name not in self._noticed:
                self.noticed.append(self._gone[name])
                self._noticed.add(name)
            self.wrong += not one.lost and self._gone[name] > NOTICED_WITHIN
            return
        if seen < 1:
            return
        if name in self._gone and name not in self._noticed:
            self.noticed.append(nan)
        self._gone.pop(name, None)
        self._noticed.discard(name)
        self._back[name] = self._back.get(name, NOTICED_WITHIN) + 1
        self.places += 1
        error = float(np.hypot(*np.subtract(one.roi.centre, truth)))
        if one.lost:
            self.false_losses += self._back[name] > NOTICED_WITHIN
        else:
            self.errors.append(error)
            self.near += error <= NEAR_PX
            self.off += error > NEAR_PX

    def line(self) -> str:
        """Write the columns."""
        if not self.noticed:
            noticed = "-"
        else:
            noticed = "never" if any(isnan(n) for n in self.noticed) else f"{max(self.noticed)}"
        quantile = float(np.quantile(self.errors, 0.95)) if self.errors else float("nan")
        return (
            f"{self.near / self.places:7.1%} {quantile:6.2f} {self.off:5d} {self.right / self.frames:7.1%} "
            f"{self.false_losses / self.places:7.1%} {noticed:>8} {self.wrong:6d}"
        )


def time_ms(method: str) -> float:
    """Median time of an update with two regions of 120 x 100 pixels in 1920 x 1080."""
    video = SimulatedVideo(
        lambda t: Moment(pose(900 + 4 * t, 500 + 2 * t, 1 + 0.003 * t), shift(-t, 0)),
        n_frames=25,
        size=(1920, 1080),
        target_size=(400, 240),
        patches=((-160, -50, 120, 100, 0.6), (40, -50, 120, 100, 0.3)),
    )
    times: list[float] = []
    tracker = None
    for frame in video.frames():
        if tracker is None:
            tracker = make_tracker(method, frame.grey, frame.rois)
            continue
        start = time.process_time()
        tracker.update(frame.grey)
        times.append(1e3 * (time.process_time() - start))
    return median(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("methods", nargs="*", metavar="METHOD")
    parser.add_argument("--seeds", type=int, default=2)
    arguments = parser.parse_args()
    methods = arguments.methods or [method for method in METHODS if method != "fixed"]
    print(f"{'disturbance':22}{'method':11}  centre q95 px   off     CDP    lost  noticed  wrong")
    for name, case in CASES.items():
        tallies = {method: Tally() for method in methods}
        for seed in range(arguments.seeds):
            trackers = {}
            for number, frame in zip(count(), frames_of(case, seed)):
                for method, tally in tallies.items():
                    if number == 0:
                        trackers[method] = make_tracker(method, frame.grey, frame.rois)
                        tally.start()
                    else:
                        tally.add(frame, trackers[method].update(frame.grey))
        for method, tally in tallies.items():
            print(f"{name:22}{method:11} {tally.line()}", flush=True)
    print(f"\nProcessor time of a frame of 1920 x 1080 with two regions (OpenCV: {cv2.getNumThreads()} threads)")
    for method in methods:
        print(f"{method:11}{time_ms(method):6.1f} ms")


if __name__ == "__main__":
    main()
