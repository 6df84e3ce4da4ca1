"""Video files that FFmpeg decodes, as frames of DN."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property, partial
from itertools import chain, islice
from math import isfinite
from pathlib import Path
from typing import Any

import av
import numpy as np
from av import FFmpegError
from numpy.typing import NDArray

from ...core.companding import Companding
from ...core.disk import file_sha256, open_regular, reading, reason, require_regular
from ...core.errors import InputError
from ...core.frame import Frame
from ...core.luminance import WHOLE, Window
from ...core.result import warning
from ..doubts import doubts_of, histogram_of
from ..frame import Scale, changed_at, frame_of_pixels, make_frame, scale_of
from ..kinds import HEAD_BYTES, no_video
from ..picture import PictureOptions, overridden_frame, unused_options
from ..stored_image import SCREEN_BITS
from .decoding import shown_frames, video_stream, video_streams
from .pixels import Pixels, learn_pixels, stated_by, statement_findings
from .quantiser import PARAMETERS, is_lossless
from .source import StoredPixels, VideoFrame, VideoSource, require_frames

#: Frames of all parts that are looked at to estimate bits, and frames from a key frame on that are decoded for one.
_SPREAD, _MOST_BETWEEN = 9, 12
#: Whole frames, and broken ones, that are looked at to learn what the numbers are.
_LOOKED_AT, _MOST_BROKEN = 3, 300
#: Formats of one file: others name further files, which FFmpeg would open.
_CONTAINERS = (
    "avi,matroska,webm,mov,mp4,m4a,3gp,3g2,mj2,mpeg,mpegts,mpegvideo,m4v,h264,hevc,av1,obu,ivf,flv,ogg,asf,mjpeg,"
    "mxf,nut,dv,yuv4mpegpipe,gif,apng"
)
#: Formats whose header states a length, and a duration in the metadata of Matroska.
_STATING = frozenset({"matroska", "mxf", "flv"})
_TIME = re.compile(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)")


@dataclass(frozen=True, eq=False, kw_only=True)
class VideoFile(VideoSource):
    """A video file that FFmpeg decodes.

    Parameters
    ----------
    pixels : Pixels
        What its numbers are.
    options : PictureOptions
        What it does not say.
    modified : datetime
        When it was changed last.
    scale : Scale
        Of grey of more than 8 bits: one for all frames.
    """

    pixels: Pixels
    options: PictureOptions
    modified: datetime
    scale: Scale

    @cached_property
    def sha256(self) -> str:
        """Hash of the file."""
        return file_sha256(self.path, "a file you can read")

    def entries(self) -> Iterator[VideoFrame]:
        """Go through all frames; one that cannot be decoded has a fault, and costs no other."""
        height, width = self.shape[0] + sum(self._embedded_rows), self.shape[1]
        as_stored = (height, width) if self.pixels.orientation <= 4 else (width, height)
        with _opened(self.path, self.options.max_pixels) as container:
            for number, time_s, frame, fault in shown_frames(container, as_stored, self.frame_rate):
                note = None
                if fault is not None and self.options.damaged and frame is not None:
                    fault, note = None, fault
                yield VideoFrame(number, time_s, fault, partial(self.stored, frame, number), note)

    def stored(self, frame: Any, number: int) -> StoredPixels:
        """Pixels of a decoded frame: only those that are asked for are converted."""
        if frame is None:
            raise InputError("it cannot be decoded")
        planes, pixels = self.pixels.planes(frame), self.pixels
        if pixels.kind == "luma":
            above, below = self._embedded_rows
            planes = tuple(plane[above : plane.shape[0] - below] for plane in planes[:1])
        part = partial(self._grey if pixels.kind == "luma" else self._of_colours, planes, number)
        in_part = part if pixels.orientation == 1 and pixels.kind != "rgb" else None
        colours = None if pixels.kind == "luma" else partial(pixels.colours, planes)
        return StoredPixels(planes, pixels.followed(planes), pixels.levels, partial(part, WHOLE), in_part, colours)

    def _grey(self, planes: Sequence[NDArray[Any]], number: int, window: Window) -> Frame:
        dn = self.pixels.luma(planes[0][window])
        # There is no other reference to the pixels: they need not be copied.
        dn.flags.writeable = False
        if dn.dtype == np.uint8:
            return replace(self._example, dn=dn, frame_id=number, companding=self._curve)
        made = make_frame(dn, self.scale.for_values(dn, str(self.path)), self.options, self.modified, number)
        return overridden_frame(replace(made, companding=self._curve), self.options)

    @property
    def _curve(self) -> Companding | None:
        return self.options.encoding if isinstance(self.options.encoding, Companding) else None

    @property
    def _embedded_rows(self) -> tuple[int, int]:
        return (0, 0) if self._curve is None else self._curve.embedded_rows

    def _of_colours(self, planes: Sequence[NDArray[Any]], number: int, window: Window) -> Frame:
        dn, clipped = self.pixels.luminance(planes, window)
        return replace(self._example, dn=dn, clipped=clipped, frame_id=number)

    @cached_property
    def _example(self) -> Frame:
        """A frame of 8 bits, or of the luminance of colours."""
        if self.pixels.kind == "luma":
            made = frame_of_pixels(np.zeros((1, 1), np.uint8), self.options, self.modified)
            return overridden_frame(made, self.options)
        options = replace(self.options, bit_depth=None, pixel_format=None, saturation_dn=None, black_level_dn=None)
        return frame_of_pixels(np.zeros((1, 1), np.uint16), options, self.modified)


def open_video_file(path: Path, options: PictureOptions) -> VideoSource:
    """Open a video file.

    Of grey pictures Y' is taken as it is stored, stretched if its range is limited; colours become linear luminance as
    in pictures. All bits are kept.

    Parameters
    ----------
    path : Path
        The file.
    options : PictureOptions
        What it does not say: exposure, gain, camera, and bits of 16-bit values.

    Raises
    ------
    InputError
        If it cannot be read, is empty, no video, interlaced, or holds no frame that can be decoded.
    """
    if require_regular(path, "a video, a folder of images, or a recorded session") == 0:
        raise InputError(f"{path} is empty: copy it again from the camera")
    frames: list[Any] = []
    broken: list[Any] = []
    with _opened(path, options.max_pixels) as container:
        stream = video_stream(container)
        stream.codec_context.options = {**stream.codec_context.options, **PARAMETERS}
        by_container = stated_by(stream.codec_context)
        for _, _, frame, fault in shown_frames(container, None, None):
            (frames if fault is None else broken).append(frame)
            if len(frames) == _LOOKED_AT or len(broken) == _MOST_BROKEN:
                break
        # Damaged frames show false colours.
        frames = frames or [frame for frame in broken if frame is not None]
        require_frames(bool(frames), path)
        rate = float(stream.average_rate or stream.guessed_rate or 0)
        count, length_s = _announced(stream), None
        is_estimate = count == 0
        if is_estimate:
            length_s = _length_s(container, stream)
            count = round((length_s or (container.duration or 0) / av.time_base) * rate)
        try:
            later = _spread(path, options.max_pixels, 1)
            known = options.encoding, options.of_sensor
            pixels, findings = learn_pixels(frames, later, stream.codec_context, *known)
            curve = options.encoding if isinstance(options.encoding, Companding) else None
            context = stream.codec_context
            is_unchanged = is_lossless(frames, context.codec, context.profile)
            if curve is not None:
                _require_codes(pixels, curve, is_unchanged)
        except InputError as error:
            raise InputError(f"{path} {error}") from error
        findings += statement_findings(by_container, stated_by(frames[0]), pixels.kind != "luma")
        if n_others := len(video_streams(container)) - 1:
            findings.append(warning("video-streams-ignored", count=n_others))
    height, width = frames[0].height - sum(curve.embedded_rows if curve else ()), frames[0].width
    frame_rate = rate if isfinite(rate) and rate > 0 else None
    scale = _scale(frames, pixels, options, path)
    pixels, findings = replace(pixels, scale=scale), [*findings, *scale.findings]
    source = VideoFile(
        path=path,
        shape=(height, width) if pixels.orientation <= 4 else (width, height),
        frame_count=count or None,
        frame_rate=frame_rate,
        exposure_stated=False,
        encoding=pixels.encoding,
        findings=(),
        is_estimate=is_estimate,
        length_s=length_s,
        pixels=pixels,
        options=options,
        modified=changed_at(path),
        scale=scale,
    )
    # Options that do not fit fail at once, and not once for each frame.
    example = source.stored(frames[0], 0).frame
    bare = example.clipped is None and example.black_level_dn is None and example.colour_filter is None
    is_grey = pixels.kind == "luma" and is_unchanged and not pixels.limited
    if options.encoding is None and is_grey and pixels.bits > SCREEN_BITS:
        from ..companded import companded_findings

        findings += companded_findings(histogram_of(example.dn), pixels.bits)
    values = np.dstack(pixels.planes(frames[0])) if pixels.kind == "rgb" else example.dn
    top_dn = scale.saturation_dn if pixels.kind == "rgb" else example.saturation_dn
    if curve is not None:
        top_dn = 2.0**scale.bits - 1
    return replace(
        source,
        findings=(*findings, *unused_options(example, scale.bits, options)),
        doubts=doubts_of(values, top_dn, pixels.stored, pixels.other_encoding, as_stored=bare),
    )


def _require_codes(pixels: Pixels, curve: Companding, is_unchanged: bool) -> None:
    """Refuse codes of a curve that a video cannot hold; raises InputError without the path."""
    what = (
        "colours" if pixels.kind != "luma"
        else "numbers that its codec changed" if not is_unchanged
        else "numbers of a limited range" if pixels.limited
        else "turned frames" if pixels.orientation != 1
        else f"{pixels.bits} bits" if pixels.bits < curve.file_bits
        else ""
    )  # fmt: skip
    if what:
        raise InputError(
            f"holds {what}, but codes of the curve {curve.name} are grey numbers of {curve.file_bits} bits as the "
            "sensor sent them: record them without loss, for example as FFV1 in gray16le, or as a folder of pictures"
        )


def _scale(frames: Sequence[Any], pixels: Pixels, options: PictureOptions, path: Path) -> Scale:
    """Bits and saturation of the numbers, of 16-bit grey or RGB as given or estimated from frames of all parts."""
    if isinstance(options.encoding, Companding):
        return Scale(options.encoding.file_bits, options.encoding.saturation_dn)
    if pixels.bits != 16 or pixels.limited or pixels.kind == "ycbcr":
        return Scale(pixels.bits, 2.0**pixels.bits - 1)
    n_planes = 3 if pixels.kind == "rgb" else 1
    # As of a folder of images: the first frames may be dark.
    looked_at = chain(frames, _spread(path, options.max_pixels, _MOST_BETWEEN) if options.stated_bits is None else ())
    alike = (frame for frame in looked_at if frame.format.name == pixels.format_name)
    planes = (plane for frame in alike for plane in pixels.planes(frame)[:n_planes])
    # The values that there are, of which there are fewer than pixels.
    values = np.concatenate([np.flatnonzero(np.bincount(plane.ravel())) for plane in planes])
    return scale_of(values.astype(np.uint16), 16, options, str(path))


def _spread(path: Path, max_pixels: int, most: int) -> Iterator[Any]:
    """Frames at equal steps of time from the first to the last, as far as the file can be read there.

    From the key frame before each, at `most` as many are decoded.
    """
    with _opened(path, max_pixels) as container, suppress(FFmpegError):
        stream = video_stream(container)
        duration, start = container.duration or 0, container.start_time or 0
        for at in np.linspace(start, start + duration, _SPREAD if duration > 0 else 0):
            container.seek(int(at))
            last = None
            for frame in islice(container.decode(stream), most):
                if last is not None and frame.time is not None and frame.time * av.time_base > at:
                    break
                last = last if frame.is_corrupt else frame
            if last is not None:
                yield last


def _announced(stream: Any) -> int:
    """Return the number of frames that a file announces, 0 if it does not; an edit list leaves some out."""
    entries = stream.index_entries
    if stream.frames and len(entries) and "mov" in stream.container.format.name:
        return sum(1 for entry in entries if not entry.is_discard)
    return int(stream.frames)


def _length_s(container: Any, stream: Any) -> float | None:
    """Time from the first frame to the end that a container states; None if it does not, or not for the video alone."""
    if not _STATING.intersection(container.format.name.split(",")):
        return None
    stated = _TIME.fullmatch(stream.metadata.get("DURATION", ""))
    if stated:
        length_s = sum(float(part) * unit for part, unit in zip(stated.groups(), (3600, 60, 1), strict=True))
    elif container.duration and not container.streams.audio:
        length_s = container.duration / av.time_base
    else:
        return None
    # Matroska counts from time 0.
    is_later = "matroska" in container.format.name and stream.start_time
    return max(length_s - float(stream.start_time * stream.time_base), 0.0) if is_later else length_s


@contextmanager
def _opened(path: Path, max_pixels: int) -> Iterator[Any]:
    """Open a file whose frames have at most so many pixels; whatever goes wrong becomes one InputError."""
    with reading(path, "a file you can read"), open_regular(path) as file:
        head = file.read(HEAD_BYTES)
    if refusal := no_video(path, head):
        raise refusal
    try:
        limits = {"protocol_whitelist": "file", "format_whitelist": _CONTAINERS}
        # As an absolute path, FFmpeg takes no part of the name as a protocol.
        container = av.open(os.path.abspath(path), container_options=limits, metadata_errors="replace")
    except (av.FFmpegError, ValueError, OverflowError) as error:
        why = getattr(error, "strerror", None) or reason(error)
        raise no_video(path, head, refused=True) or InputError(
            f"{path} is not a video FFmpeg can read, or is truncated ({why}): if another program plays it, convert "
            "it to FFV1 "
            "or MJPEG; otherwise copy it again"
        ) from error
    with container:
        stream = video_stream(container)
        if stream is None:
            what = "a cover picture, but no video" if container.streams.video else "no video"
            raise InputError(f"{path} holds {what}: give a video")
        context = stream.codec_context
        if context is None:
            raise InputError(f"{path} holds a video that FFmpeg does not decode: convert it to FFV1 or MJPEG")
        if context.width * context.height > max_pixels:
            raise InputError(
                f"{path} has frames of {context.width} x {context.height} pixels, more than {max_pixels / 1e6:g} "
                "megapixels: raise the limit if they are really that large"
            )
        context.options = {"max_pixels": str(max_pixels)}
        yield container
