"""Whether places in coded videos are right or said to be lost, down to scenes of 3 % of the light.

Run ``python benchmarks/tracking_coded.py [CODEC ...]``. Each video has 24 frames of 240 x 160 pixels with two regions
whose true places are known; a target slides or drives before a background that moves otherwise, the light is constant
or goes down to a tenth. Columns, for each codec and light, over three qualities: share of places within 2 pixels and
not lost; share said to be lost or refused at the start; share of the others, which are wrong; and the largest error of
a place not lost.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator
from math import sin
from pathlib import Path
from typing import Any

import numpy as np

from labcdp.tracking import NotFollowedError, make_tracker

sys.path.append(str(Path(__file__).parents[1]))

from tests.files.video_files import frames, write
from tests.tracking.simulated import Moment, SimulatedVideo, pose, shift

NEAR_PX = 2.0
#: Pixel format of FFmpeg, and options for three qualities: good, usual, low.
CODECS: dict[str, tuple[str, list[dict[str, str]]]] = {
    "libx264 8": ("yuv420p", [{"crf": crf} for crf in ("23", "32", "40")]),
    "libx264 10": ("yuv420p10le", [{"crf": crf} for crf in ("23", "32", "40")]),
    "libx265 8": ("yuv420p", [{"crf": crf, "x265-params": "log-level=none"} for crf in ("23", "32", "40")]),
    "libx265 10": ("yuv420p10le", [{"crf": crf, "x265-params": "log-level=none"} for crf in ("23", "32", "40")]),
    "libsvtav1 8": ("yuv420p", [{"crf": crf, "preset": "10"} for crf in ("30", "40", "52")]),
    "libsvtav1 10": ("yuv420p10le", [{"crf": crf, "preset": "10"} for crf in ("30", "40", "52")]),
    "libvpx-vp9 8": ("yuv420p", [{"crf": crf, "b": "0", "deadline": "realtime"} for crf in ("28", "38", "50")]),
    "mpeg4 8": ("yuv420p", [{"qmin": q, "qmax": q} for q in ("4", "10", "24")]),
    "mjpeg 8": ("yuvj420p", [{"qmin": q, "qmax": q} for q in ("4", "10", "24")]),
}
LIGHTS: dict[str, Callable[[float], float]] = {
    **{f"{gain:.0%}": lambda _, gain=gain: gain for gain in (1.0, 0.5, 0.2, 0.1, 0.05, 0.03)},
    "to a tenth": lambda t: max(0.1, 1 - t / 14),
}
PATHS = (
    lambda t: (pose(90 + 1.5 * t, 80), shift(-0.75 * t, 0)),
    lambda t: (pose(90 + 1.3 * t + 2 * sin(t / 2), 78 + 2 * sin(t / 3), 1 + 0.008 * t), shift(-0.9 * t, 0.2 * t)),
)


def places(codec: str, light: Callable[[float], float], file: Path) -> Iterator[tuple[float, bool]]:
    """Error in pixels of each place, and whether it is said to be lost."""
    kind, qualities = CODECS[codec]
    black, white = (0, 255) if kind == "yuvj420p" else (16, 235)
    unit = 4 if kind.endswith("10le") else 1
    for seed, path in enumerate(PATHS, start=1):
        moment = lambda t, path=path: Moment(*path(t), gain=light(t))  # noqa: E731
        options: dict[str, Any] = {"size": (240, 160), "inset": 4, "full_scale_e": 6000.0, "bits": 16, "seed": seed}
        truth = list(SimulatedVideo(moment, 24, **options).frames())
        grey = [np.rint(unit * (black + (white - black) / 65535 * frame.grey)).astype(np.uint16) for frame in truth]
        for quality in qualities:
            video = [one.pixels for one in frames(write(file, codec.split()[0], kind, grey, quality))]
            try:
                tracker = make_tracker("follow", video[0].followed, truth[0].rois, levels=video[0].levels)
            except NotFollowedError:
                yield from [(0.0, True)] * sum(len(frame.rois) for frame in truth[1:])
                continue
            for pixels, frame in zip(video[1:], truth[1:], strict=True):
                for found, roi in zip(tracker.update(pixels.followed), frame.rois, strict=True):
                    yield float(np.hypot(*np.subtract(found.roi.centre, roi.centre))), found.lost


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("codecs", nargs="*", metavar="CODEC", default=list(CODECS), help=", ".join(CODECS))
    print(f"{'codec, bits':14}{'light':12}   near    lost   wrong  max px")
    with tempfile.TemporaryDirectory() as folder:
        for codec in parser.parse_args().codecs:
            for name, light in LIGHTS.items():
                errors, lost = map(np.array, zip(*places(codec, light, Path(folder) / "video.mkv"), strict=True))
                wrong = ~lost & (errors > NEAR_PX)
                worst = errors[~lost].max(initial=0)
                shares = (~lost & ~wrong).mean(), lost.mean(), wrong.mean()
                print(f"{codec:14}{name:12}{''.join(f'{share:8.1%}' for share in shares)}{worst:8.1f}", flush=True)


if __name__ == "__main__":
    main()
