"""Videos of known pixels, written with FFmpeg."""

from fractions import Fraction

import av
import cv2
import numpy as np

from labcdp.files import PictureOptions
from labcdp.files.video.open import open_video
from labcdp.files.video.selection import Selection
from labcdp.files.video.source import frames_of

SIZE = (160, 120)
N = 12


def frames(path, selection=None, **options):
    """All frames of a video, or those of a selection."""
    return list(frames_of(open_video(path, PictureOptions(**options)), selection or Selection()))


def bars(n=N, size=SIZE):
    """Noise that no codec compresses away, and a bar whose value is 16 + 16 times the number of the frame."""
    rng = np.random.default_rng(7)
    images = [rng.integers(30, 60, (size[1], size[0])).astype(np.uint8) for _ in range(n)]
    for number, image in enumerate(images):
        image[:, :16] = 16 + 16 * number
    return images


def moving(n, size=(320, 240)):
    """A texture that moves on, as codecs predict it."""
    ground = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 60, (size[1], size[0])), (0, 0), 2) * 3 + 110
    return [np.roll(ground, 2 * number, axis=1).clip(16, 235).astype(np.uint8) for number in range(n)]


def write(path, codec, kind, frames, options=None, turned=0, **stated):
    """Write frames as they are, in a pixel format of FFmpeg, at 25 frames a second.

    A frame is one plane, in which each pixel may have several values, or a tuple of planes; Cb and Cr are grey if left
    out.
    """
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options or {})
        frames = [one if isinstance(one, tuple) else (one,) for one in frames]
        stream.height, stream.width, stream.pix_fmt = *frames[0][0].shape[:2], kind
        if turned:
            stream.set_display_rotation(turned)
        for name, value in stated.items():
            setattr(stream.codec_context, name, value)
        for number, planes in enumerate(frames):
            frame = av.VideoFrame(stream.width, stream.height, kind)
            fill(frame, planes)
            for name, value in stated.items():
                setattr(frame, name, value)
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def fill(frame, planes):
    bits = max(one.bits for one in frame.format.components)
    dtype = np.dtype("u1" if bits == 8 else ">u2" if frame.format.is_big_endian else "<u2")
    for at, plane in enumerate(frame.planes):
        data = planes[at] if at < len(planes) else np.full((plane.height, plane.width), 2 ** (bits - 1))
        values = data.reshape(plane.height, -1).astype(dtype)
        padded = np.zeros((plane.buffer_size // plane.line_size, plane.line_size // dtype.itemsize), dtype)
        padded[: values.shape[0], : values.shape[1]] = values
        plane.update(padded.tobytes())


def remux(source, path, *, first=0, earlier_by=0, bsf=None, **stated):
    """Packets of a video in another file: without the first ones ("key": up to the second key frame), or earlier by a
    number of frames, or filtered, or with other colours stated by the container.

    What is then before 0 is left out by an edit list.
    """
    options = {"avoid_negative_ts": "disabled"} if earlier_by else {}
    with av.open(str(source)) as whole, av.open(str(path), "w", options=options) as container:
        stream = whole.streams.video[0]
        copy = container.add_stream_from_template(stream)
        for name, value in stated.items():
            setattr(copy.codec_context, name, value)
        packets = [packet for packet in whole.demux(stream) if packet.size]
        keys = [number for number, packet in enumerate(packets) if packet.is_keyframe]
        packets = packets[keys[1] if first == "key" else first :]
        if bsf:
            bsf = av.BitStreamFilterContext(bsf, stream)
            packets = [part for packet in packets for part in bsf.filter(packet)]
        for packet in packets:
            if earlier_by:
                ticks = int(earlier_by / 25 / stream.time_base)
                packet.pts, packet.dts = packet.pts - ticks, packet.dts - ticks
            packet.stream = copy
            container.mux(packet)
    return path


def mux_jpegs(path, images, times_ms, size=SIZE):
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


def damaged(path, number, seed):
    """Copy of a video with 20 random bytes in a packet."""
    rng, data = np.random.default_rng(seed), bytearray(path.read_bytes())
    with av.open(str(path)) as container:
        packet = [bytes(packet) for packet in container.demux(video=0) if packet.size][number]
    start = data.index(packet) + int(rng.integers(12, max(13, len(packet) - 20)))
    data[start : start + 20] = rng.integers(0, 256, 20, dtype=np.uint8).tobytes()
    copy = path.with_name(f"damaged-{path.name}")
    copy.write_bytes(data)
    return copy
