"""Frames of DN whose file, or video, says little about them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.frame import CameraIdentity, Frame
from ..core.pixel_format import pixel_format
from ..core.result import Finding, info, warning
from .picture import PictureOptions

#: Exposure of pictures without one; relative luminance does not depend on it.
NO_EXPOSURE_S = 1.0
#: Camera of pictures without one.
UNKNOWN_CAMERA = CameraIdentity("unknown", "unknown", "unknown")


def frame_of_pixels(
    dn: NDArray[np.unsignedinteger[Any]], options: PictureOptions, timestamp: datetime, frame_id: int = 0
) -> Frame:
    """Frame of DN that come without any statement, such as those of a video.

    Parameters
    ----------
    dn : ndarray of uint8 or uint16, shape (height, width)
        The DN.
    options : PictureOptions
        What is known about them. A bit depth or a pixel format of more than 8 bits counts for 16-bit DN only.
    timestamp : datetime
        When they were taken, with time zone.
    frame_id : int
        Number of the frame.

    Raises
    ------
    InputError
        If the options do not fit the DN.
    """
    bits = 8 * dn.dtype.itemsize
    given = options.bit_depth is not None or options.pixel_format is not None
    # A guess for each frame of a video could change from one to the next.
    scale = scale_of(dn, bits, options, "the picture") if given else Scale(bits, 2.0**bits - 1)
    return make_frame(dn, scale, options, timestamp, frame_id)


def scale_of(values: NDArray[Any], bits: int, options: PictureOptions, source: str) -> Scale:
    """Bits and saturation of DN, as stated by the file; for any depth stored in 16 bits, as given or estimated.

    Parameters
    ----------
    values : ndarray of uint8 or uint16
        The DN, or colours.
    bits : int
        Bits the file states.
    options : PictureOptions
        Bit depth, or a pixel format that says it.
    source : str
        What messages call the picture.

    Raises
    ------
    InputError
        If a value is beyond the given bits.
    """
    if bits != 16:
        return Scale(bits, 2.0**bits - 1)
    given = options.bit_depth
    if given is None and options.pixel_format is not None:
        given = pixel_format(options.pixel_format).bit_depth
    if given is None:
        return guessed_scale(int(values.max()), int(np.bitwise_or.reduce(values, axis=None)), bits)
    largest = int(values.max())
    if largest >= 2**given:
        raise InputError(
            f"{source} has values up to {largest}, above {given} bits: give the bit depth it was written with"
        )
    return Scale(given, 2.0**given - 1)


def make_frame(
    dn: NDArray[np.unsignedinteger[Any]], scale: Scale, options: PictureOptions, timestamp: datetime, frame_id: int = 0
) -> Frame:
    """Frame of DN of a scale; a pixel format of another depth does not count."""
    given = None if options.pixel_format is None else pixel_format(options.pixel_format)
    fits = given is not None and given.bit_depth == scale.bits
    top = 2.0**scale.bits - 1
    saturation_dn = scale.saturation_dn if options.saturation_dn is None else min(options.saturation_dn, top)
    return Frame(
        dn=dn,
        exposure_s=options.exposure_s or NO_EXPOSURE_S,
        gain_db=options.gain_db or 0.0,
        bit_depth=scale.bits,
        saturation_dn=saturation_dn,
        black_level_dn=options.black_level_dn,
        pixel_format=given.name if fits and given is not None else f"Mono{scale.bits}",
        colour_filter=given.colour_filter if fits and given is not None else None,
        temperature_c=None,
        timestamp=timestamp,
        camera_timestamp_ns=0,
        frame_id=frame_id,
        camera=options.camera or UNKNOWN_CAMERA,
    )


#: Bits of converters whose DN are kept in 16 bits.
_DEPTHS = (10, 12, 14)


@dataclass(frozen=True)
class Scale:
    """Bits of the DN scale, the DN from which a pixel is saturated, and how they were found."""

    bits: int
    saturation_dn: float
    findings: tuple[Finding, ...] = ()


def guessed_scale(largest: int, in_use: int, bits: int) -> Scale:
    """Scale of DN in a wider type: that of a converter at whose highest DN the values end, else the type's own.

    Parameters
    ----------
    largest : int
        Largest DN of all pictures that belong together.
    in_use : int
        Bits that are set in any of them.
    bits : int
        Bits of the type.
    """
    for depth in _DEPTHS:
        if largest == 2**depth - 1 < 2**bits - 1:
            return Scale(depth, float(largest), (info("bit-depth-guessed", bits=depth, saturation_dn=largest),))
    for depth in _DEPTHS:
        step = 2 ** (bits - depth)
        top = 2**bits - step
        if largest == top and not in_use & (step - 1):
            found = info("bit-depth-guessed-upper", bits=depth, stored_bits=bits, saturation_dn=top)
            return Scale(bits, float(top), (found,))
    findings: tuple[Finding, ...] = ()
    if largest < 2 ** (bits - 1):
        findings = (warning("bit-depth-unknown", largest_dn=largest, top_dn=2**bits - 1),)
    return Scale(bits, 2.0**bits - 1, findings)
