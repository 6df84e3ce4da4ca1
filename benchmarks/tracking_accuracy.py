"""How well regions are followed on simulated driving-like videos, and how soon a loss is noticed.

Run ``python benchmarks/tracking_accuracy.py [METHOD ...]``, with ``--seeds N`` for more than two scenes. Each
disturbance is a video of 60 frames of 480 x 320 pixels with two regions whose true places are known to a fraction of a
pixel. Columns, over the frames in which both regions are wholly in sight:

- centre: share of places within 2 pixels of the truth, not lost; and the 95 % quantile of the error in pixels,
- CDP: share of frames whose 95 % interval, from the followed regions, holds the CDP of the true ones (the contrast
  is chosen so that the CDP is about 0.5, where it is most sensitive),
- lost: share of places said to be lost though in sight, without those up to 5 frames after the target came back,
- noticed: frames until a loss is said, the most of all losses (`-`: there is none; `never` if it is missed),
- wrong: places said to be found though less than half of the region is in sight, beyond the first 5 frames.

The last lines are the time for each frame of 1920 x 1080 pixels with two regions.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from math import isnan, nan, sin
from statistics import median
from typing import Any

import cv2
import numpy as np

from labcdp.contrast import cdp
from labcdp.roi import Roi
from labcdp.tracking import METHODS, TrackedRoi, make_tracker
from labcdp.tracking.geometry import Matrix, scaling, shift
from labcdp.tracking.simulated import Cover, Moment, SimulatedFrame, SimulatedVideo, pose

NEAR_PX, NOTICED_WITHIN = 2.0, 5
#: Upper end of the interval of detection is at the contrast of the patches, 1.
CONTRAST, EPSILON = 2 / 3, 0.5


def drive(t: float) -> Matrix:
    return pose(190 + 2 * t + 3 * sin(t / 4), 150 - 0.5 * t + 2 * sin(t / 3), 1 + 0.008 * t)


def beside(t: float) -> Matrix:
    return shift(-1.2 * t, 0.1 * t)


def tilting(t: float) -> Matrix:
    return pose(200 + t, 150, 1 + 0.004 * t, 0.12 * sin(t / 15), (0.002 * sin(t / 20), 0.0015 * sin(t / 25)))


def below(t: float) -> Cover:
    x, y = drive(t)[:2, 2]
    return Cover(x - 80, y + 12, 160, 60, 0.5)


def everything(t: float) -> Moment:
    covers = (below(t),) if 15 < t < 25 else (Cover(900 - 14 * t, 0, 16, 320, 0.15),)
    return Moment(drive(t), beside(t), 0.65 + 0.35 * sin(t / 6), 0.05 * sin(t / 9) ** 2, covers)


@dataclass(frozen=True)
class Case:
    """A simulated video."""

    path: Callable[[float], Moment]
    options: dict[str, Any] = field(default_factory=dict)
    parts: int = 1


#: Two plain patches side by side, right before a background that moves otherwise.
BARE = {"patches": ((-30, -14, 30, 28, 0.6), (0, -14, 30, 28, 0.3)), "target_size": (60, 28)}

FOLLOWED = {
    "shift": Case(lambda t: Moment(pose(130 + 3.3 * t, 150 + 8 * sin(t / 3)), beside(t))),
    "fast shift": Case(lambda t: Moment(pose(220 + 110 * sin(t / 5), 150 + 30 * sin(t / 3)), beside(t))),
    "pan": Case(lambda t: Moment(pose(240 + 90 * sin(t / 4), 150), shift(90 * sin(t / 4), 0))),
    "larger": Case(lambda t: Moment(pose(230 + 0.5 * t, 150, 1 + 0.02 * t), scaling(1 + 0.004 * t))),
    "smaller": Case(lambda t: Moment(pose(230 + 0.5 * t, 150, 1 / (1 + 0.02 * t)), scaling(1 / (1 + 0.02 * t)))),
    "light": Case(lambda t: Moment(drive(t), beside(t), 0.25 + 0.75 * abs(1 - t / 30), 0.1 * sin(t / 8) ** 2)),
    "tunnel": Case(lambda t: Moment(drive(t), beside(t), 0.3 if 20 <= t < 40 else 1)),
    "pole passes": Case(lambda t: Moment(drive(t), beside(t), covers=(Cover(480 - 9 * t, 0, 22, 320, 0.15),))),
    "lower part covered": Case(lambda t: Moment(drive(t), beside(t), covers=(below(t),) if t > 20 else ())),
    "noise": Case(lambda t: Moment(drive(t), beside(t)), {"full_scale_e": 300.0}),
    "blur": Case(lambda t: Moment(pose(130 + 5 * t, 150 + 8 * sin(t / 3)), beside(t)), {"exposure": 0.6}),
    "two objects": Case(lambda t: Moment(pose(120 + 30 * sin(t / 7), 150, 1 + 0.01 * t), beside(t)), parts=2),
    "turned": Case(lambda t: Moment(pose(200 + t, 150, 1, 0.3 * sin(t / 15)), beside(t))),
    "tilted": Case(lambda t: Moment(tilting(t), beside(t))),
    "nothing but outlines": Case(lambda t: Moment(drive(t), beside(t)), BARE),
    "all together": Case(everything, {"full_scale_e": 1500.0, "exposure": 0.3}),
}  # fmt: skip
LOST = {
    "something in front": Case(
        lambda t: Moment(drive(t), beside(t), covers=(Cover(0, 0, 480, 320, 0.4),) if 30 <= t < 45 else ())
    ),
    "behind a lorry": Case(lambda t: Moment(drive(t), beside(t), covers=(Cover(500 - 10 * t, 60, 220, 200, 0.4),))),
    "leaves the image": Case(lambda t: Moment(pose(280 + 6 * t, 150), beside(t))),
    "leaves, noise": Case(lambda t: Moment(pose(280 + 6 * t, 150), beside(t)), {"full_scale_e": 400.0}),
    "another scene": Case(lambda t: Moment(drive(t), beside(t), scene=int(30 <= t < 45))),
    "another scene, noise": Case(
        lambda t: Moment(drive(t), beside(t), scene=int(30 <= t < 45)), {"full_scale_e": 400.0}
    ),
    "black": Case(lambda t: Moment(drive(t), beside(t), 0.0 if 30 <= t < 45 else 1.0)),
}  # fmt: skip


def frames_of(case: Case, seed: int) -> Iterator[SimulatedFrame]:
    """Frames of a case; in two parts, the halves of the image are videos of their own with a region each."""
    if case.parts == 1:
        yield from SimulatedVideo(case.path, seed=seed, **case.options).frames()
        return
    left, right = (
        SimulatedVideo(path, seed=seed + 50 * number, size=(240, 320), patches=((-17, -14, 34, 28, brightness),))
        for number, (path, brightness) in enumerate([(case.path, 0.6), (lambda t: case.path(1.6 * t + 9), 0.3)])
    )
    for a, b in zip(left.frames(), right.frames(), strict=True):
        moved = tuple((x + 240, y) for x, y in b.rois[0].corners)
        rois = a.rois[0], Roi("b", moved)
        yield SimulatedFrame(np.hstack([a.grey, b.grey]), rois, (a.seen[0], b.seen[0]))


@dataclass
class Tally:
    """What is counted over the videos of a disturbance."""

    errors: list[float] = field(default_factory=list)
    places: int = 0
    near: int = 0
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
            truth = cdp(*(roi.select(frame.grey) for roi in frame.rois), CONTRAST, EPSILON)
            low, high = cdp(*(one.roi.select(frame.grey) for one in found), CONTRAST, EPSILON).confidence_interval
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

    def line(self) -> str:
        """Write the columns."""
        if not self.noticed:
            noticed = "-"
        else:
            noticed = "never" if any(isnan(n) for n in self.noticed) else f"{max(self.noticed)}"
        quantile = float(np.quantile(self.errors, 0.95)) if self.errors else float("nan")
        return (
            f"{self.near / self.places:7.1%} {quantile:6.2f} {self.right / self.frames:7.1%} "
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
    print(f"{'disturbance':22}{'method':11}  centre q95 px     CDP    lost  noticed  wrong")
    for name, case in (FOLLOWED | LOST).items():
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
