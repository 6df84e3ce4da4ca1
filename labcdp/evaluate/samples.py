"""A picture and a video to try commands with, and their regions: a street at night, computed and not taken."""

from __future__ import annotations

import struct
import zlib
from functools import cache
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from ..regions import RectangleShape, save_regions

#: Size of picture and video, and number of frames.
WIDTH, HEIGHT, FRAMES = 640, 400, 60
#: Luminance of white in cd/m², its electrons, those of the dark noise, and seed of noise and gravel.
_WHITE, _FULL_E, _DARK_E, _SEED = 8.0, 4000.0, 4.0, 1
#: Left upper corner of the sign in the first frame, its side, and pixels that it moves in each.
_PLACE, _SIDE, _STEP = (250, 70), 70, 2
#: Row of the horizon, and pixels of the street that are left of the first frame.
_HORIZON, _LEFT = 230, _STEP * FRAMES


def sample_files() -> dict[str, bytes]:
    """Return night.png, drive.mp4 and rois.json, whose regions are those of the picture and of the first frame."""
    frames = [_frame(number) for number in range(FRAMES)]
    return {"night.png": _png(frames[0]), **_video(frames), **_regions()}


def luminance_cd_m2(number: int) -> NDArray[np.float64]:
    """Return the luminance of the street in a frame: the camera turns, a sign with a dark board below it moves past."""
    start = _STEP * (FRAMES - number)
    return _street()[:, start : start + WIDTH]


@cache
def _street() -> NDArray[np.float64]:
    """Return the luminance of all that the camera turns past: houses, road, people, a car, sign and board."""
    import cv2

    width = WIDTH + _LEFT
    scene = np.full((HEIGHT, width), 0.03)

    def rectangle(x: int, y: int, w: int, h: int, cd_m2: float) -> None:
        scene[y : y + h, x + _LEFT : x + w + _LEFT] = cd_m2

    def polygon(corners: list[tuple[int, int]], cd_m2: float) -> None:
        cv2.fillPoly(scene, [np.array(corners) + np.array([_LEFT, 0])], cd_m2)

    for x, y, w, cd_m2 in ((-120, 60, 150, 0.15), (30, 110, 120, 0.22), (150, 90, 70, 0.12), (420, 120, 100, 0.18),
                           (520, 40, 120, 0.14)):  # fmt: skip
        rectangle(x, y, w, _HORIZON - y, cd_m2)
        for row, top in enumerate(range(y + 14, _HORIZON - 30, 34)):
            for column, left in enumerate(range(x + 12, x + w - 20, 28)):
                rectangle(left, top, 14, 20, 2.5 if (3 * row + 5 * column + x) % 4 == 0 else 0.06)
    rectangle(-_LEFT, _HORIZON, width, HEIGHT - _HORIZON, 0.35)
    polygon([(270, _HORIZON), (370, _HORIZON), (720, HEIGHT), (-80, HEIGHT)], 0.9)
    for top, bottom in ((240, 252), (266, 288), (312, 346), (378, 400)):
        upper, lower = (round(1 + (y - _HORIZON) / 20) for y in (top, bottom))
        polygon([(320 - upper, top), (320 + upper, top), (320 + lower, bottom), (320 - lower, bottom)], 3.0)
    # People: dark coats in front of road and pavement, a light one in front of houses.
    people = (90, 350, 130, 0.22), (480, 320, 100, 0.55), (205, 250, 66, 0.12), (590, 335, 110, 1.6)
    for x, foot, height, cd_m2 in people:
        cv2.ellipse(scene, (x + _LEFT, foot - 11 * height // 12), (height // 12, height // 11), 0, 0, 360, cd_m2, -1)
        rectangle(x - height // 7, foot - 5 * height // 6, 2 * height // 7, 5 * height // 6, cd_m2)
    # A car with its tail lamps.
    polygon([(352, 262), (428, 262), (436, 282), (436, 312), (344, 312), (344, 282)], 0.2)
    polygon([(360, 264), (420, 264), (426, 280), (354, 280)], 0.08)
    for x in (347, 420):
        rectangle(x, 286, 13, 9, 7.0)
    gravel = np.random.default_rng(_SEED).normal(size=(HEIGHT - _HORIZON, width))
    scene[_HORIZON:] *= np.exp(0.08 * cv2.GaussianBlur(gravel, (0, 0), 1.0) / 0.28)
    left, top = _PLACE
    rectangle(left + _SIDE // 2 - 3, top, 6, _HORIZON + 20 - top, 0.5)
    # Sign and board with a bar on each.
    rectangle(left, top, _SIDE, _SIDE, 6.0)
    rectangle(left + 8, top + 8, 54, 8, 1.0)
    rectangle(left, top + _SIDE + 6, _SIDE, _SIDE - 6, 3.0)
    rectangle(left + 8, top + _SIDE + 12, 22, 8, 0.4)
    return scene


def _frame(number: int) -> NDArray[np.uint8]:
    """Return a frame in 8 bits by sRGB, with shot noise and dark noise."""
    rng = np.random.default_rng([_SEED, number])
    electrons = _FULL_E * luminance_cd_m2(number) / _WHITE
    linear = np.clip((rng.poisson(electrons) + rng.normal(0.0, _DARK_E, electrons.shape)) / _FULL_E, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    dn: NDArray[np.uint8] = np.rint(255 * encoded).astype(np.uint8)
    return dn


def _png(image: NDArray[np.uint8]) -> bytes:
    """Return a grey PNG that states its encoding: OpenCV leaves the chunk sRGB out."""
    rows = b"".join(b"\0" + row.tobytes() for row in image)
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", image.shape[1], image.shape[0], 8, 0, 0, 0, 0)),
        (b"sRGB", b"\0"), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b""),
    )  # fmt: skip
    written = (
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(written)


def _video(frames: list[NDArray[np.uint8]]) -> dict[str, bytes]:
    import av

    data = BytesIO()
    with av.open(data, "w", format="mp4") as container:
        stream = container.add_stream("mpeg4", rate=25, options={"qmin": "1", "qmax": "2"})
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = WIDTH, HEIGHT, "yuv420p", 12_000_000
        for image in frames:
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return {"drive.mp4": data.getvalue()}


def shapes() -> tuple[RectangleShape, RectangleShape]:
    """Return the regions, inside the sign and inside the board below it."""
    left, top = _PLACE
    return (
        RectangleShape("sign", left + 12, top + 22, 46, 40),
        RectangleShape("board", left + 12, top + _SIDE + 24, 46, 38),
    )


def _regions() -> dict[str, bytes]:
    with TemporaryDirectory(prefix="labcdp-") as folder:
        path = Path(folder) / "rois.json"
        save_regions(path, shapes(), (WIDTH, HEIGHT))
        return {path.name: path.read_bytes()}
