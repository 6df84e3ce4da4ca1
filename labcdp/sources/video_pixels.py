"""What the numbers of a video file are: grey, luma of full or limited range, or colours."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

#: Every so many pixels along each side tell whether a picture is coloured.
_STEP = 4
#: Black and white of Y' in limited range (ITU-R BT.601 and BT.709: 16 and 235 of 8 bits).
_LIMITED = (16, 235)
#: Mean spread of red, green and blue from which a picture is coloured, DN.
_COLOURED_DN = 4.0
Pixels = Literal["luma", "limited luma", "colours"]


@dataclass
class Look:
    """What a file's numbers are."""

    pixels: Pixels
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def look(colours: list[NDArray[Any]], stored: list[NDArray[Any]], bits: int) -> Look:
    """Learn what the numbers are by comparing the stored ones with red, green and blue as OpenCV makes them."""
    seen = Look("colours")
    shapes = {one.shape for one in stored}
    if len(stored) == len(colours) and shapes == {colours[0].shape[:2]}:
        seen.pixels = "luma"
        if stored[0].dtype == np.uint8:
            seen.pixels = _range_of(colours, stored)
    if bits > 8 and (seen.pixels == "colours" or stored[0].dtype == np.uint8):
        seen.warnings.append(f"the video has {bits} bits, OpenCV gives 8 of them: the lowest {bits - 8} are lost")
    if seen.pixels == "limited luma":
        seen.notes.append("Y' of limited range (16 to 235) stretched to 0 to 255")
    elif seen.pixels == "colours":
        seen.notes.append("red, green and blue to Y' (ITU-R BT.601)")
    if max(map(_spread_dn, colours)) > _COLOURED_DN:
        seen.warnings.append(
            "the video is coloured: its Y' is taken for light, which holds for grey objects; coloured ones have "
            "another luminance"
        )
    return seen


def _spread_dn(colours: NDArray[Any]) -> float:
    """Mean spread of red, green and blue."""
    if colours.ndim != 3:
        return 0.0
    few = colours[::_STEP, ::_STEP].astype(int)
    return float((few.max(axis=2) - few.min(axis=2)).mean())


def _range_of(colours: list[NDArray[Any]], stored: list[NDArray[Any]]) -> Pixels:
    """Full or limited range: whichever comes closer to what OpenCV makes of it."""
    import cv2

    off: dict[Pixels, float] = {"luma": 0.0, "limited luma": 0.0}
    for colour, luma in zip(colours, stored, strict=True):
        grey = colour if colour.ndim == 2 else cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
        for pixels in off:
            off[pixels] += float(cv2.norm(grey_pixels(luma, pixels), grey, cv2.NORM_L1))
    # A flat picture close to the middle tells nothing: then the range that most codecs use.
    return "luma" if off["luma"] < off["limited luma"] else "limited luma"


def grey_pixels(pixels: NDArray[Any], kind: Pixels) -> NDArray[Any]:
    """Return the grey values of a frame as OpenCV returned it."""
    import cv2

    if kind == "limited luma":
        return np.asarray(cv2.LUT(pixels, _STRETCHED))
    if kind == "colours" and pixels.ndim == 3:
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))
    return pixels


_STRETCHED: NDArray[np.uint8] = np.clip(
    np.rint((np.arange(256) - _LIMITED[0]) * 255 / (_LIMITED[1] - _LIMITED[0])), 0, 255
).astype(np.uint8)


def text_of_code(code: int) -> str:
    """Return the four letters of a codec or a pixel format."""
    return "".join(chr((code >> shift) & 0xFF) for shift in (0, 8, 16, 24))


def bits_of_tag(tag: int) -> int:
    """Bits of FFmpeg's pixel format, by the tag it gives formats of more than 8 bits: Y, kind, shift, bits."""
    first, kind, _, bits = (ord(c) for c in text_of_code(tag))
    return bits if chr(first) == "Y" and chr(kind) in "123" and 8 < bits <= 16 else 8
