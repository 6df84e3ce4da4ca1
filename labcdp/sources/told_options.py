"""What a person gave explicitly counts before what a file says, and nothing of it is left out without a word."""

from __future__ import annotations

from dataclasses import replace
from math import isclose
from typing import TYPE_CHECKING

from ..frame import Frame
from ..pixel_format import pixel_format
from .picture_options import PictureOptions

if TYPE_CHECKING:
    from .picture import Picture

#: Difference that rounding explains: 1/60 s as 16.7 ms; an ISO speed in steps of a third.
_EXPOSURE_REL, _GAIN_DB = 0.005, 0.05
_OF_DN = {"exposure_s": "exposure", "gain_db": "gain", "bit_depth": "bit depth", "pixel_format": "pixel format"}


def told_frame(frame: Frame, options: PictureOptions) -> Frame:
    """Frame with the exposure and gain that a person gave."""
    if "exposure_s" in options.told and options.exposure_s is not None:
        frame = replace(frame, exposure_s=options.exposure_s)
    if "gain_db" in options.told and options.gain_db is not None:
        frame = replace(frame, gain_db=options.gain_db)
    return frame


def contradictions(exposure_s: float, gain_db: float, options: PictureOptions) -> tuple[str, ...]:
    """Warnings where a file says another exposure or gain than a person gave."""
    warnings = []
    given_s, given_db = options.exposure_s, options.gain_db
    if "exposure_s" in options.told and given_s is not None and not isclose(exposure_s, given_s, rel_tol=_EXPOSURE_REL):
        warnings.append(f"the file says an exposure of {exposure_s:g} s: {given_s:g} s, which was given, counts")
    if "gain_db" in options.told and given_db is not None and not isclose(gain_db, given_db, abs_tol=_GAIN_DB):
        warnings.append(f"the file says a gain of {gain_db:.4g} dB: {given_db:.4g} dB, which was given, counts")
    return tuple(warnings)


def unused_options(frame: Frame | None, bits: int | None, options: PictureOptions) -> tuple[str, ...]:
    """Warnings about what a person gave that cannot count for the DN of a file.

    Parameters
    ----------
    frame : Frame or None
        The DN, None of a file of floats.
    bits : int or None
        Bits of the values as they were taken from the file.
    options : PictureOptions
        With what was given.
    """
    if frame is None:
        given = [what for name, what in _OF_DN.items() if name in options.told]
        return tuple(f"the {what} that was given does not count: the file holds no DN, but floats" for what in given)
    warnings = []
    if "bit_depth" in options.told and options.bit_depth != bits:
        warnings.append(f"the bit depth of {options.bit_depth} that was given does not count: the file has {bits} bits")
    name = options.pixel_format
    if "pixel_format" in options.told and name is not None and pixel_format(name).name != frame.pixel_format:
        warnings.append(f"the pixel format {name} that was given does not count: the file's values are of another kind")
    return tuple(warnings)


def as_told(picture: Picture, options: PictureOptions, bits: int | None) -> Picture:
    """Picture with what a person gave, and warnings about what contradicts its file or cannot count for it."""
    warnings: list[str] = []
    frame = picture.frame
    if frame is not None:
        warnings += contradictions(frame.exposure_s, frame.gain_db, options)
        frame = told_frame(frame, options)
    warnings += unused_options(frame, bits, options)
    height, width = picture.shape
    if "size" in options.told and options.size is not None and options.size != (width, height):
        warnings.append(
            f"the size of {options.size[0]} x {options.size[1]} pixels that was given does not count: the file says "
            f"its own, {width} x {height}"
        )
    if "encoding" in options.told and options.encoding not in (None, picture.encoding):
        warnings.append(
            f"the encoding {options.encoding} that was given does not count: the file's values are {picture.encoding}"
        )
    return replace(picture, frame=frame, warnings=tuple(warnings))
