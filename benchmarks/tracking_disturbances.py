"""What happens to regions on the road and in the laboratory, as simulated videos with known places."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from math import cos, pi, sin
from typing import Any

import numpy as np

from labcdp.core.roi import Roi
from tests.tracking.simulated import Cover, Matrix, Moment, SimulatedFrame, SimulatedVideo, pose, scaling, shift

#: Frames of each video.
LENGTH = 60


@dataclass(frozen=True)
class Case:
    """A simulated video."""

    path: Callable[[float], Moment]
    options: dict[str, Any] = field(default_factory=dict)
    parts: int = 1


def frames_of(case: Case, seed: int) -> Iterator[SimulatedFrame]:
    """Frames of a case; in two parts, the halves of the image are videos of their own with a region each."""
    if case.parts == 1:
        yield from SimulatedVideo(case.path, LENGTH, seed=seed, **case.options).frames()
        return
    left, right = (
        SimulatedVideo(path, LENGTH, seed=seed + 50 * number, size=(240, 320), patches=((-17, -14, 34, 28, level),))
        for number, (path, level) in enumerate([(case.path, 0.6), (lambda t: case.path(1.6 * t + 9), 0.3)])
    )
    for a, b in zip(left.frames(), right.frames(), strict=True):
        moved = tuple((x + 240, y) for x, y in b.rois[0].corners)
        rois = a.rois[0], Roi("b", moved)
        yield SimulatedFrame(np.hstack([a.grey, b.grey]), rois, (a.seen[0], b.seen[0]))


def drive(t: float) -> Matrix:
    return pose(190 + 2 * t + 3 * sin(t / 4), 150 - 0.5 * t + 2 * sin(t / 3), 1 + 0.008 * t)


def beside(t: float) -> Matrix:
    return shift(-1.2 * t, 0.1 * t)


def driving(**changes: Any) -> Callable[[float], Moment]:
    """Path of a target driven along; what changes is a value, or a function of time."""
    return lambda t: Moment(
        drive(t), beside(t), **{name: value(t) if callable(value) else value for name, value in changes.items()}
    )


def _tilting(t: float) -> Matrix:
    return pose(200 + t, 150, 1 + 0.004 * t, 0.12 * sin(t / 15), (0.002 * sin(t / 20), 0.0015 * sin(t / 25)))


def _below(t: float) -> Cover:
    x, y = drive(t)[:2, 2]
    return Cover(x - 80, y + 12, 160, 60, 0.5)


def _everything(t: float) -> Moment:
    covers = (_below(t),) if 15 < t < 25 else (Cover(900 - 14 * t, 0, 16, 320, 0.15),)
    return Moment(drive(t), beside(t), 0.65 + 0.35 * sin(t / 6), 0.05 * sin(t / 9) ** 2, covers)


@cache
def _walk(step: float, seed: int = 5) -> tuple[tuple[float, float], ...]:
    """Places after steps of one length in random directions, reflected at the border."""
    rng = np.random.default_rng(seed)
    places = [np.array((240.0, 160.0))]
    low, high = np.array((62.0, 38.0)), np.array((418.0, 282.0))
    for _ in range(LENGTH):
        angle = rng.uniform(0, 2 * pi)
        there = places[-1] + step * np.array((cos(angle), sin(angle)))
        there = np.where(there < low, 2 * low - there, there)
        places.append(np.where(there > high, 2 * high - there, there))
    return tuple((float(x), float(y)) for x, y in places)


def walking(step: float) -> Callable[[float], Moment]:
    return lambda t: Moment(pose(*_walk(step)[round(t)]), beside(t))


def jumping(step: float) -> Callable[[float], Moment]:
    """Drift, and a jump of `step` pixels there and back every ten frames, at once for target and camera or not."""

    def path(t: float) -> Moment:
        n = int(t) // 10
        x, y = (0.0, 0.7 * step, -0.7 * step)[n % 3], (0.0, 0.714 * step, -0.714 * step)[n % 3] * (1 if n < 3 else -1)
        return Moment(pose(220 + 0.5 * t + x, 155 + y), beside(t))

    return path


def _identical(t: float) -> Moment:
    covers = (Cover(0, 90, 260, 120, 0.4),) if 25 <= t < 40 else ()
    return Moment(pose(150 + 0.8 * t, 150), beside(t), covers=covers, others=((pose(380, 150), 0),))


def _similar(t: float) -> Moment:
    covers = (Cover(0, 90, 260, 120, 0.4),) if 25 <= t < 40 else ()
    return Moment(pose(150 + 0.8 * t, 150), beside(t), covers=covers, others=((pose(400 - 0.8 * t, 250), 1),))


def _passes(t: float) -> Moment:
    return Moment(pose(240, 150), beside(t), others=((pose(60 + 6 * t, 225), 1),))


#: Two plain patches side by side, right before a background that moves otherwise.
_BARE = {"patches": ((-30, -14, 30, 28, 0.6), (0, -14, 30, 28, 0.3)), "target_size": (60, 28)}
#: 12 bits of which the scene takes about 40 DN, with a contrast-to-noise ratio of about 5.
_NIGHT = {"bits": 12, "full_scale_e": 40000.0, "read_noise_e": 9.0}

FOLLOWED = {
    "shift": Case(lambda t: Moment(pose(130 + 3.3 * t, 150 + 8 * sin(t / 3)), beside(t))),
    "fast shift": Case(lambda t: Moment(pose(220 + 110 * sin(t / 5), 150 + 30 * sin(t / 3)), beside(t))),
    "pan": Case(lambda t: Moment(pose(240 + 90 * sin(t / 4), 150), shift(90 * sin(t / 4), 0))),
    "larger": Case(lambda t: Moment(pose(230 + 0.5 * t, 150, 1 + 0.02 * t), scaling(1 + 0.004 * t))),
    "smaller": Case(lambda t: Moment(pose(230 + 0.5 * t, 150, 1 / (1 + 0.02 * t)), scaling(1 / (1 + 0.02 * t)))),
    "light": Case(driving(gain=lambda t: 0.25 + 0.75 * abs(1 - t / 30), veil=lambda t: 0.1 * sin(t / 8) ** 2)),
    "tunnel": Case(driving(gain=lambda t: 0.3 if 20 <= t < 40 else 1)),
    "pole passes": Case(driving(covers=lambda t: (Cover(480 - 9 * t, 0, 22, 320, 0.15),))),
    "lower part covered": Case(driving(covers=lambda t: (_below(t),) if t > 20 else ())),
    "noise": Case(driving(), {"full_scale_e": 300.0}),
    "heavy noise": Case(driving(), {"full_scale_e": 120.0}),
    "blur": Case(lambda t: Moment(pose(130 + 5 * t, 150 + 8 * sin(t / 3)), beside(t)), {"exposure": 0.6}),
    "two objects": Case(lambda t: Moment(pose(120 + 30 * sin(t / 7), 150, 1 + 0.01 * t), beside(t)), parts=2),
    "turned": Case(lambda t: Moment(pose(200 + t, 150, 1, 0.3 * sin(t / 15)), beside(t))),
    "tilted": Case(lambda t: Moment(_tilting(t), beside(t))),
    "nothing but outlines": Case(driving(), _BARE),
    "all together": Case(_everything, {"full_scale_e": 1500.0, "exposure": 0.3}),
    "night, 12 bits": Case(driving(gain=0.0163), _NIGHT),
    "fog": Case(driving(gain=lambda t: 1 - 0.85 * sin(pi * t / 60), veil=lambda t: 0.5 * sin(pi * t / 60))),
    "fade to black": Case(driving(gain=lambda t: max(0.0, 1.1 * abs(cos(pi * t / 60)) - 0.1))),
    "jump 20 px": Case(jumping(20)),
    "jump 40 px": Case(jumping(40)),
    "jump 60 px": Case(jumping(60)),
    "jump 100 px": Case(jumping(100)),
    "walk 10 px": Case(walking(10)),
    "walk 20 px": Case(walking(20)),
    "walk 40 px": Case(walking(40)),
    "walk 40 px, noise": Case(walking(40), {"full_scale_e": 400.0}),
    "similar thing passes": Case(_passes),
}  # fmt: skip
LOST = {
    "something in front": Case(driving(covers=lambda t: (Cover(0, 0, 480, 320, 0.4),) if 30 <= t < 45 else ())),
    "behind a lorry": Case(driving(covers=lambda t: (Cover(500 - 10 * t, 60, 220, 200, 0.4),))),
    "leaves the image": Case(lambda t: Moment(pose(280 + 6 * t, 150), beside(t))),
    "leaves, noise": Case(lambda t: Moment(pose(280 + 6 * t, 150), beside(t)), {"full_scale_e": 400.0}),
    "another scene": Case(driving(scene=lambda t: int(30 <= t < 45))),
    "another scene, noise": Case(driving(scene=lambda t: int(30 <= t < 45)), {"full_scale_e": 400.0}),
    "cuts": Case(driving(scene=lambda t: int(int(t) % 14 >= 10))),
    "black": Case(driving(gain=lambda t: 0.0 if 30 <= t < 45 else 1.0)),
    "covered beside its like": Case(_similar),
    "covered beside its twin": Case(_identical),
}  # fmt: skip
CASES = FOLLOWED | LOST
