"""A picture and a video to try commands with, and their regions: a street at night, computed and not taken."""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from ..regions import RectangleShape, save_regions

#: Size of picture and video, and number of frames.
WIDTH, HEIGHT, FRAMES = 640, 400, 60
#: Luminance of sky, road, sign and board in cd/m², and that of white.
_SKY, _ROAD, _SIGN, _BOARD, _WHITE = 0.2, 1.0, 6.0, 3.0, 8.0
#: Row of the horizon.
_HORIZON = 300
#: Electrons of white and of the dark noise, and seed of the noise.
_FULL_E, _DARK_E, _SEED = 4000.0, 4.0, 1
#: Left upper corner of the sign in the first frame, its side, and pixels that it moves in each.
_PLACE, _SIDE, _STEP = (250, 70), 70, 2


def sample_files() -> dict[str, bytes]:
    """Return night.png, drive.mp4 and rois.json, whose regions are those of the picture and of the first frame."""
    frames = [_frame(number) for number in range(FRAMES)]
    return {"night.png": _png(frames[0]), **_video(frames), **_regions()}


def luminance_cd_m2(number: int) -> NDArray[np.float64]:
    """Return the luminance of the street in a frame: the camera turns, a sign with a dark board below it moves past."""
    width = WIDTH + _STEP * FRAMES
    # Houses, trees and gravel.
    rough = np.random.default_rng(_SEED).normal(size=(HEIGHT // 8, -(-width // 8)))
    rough = rough.repeat(8, axis=0).repeat(8, axis=1)[:, :width]
    scene = np.where(np.arange(HEIGHT)[:, None] < _HORIZON, _SKY * np.exp(0.8 * rough), _ROAD * np.exp(0.2 * rough))
    left, top = _PLACE[0] + _STEP * FRAMES, _PLACE[1]
    scene[top : top + _SIDE, left : left + _SIDE] = _SIGN
    # A bar on each.
    scene[top + 8 : top + 16, left + 8 : left + 62] = 1.0
    scene[top + _SIDE + 6 : top + 2 * _SIDE, left : left + _SIDE] = _BOARD
    scene[top + _SIDE + 12 : top + _SIDE + 20, left + 8 : left + 30] = 0.4
    start = _STEP * (FRAMES - number)
    seen: NDArray[np.float64] = scene[:, start : start + WIDTH]
    return seen


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
