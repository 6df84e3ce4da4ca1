"""Options given by the user: they take precedence over the file, and a finding reports contradictions."""

from __future__ import annotations

from dataclasses import replace
from math import isclose
from typing import TYPE_CHECKING

from ...core.finding import Finding, warning
from ...core.frame import Frame
from ...core.pixel_format import pixel_format
from .options import PictureOptions

if TYPE_CHECKING:
    from .picture import Picture

#: Difference that rounding explains: 1/60 s as 16.7 ms; an ISO speed in steps of a third.
_EXPOSURE_REL, _GAIN_DB = 0.005, 0.05
_OF_DN = {"exposure_s": "exposure", "gain_db": "gain", "bit_depth": "bit depth", "pixel_format": "pixel format"}


def overridden_frame(frame: Frame, options: PictureOptions) -> Frame:
    """Frame with the exposure and gain that the user gave."""
    if "exposure_s" in options.overrides and options.exposure_s is not None:
        frame = replace(frame, exposure_s=options.exposure_s)
    if "gain_db" in options.overrides and options.gain_db is not None:
        frame = replace(frame, gain_db=options.gain_db)
    return frame


def contradictions(exposure_s: float, gain_db: float, options: PictureOptions) -> tuple[Finding, ...]:
    """Find where a file says another exposure or gain than the user gave."""
    found = []
    given_s, given_db = options.exposure_s, options.gain_db
    if (
        "exposure_s" in options.overrides
        and given_s is not None
        and not isclose(exposure_s, given_s, rel_tol=_EXPOSURE_REL)
    ):
        found.append(warning("exposure-replaced", stated_s=exposure_s, given_s=given_s))
    if "gain_db" in options.overrides and given_db is not None and not isclose(gain_db, given_db, abs_tol=_GAIN_DB):
        found.append(warning("gain-replaced", stated_db=gain_db, given_db=given_db))
    return tuple(found)


def unused_options(frame: Frame | None, bits: int | None, options: PictureOptions) -> tuple[Finding, ...]:
    """Find what the user gave that cannot count for the DN of a file.

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
        given = [what for name, what in _OF_DN.items() if name in options.overrides]
        return tuple(warning("option-needs-dn", option=what) for what in given)
    found = []
    if "bit_depth" in options.overrides and options.bit_depth != bits:
        found.append(warning("bit-depth-ignored", given=options.bit_depth, bits=bits))
    name = options.pixel_format
    if "pixel_format" in options.overrides and name is not None and pixel_format(name).name != frame.pixel_format:
        found.append(warning("pixel-format-ignored", given=name))
    return tuple(found)


def with_overrides(picture: Picture, options: PictureOptions, bits: int | None) -> Picture:
    """Picture with what the user gave, and findings about what contradicts its file or cannot count for it."""
    found: list[Finding] = []
    frame = picture.frame
    if frame is not None:
        found += contradictions(frame.exposure_s, frame.gain_db, options)
        frame = overridden_frame(frame, options)
    found += unused_options(frame, bits, options)
    height, width = picture.shape
    if "size" in options.overrides and options.size is not None and options.size != (width, height):
        given_width, given_height = options.size
        found.append(
            warning("size-ignored", given_width=given_width, given_height=given_height, width=width, height=height)
        )
    if "encoding" in options.overrides and options.encoding not in (None, picture.encoding):
        found.append(warning("encoding-ignored", given=options.encoding, encoding=picture.encoding))
    return replace(picture, frame=frame, findings=(*picture.findings, *found))
