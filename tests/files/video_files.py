"""Videos of known pixels, written with FFmpeg."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

Pixels = np.ndarray[Any, Any]
SIZE = (160, 120)
N = 12


def bars(n: int = N, size: tuple[int, int] = SIZE) -> list[Pixels]:
    """Noise that no codec compresses away, and a bar whose value is 16 + 16 times the number of the frame."""
    rng = np.random.default_rng(7)
    made = []
    for number in range(n):
        image = rng.integers(30, 60, (size[1], size[0])).astype(np.uint8)
        image[:, :16] = 16 + 16 * (number % N)
        made.append(image)
    return made


def moving(n: int, size: tuple[int, int] = (320, 240)) -> list[Pixels]:
    """A texture that moves on, as codecs predict it."""
    import cv2

    ground = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 60, (size[1], size[0])), (0, 0), 2) * 3 + 110
    return [np.roll(ground, 2 * number, axis=1).clip(16, 235).astype(np.uint8) for number in range(n)]


def write(
    path: Path,
    codec: str,
    kind: str,
    frames: Sequence[Pixels | Sequence[Pixels]],
    options: dict[str, str] | None = None,
    turned: int = 0,
    **stated: int,
) -> Path:
    """Write planes as they are, in a pixel format of FFmpeg; grey alone gets Cb and Cr of grey. 25 frames a second."""
    with av.open(str(path), "w") as container:
        first = frames[0] if isinstance(frames[0], np.ndarray) else frames[0][0]
        stream = container.add_stream(codec, rate=25, options=options or {})
        stream.height, stream.width, stream.pix_fmt = *first.shape[:2], kind
        if turned:
            stream.set_display_rotation(turned)
        for name, value in stated.items():
            setattr(stream.codec_context, name, value)
        for number, planes in enumerate(frames):
            frame = av.VideoFrame(first.shape[1], first.shape[0], kind)
            fill(frame, [planes] if isinstance(planes, np.ndarray) else planes)
            for name, value in stated.items():
                setattr(frame, name, value)
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def fill(frame: Any, planes: Sequence[Pixels]) -> None:
    bits = max(one.bits for one in frame.format.components)
    order = ">u2" if frame.format.is_big_endian else "<u2"
    for at, plane in enumerate(frame.planes):
        data = np.full((plane.height, plane.width), 2 ** (bits - 1), np.uint16)
        if at < len(planes):
            data = planes[at].reshape(plane.height, -1)
        values = data.astype(np.uint8 if bits == 8 else order)
        row = plane.line_size // values.itemsize
        padded = np.zeros((plane.buffer_size // plane.line_size, row), values.dtype)
        padded[: values.shape[0], : values.shape[1]] = values
        plane.update(padded.tobytes())


def packets(path: Path) -> list[bytes]:
    with av.open(str(path)) as container:
        return [bytes(packet) for packet in container.demux(video=0) if packet.size]


def mux_jpegs(path: Path, images: Sequence[bytes], times_ms: Sequence[int], size: tuple[int, int] = SIZE) -> Path:
    """JPEG images as the packets of Motion JPEG, with time stamps of their own."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = *size, "yuvj420p"
        stream.time_base = Fraction(1, 1000)
        for data, time_ms in zip(images, times_ms, strict=True):
            packet = av.Packet(data)
            packet.stream, packet.pts, packet.dts, packet.time_base = stream, time_ms, time_ms, Fraction(1, 1000)
            packet.is_keyframe = True
            container.mux(packet)
    return path


def damaged(path: Path, number: int, seed: int) -> Path:
    """Copy of a video with 20 random bytes in a packet."""
    rng = np.random.default_rng(seed)
    data, victim = bytearray(path.read_bytes()), packets(path)[number]
    at = data.find(victim)
    assert at > 0
    start = at + int(rng.integers(12, max(13, len(victim) - 20)))
    data[start : start + 20] = rng.integers(0, 256, 20, dtype=np.uint8).tobytes()
    copy = path.with_name(f"damaged-{path.name}")
    copy.write_bytes(data)
    return copy
