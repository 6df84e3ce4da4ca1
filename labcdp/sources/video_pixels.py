"""What the numbers of a video file are: grey, luma of full or limited range, or colours."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

#: Pixels of a picture that are looked at, of each step of so many rows and columns one.
_LOOKED_AT = 2**17
#: Factor by which Y' of limited range is stretched (ITU-R BT.601 and BT.709: 16 to 235 of 8 bits).
_STRETCH = 255 / 219
#: Mean spread of red, green and blue from which a picture is coloured, DN.
_COLOURED_DN = 4.0
#: So far the stored values may be off OpenCV's grey (median), which its rounding and clipped colours explain, DN.
_AGREE_DN = 4.0
#: A pixel tells the range from here on, DN between both; OpenCV's grey is up to 2 DN low, half of that in the mean.
_TELLING_DN, _LOW_DN = 5, 0.75
#: Pixels that are enough to tell, and standard deviation from which the slope of the others tells, DN.
_ENOUGH, _ENOUGH_SPREAD_DN = 16, 8.0
Pixels = Literal["luma", "limited luma", "colours"]


@dataclass
class Look:
    """What a file's numbers are."""

    pixels: Pixels
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def look(colours: list[NDArray[Any]], stored: list[NDArray[Any]], tag: int, motion_jpeg: bool) -> Look:
    """Learn what the numbers are by comparing the stored ones with red, green and blue as OpenCV makes them.

    Parameters
    ----------
    colours, stored : list of ndarray
        The first frames both ways.
    tag : int
        Of the pixel format.
    motion_jpeg : bool
        Whether the packets are JPEG images, whose range is full where nothing tells.
    """
    seen, bits = Look("colours"), bits_of_tag(tag)
    shapes = {one.shape for one in stored}
    alike = len(stored) == len(colours) and shapes == {colours[0].shape[:2]}
    colours, stored = [*map(_some, colours)], [*map(_some, stored)]
    # What is stored as red, green and blue comes as bytes without meaning.
    if alike and not _is_rgb(tag):
        seen.pixels = _luma_of(colours, stored, tag, motion_jpeg, seen.warnings)
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


def _some(pixels: NDArray[Any]) -> NDArray[Any]:
    """Enough pixels, from everywhere; the step is odd, so that it does not go with the codec's blocks."""
    step = int((pixels.shape[0] * pixels.shape[1] / _LOOKED_AT) ** 0.5) // 2 * 2 + 1
    return np.ascontiguousarray(pixels[::step, ::step])


def _is_rgb(tag: int) -> bool:
    return any(name in text_of_code(tag).upper() for name in ("RGB", "BGR"))


def _spread_dn(colours: NDArray[Any]) -> float:
    """Mean spread of red, green and blue."""
    if colours.ndim != 3:
        return 0.0
    least, most = _least_and_most(colours)
    return float((most - least).mean())


def _luma_of(
    colours: list[NDArray[Any]], stored: list[NDArray[Any]], tag: int, motion_jpeg: bool, warnings: list[str]
) -> Pixels:
    """Full or limited range, or colours where what is stored is not the grey of the picture."""
    luma, grey = (np.concatenate([one.ravel() for one in found]) for found in (stored, map(_grey_of, colours)))
    if luma.dtype != np.uint8:
        # Whatever the bits are, grey is in proportion to them.
        return "luma" if _off_line(luma.astype(float), grey.astype(float)) <= _AGREE_DN else "colours"
    clear = np.concatenate([_clear(one).ravel() for one in colours])
    if np.count_nonzero(clear) >= _ENOUGH:
        luma, grey = luma[clear], grey[clear]
    full = _is_full(luma, grey)
    if full is None:
        full = motion_jpeg or text_of_code(tag) in _GREY_FORMATS
        if not full:
            warnings.append(
                "the picture is too even to tell the range of its Y': limited range (16 to 235) is assumed, which most "
                "codecs use; if it is full, contrasts are too high"
            )
    pixels: Pixels = "luma" if full else "limited luma"
    off = np.abs(grey_pixels(luma, pixels).ravel().astype(int) - grey)
    return pixels if float(np.median(off)) <= _AGREE_DN else "colours"


def _is_full(luma: NDArray[np.uint8], grey: NDArray[np.uint8]) -> bool | None:
    """Whether Y' has full range, by its level where both differ, else by how steeply grey follows; None if unknown."""
    from .video_kernel import stretched

    apart = stretched(np.arange(256, dtype=np.uint8)).astype(int) - np.arange(256)
    telling = np.abs(apart) >= _TELLING_DN
    found = telling[luma]
    if np.count_nonzero(found) >= _ENOUGH:
        expected = apart[luma[found]]
        off = grey[found].astype(int) - luma[found]
        middle = expected / 2 - _LOW_DN
        limited = np.where(expected > 0, off > middle, off < middle)
        return bool(np.mean(limited) < 0.5)
    if luma.std() < _ENOUGH_SPREAD_DN:
        return None
    slope = np.cov(luma, grey)[0, 1] / np.var(luma, ddof=1)
    return bool(slope < (1 + _STRETCH) / 2)


def _off_line(luma: NDArray[np.float64], grey: NDArray[np.float64]) -> float:
    """Median distance of grey from the line through it."""
    spread = luma.std()
    slope = np.mean((luma - luma.mean()) * (grey - grey.mean())) / spread**2 if spread else 0.0
    return float(np.median(np.abs(grey - grey.mean() - slope * (luma - luma.mean()))))


def _grey_of(colours: NDArray[Any]) -> NDArray[Any]:
    import cv2

    return colours if colours.ndim == 2 else np.asarray(cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY))


def _clear(colours: NDArray[Any]) -> NDArray[np.bool_]:
    """Pixels whose colour was not cut off at an end, so that their grey is their Y'."""
    if colours.ndim == 2:
        return np.ones(colours.shape, bool)
    least, most = _least_and_most(colours)
    return np.asarray(((least > 0) & (most < 255)) | (most - least <= _COLOURED_DN))


def _least_and_most(colours: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    blue, green, red = np.moveaxis(colours, 2, 0)
    return np.minimum(np.minimum(blue, green), red), np.maximum(np.maximum(blue, green), red)


def grey_pixels(pixels: NDArray[Any], kind: Pixels) -> NDArray[Any]:
    """Return the grey values of a frame as OpenCV returned it."""
    import cv2

    if kind == "limited luma":
        from .video_kernel import stretched

        return stretched(np.ascontiguousarray(pixels))
    if kind == "colours" and pixels.ndim == 3:
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))
    return pixels


#: Formats of grey alone, which are of full range.
_GREY_FORMATS = ("Y800", "GREY", "Y8  ")


def text_of_code(code: int) -> str:
    """Return the four letters of a codec or a pixel format."""
    return "".join(chr((code >> shift) & 0xFF) for shift in (0, 8, 16, 24))


def bits_of_tag(tag: int) -> int:
    """Bits of FFmpeg's pixel format, by the tag it gives formats of more than 8 bits: Y, kind, shift, bits."""
    first, kind, _, bits = (ord(c) for c in text_of_code(tag))
    return bits if chr(first) == "Y" and chr(kind) in "123" and 8 < bits <= 16 else 8
