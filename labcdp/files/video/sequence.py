"""Images as a video: a folder of numbered ones, or the pages of a TIFF."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...core.disk import file_sha256
from ...core.errors import InputError
from ...core.frame import Frame, Readout
from ...core.result import Finding, info, warning
from ...session import FrameRecord, Session
from ...session.records import frame_times_s
from ..frame import guessed_scale, picture_bytes
from ..picture import Picture, PictureOptions, contradictions, overridden_frame
from ..read import picture_paths, read_page, read_picture
from ..tiff import count_pictures
from ..transfer import decoded_table
from .source import StoredPixels, VideoFrame, VideoSource, stored_pixels

#: Largest number in a name that can be one of a frame; others are times or dates.
_MOST_NUMBER = 10_000_000
#: Images that are looked at to estimate the bits of all.
_LOOKED_AT = 9


def open_sequence(folder: Path, options: PictureOptions) -> VideoSource:
    """Open a folder of images as a video.

    Parameters
    ----------
    folder : Path
        With images that `read_picture` reads; other files are left out. They follow each other by the numbers in their
        names.
    options : PictureOptions
        What they do not say. The bits of 16-bit values that they do not state are estimated once for all.

    Raises
    ------
    InputError
        If it holds no image, or none that can be read.
    """
    images = tuple(picture_paths([folder]))
    digest = hashlib.sha256()
    for image in images:
        digest.update(os.fsencode(image.name) + b"\0" + _digest(image))
    numbers = _numbers(images)
    numbering = info("frames-numbered-by-name" if numbers else "frames-numbered-from-0")
    return _sequence(
        folder,
        digest.hexdigest(),
        numbers or tuple(range(len(images))),
        lambda at, known: read_picture(images[at], known),
        options,
        (_sequence_finding(len(images), options), numbering),
    )


def open_stack(path: Path, options: PictureOptions) -> VideoSource:
    """Open a TIFF of several pictures as a video; raises InputError as `open_sequence`."""
    data, sha256 = picture_bytes(path, options.max_pixels)
    n = count_pictures(data, path)
    return _sequence(
        path, sha256, tuple(range(n)), lambda at, known: read_page(path, data, at, known),
        options, (_sequence_finding(n, options),),
    )  # fmt: skip


def _sequence_finding(n_images: int, options: PictureOptions) -> Finding:
    if options.frame_rate_hz is None:
        return info("image-sequence", images=n_images)
    return info("image-sequence-rate", images=n_images, frame_rate_hz=options.frame_rate_hz)


def _sequence(
    path: Path,
    sha256: str,
    numbers: tuple[int, ...],
    read: Callable[[int, PictureOptions], Picture],
    options: PictureOptions,
    findings: tuple[Finding, ...],
) -> VideoSource:
    looked_at: dict[int, Picture] = {}
    for at in dict.fromkeys(int(index) for index in np.linspace(0, len(numbers) - 1, min(_LOOKED_AT, len(numbers)))):
        looked_at |= _read(read, at, options)
    for at in range(len(numbers)):
        looked_at = looked_at or _read(read, at, options)
    if not looked_at and read(0, options).frame is None:
        raise InputError(
            f"{path} holds floats, or values that are not in proportion to the stored ones by the scale it states: a "
            "video is evaluated from the values of a camera; save it as whole numbers of 8 or 16 bits without a scale"
        )
    guessed, options = _one_scale(list(looked_at.values()), options)
    first = read(next((at for at in sorted(looked_at) if looked_at[at].coloured), min(looked_at)), options)
    # All are read as the first one is.
    options = replace(options, assumed_encoding=first.encoding)
    return ImageSequence(
        path=path,
        shape=first.shape,
        frame_count=numbers[-1] + 1,
        # Without a statement one a second, so that time is their number: images do not say it.
        frame_rate=options.frame_rate_hz or 1.0,
        exposure_stated=first.exposure_stated,
        encoding="linear" if first.coloured else first.encoding,
        findings=(*findings, *first.findings, *guessed),
        doubts=first.doubts,
        digest=sha256,
        numbers=numbers,
        read=partial(_read_alike, read, options, first),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class ImageSequence(VideoSource):
    """Images that follow each other.

    Parameters
    ----------
    digest : str
        Hash of all of them.
    numbers : tuple of int
        Of the frames.
    read : function of two int
        Reads an image, from 0, as the frame of a number.
    """

    digest: str
    numbers: tuple[int, ...]
    read: Callable[[int, int], Frame]

    @property
    def sha256(self) -> str:
        """Hash of all images."""
        return self.digest

    def entries(self) -> Iterator[VideoFrame]:
        """Go through all images."""
        assert self.frame_rate is not None
        for at, number in enumerate(self.numbers):
            time_s = (number - self.numbers[0]) / self.frame_rate
            yield VideoFrame(number, time_s, None, partial(self._load, at, number))

    def _load(self, at: int, number: int) -> StoredPixels:
        return stored_pixels(self.read(at, number))


def _read_alike(
    read: Callable[[int, PictureOptions], Picture], options: PictureOptions, first: Picture, at: int, number: int
) -> Frame:
    return _alike(read(at, options), first, number)


def _alike(picture: Picture, first: Picture, number: int) -> Frame:
    """Frame of an image, of the same kind as the first one."""
    if picture.frame is None:
        raise InputError("it holds floats: a video is evaluated from the values of a camera")
    frame = picture.frame
    if picture.encoding != first.encoding or (picture.coloured and not first.coloured):
        raise InputError("it is coloured or encoded in another way than the first image")
    if first.coloured and not picture.coloured:
        # Without colour, such as a black one.
        light = np.rint(65535 * decoded_table(frame.bit_depth, picture.encoding)).astype(np.uint16)
        frame = replace(
            frame, dn=light[frame.dn], bit_depth=16, saturation_dn=65535.0, pixel_format="Mono16",
            clipped=frame.saturated,
        )  # fmt: skip
    return replace(frame, frame_id=number)


def _read(read: Callable[[int, PictureOptions], Picture], at: int, options: PictureOptions) -> dict[int, Picture]:
    """Image at a place; nothing if it cannot be read or holds floats, as it is a broken frame."""
    with suppress(InputError):
        picture = read(at, options)
        return {} if picture.frame is None else {at: picture}
    return {}


def _one_scale(pictures: Sequence[Picture], options: PictureOptions) -> tuple[tuple[Finding, ...], PictureOptions]:
    """Options with bits and saturation of 16-bit values for all images alike, if they do not state them."""
    guesses = [picture.guessed_by for picture in pictures if picture.guessed_by is not None]
    if not guesses:
        return (), options
    scale = guessed_scale(
        max(largest for largest, _ in guesses), int(np.bitwise_or.reduce([bits for _, bits in guesses])), 16
    )
    saturation_dn = options.saturation_dn or scale.saturation_dn
    return scale.findings, replace(options, bit_depth=scale.bits, saturation_dn=saturation_dn)


def _numbers(images: Sequence[Path]) -> tuple[int, ...]:
    """Numbers in the names that count up from image to image, the last such ones; nothing if there are none."""
    numbers_by_image = [[int(digits) for digits in reversed(re.findall("[0-9]+", image.stem))] for image in images]
    for numbers in zip(*numbers_by_image, strict=False):
        if all(a < b for a, b in pairwise(numbers)) and numbers[-1] < _MOST_NUMBER:
            return numbers
    return ()


def _digest(path: Path) -> bytes:
    """Hash of a file; of one that cannot be read nothing, as it is a broken frame."""
    with suppress(InputError):
        return bytes.fromhex(file_sha256(path, "an image"))
    return b""


def open_session_video(path: Path, options: PictureOptions) -> VideoSource:
    """Open the light frames of a session, in the order they were recorded.

    Parameters
    ----------
    path : Path
        The session's folder.
    options : PictureOptions
        Of these only encoding, and exposure and gain count that the user gave.

    Raises
    ------
    SessionError
        If the session was altered.
    InputError
        If it has no light frames.
    """
    session = Session.open(path)
    records = tuple(session.frames("light"))
    if not records:
        raise InputError(f"{path} is a session without light frames: resume the acquisition")

    times_s, shown = frame_times_s(records), records[0].metadata.get("readout")
    return SessionVideo(
        path=path,
        shape=records[0].shape,
        frame_count=len(records),
        frame_rate=(len(records) - 1) / times_s[-1] if times_s[-1] > 0 else None,
        exposure_stated=True,
        encoding=session.configuration.camera.curve or options.encoding or "linear",
        readout=None if shown is None else Readout.from_json(shown),
        lens=session.configuration.optics,
        findings=_findings(records, options),
        session=session,
        records=records,
        options=options,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class SessionVideo(VideoSource):
    """Light frames of a session.

    Parameters
    ----------
    session : Session
        The session.
    records : tuple of FrameRecord
        Its light frames.
    options : PictureOptions
        What the user gave.
    """

    session: Session
    records: tuple[FrameRecord, ...]
    options: PictureOptions

    @property
    def sha256(self) -> str:
        """Hash of the hashes of the frames."""
        return hashlib.sha256("".join(record.file.sha256 for record in self.records).encode()).hexdigest()

    def entries(self) -> Iterator[VideoFrame]:
        """Go through all frames."""
        for number, (record, time_s) in enumerate(zip(self.records, frame_times_s(self.records), strict=True)):
            yield VideoFrame(number, time_s, None, partial(self._load, record))

    def _load(self, record: FrameRecord) -> StoredPixels:
        return stored_pixels(overridden_frame(self.session.load(record), self.options))


def _findings(records: Sequence[FrameRecord], options: PictureOptions) -> tuple[Finding, ...]:
    """Where the times come from; exposures and gains that were given instead, or differ, which looks like light."""
    settings = {(record.exposure_s, record.gain_db) for record in records}
    findings = [info("session-frames")]
    findings += [finding for setting in sorted(settings) for finding in contradictions(*setting, options)]
    if "bit_depth" in options.overrides:
        findings.append(warning("session-bit-depth"))
    if len(settings) > 1:
        findings.append(warning("session-settings-differ"))
    return tuple(findings)
