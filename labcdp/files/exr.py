"""OpenEXR files: linear light in floats."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.disk import parse_json, shortened
from ..core.disk.files import named_plainly
from ..core.errors import InputError
from ..core.result import Finding, info, warning
from .statements import FileStatements, positive_number
from .stored_image import Stored, decoder_messages, real_numbers, require_size
from .transfer import BT709_LUMINANCE, Weights, luminance_weights

#: Compressions by which values change that are of no use to a viewer (OpenEXR's technical introduction).
_LOSSY = frozenset({"B44", "B44A", "DWAA", "DWAB"})
#: Channels of a picture of the largest size, and of any.
_MOST_CHANNELS, _MOST_NAMES = 4, 1000
#: Attributes by which programs state a curve (OpenImageIO; the Color Interop Forum's identifiers), and linear ones.
_CURVES = ("oiio:ColorSpace", "oiio:Gamma", "colorInteropID")
_LINEAR = re.compile(r"lin|scene_linear|acescg|aces2065|data|raw|unknown|1(\.0*)?$", re.IGNORECASE)
#: Names of a channel of luminance: that of OpenEXR's luminance/chroma images, and spelt out.
_LUMINANCE = ("Y", "luminance")


def read_exr(_data: bytes, path: Path, max_pixels: int) -> Stored:
    """Read luminance, or the luminance of red, green and blue, of an OpenEXR file; it is opened by its name.

    With the attribute whiteLuminance (OpenEXR's standard attributes: luminance in cd/m^2 of the value 1) the values
    have a unit.

    Raises
    ------
    InputError
        If it is truncated, damaged, deep, larger than `max_pixels`, holds several pictures, or has other channels.
    """
    header, channels = exr_channels(path, max_pixels)
    width, height = _size(header)
    others = sorted(set(channels) - set(_LUMINANCE if set(_LUMINANCE) & set(channels) else "RGB"))
    changes = [info("channels-ignored", channels=others)] if others else []
    doubts = [
        warning("curve-not-used", by=f"its attribute {name} ({shortened(text)})", reason="OpenEXR holds linear values")
        for name in _CURVES if name in header and not _LINEAR.match(text := str(header[name]))
    ]  # fmt: skip
    compression = str(header["compression"]).rpartition(".")[2].removesuffix("_COMPRESSION")
    if compression in _LOSSY:
        changes.append(info("lossy-compression", name=compression))
    if not np.array_equal(header["dataWindow"], header.get("displayWindow", header["dataWindow"])):
        changes.append(info("data-window"))
    luminance = next((channels[name] for name in _LUMINANCE if name in channels), None)
    if luminance is None and set("RGB") <= set(channels):
        weights, change = weights_of_header(header)
        # Infinite and undefined values stay so.
        with np.errstate(invalid="ignore"):
            luminance = np.tensordot(
                np.array(weights, dtype=np.float32), np.stack([channels[c] for c in "RGB"]), axes=1
            )
        changes.append(change)
        if change.code == "colour-to-grey" and "chromaticities" in header:
            doubts.append(warning("primaries-not-used", by="its attribute chromaticities"))
    if luminance is None:
        raise InputError(
            f"{path} has the channels {shortened(', '.join(sorted(channels)))}: give one with Y, luminance, or R, G "
            "and B"
        )
    if luminance.shape != (height, width):
        raise InputError(
            f"{path} has a luminance channel with fewer pixels than the picture: save it at full resolution"
        )
    white = positive_number(header.get("whiteLuminance"))
    if white is None and "whiteLuminance" in header:
        doubts.append(warning("value-scale-not-used", by="its attribute whiteLuminance"))
    light = real_numbers(luminance, path)
    return light, FileStatements(cd_m2_per_value=white, changes=tuple(changes), findings=tuple(doubts))


def exr_header(path: Path, max_pixels: int) -> dict[str, Any]:
    """Read the attributes of an OpenEXR file, and nothing else.

    Raises
    ------
    InputError
        If it is damaged, deep, holds several pictures, or more than `max_pixels`.
    """
    import OpenEXR

    with _opened(path, header_only=True) as file:
        if len(file.parts) != 1:
            raise InputError(f"{path} holds {len(file.parts)} pictures: give files of one picture each")
        header = dict(file.header())
    if header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile):
        raise InputError(f"{path} is a deep OpenEXR file, with several values per pixel: save it flat")
    width, height = _size(header)
    require_size(path, width, height, max_pixels)
    n_channels = len(header.get("channels", ()))
    # All of them are decoded.
    if n_channels * width * height > _MOST_CHANNELS * max_pixels or n_channels > _MOST_NAMES:
        raise InputError(
            f"{path} has {n_channels} channels of {width} x {height} pixels: save the luminance, or R, G and B"
        )
    return header


def exr_channels(path: Path, max_pixels: int) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read attributes and all channels of an OpenEXR file; raises InputError as `exr_header`."""
    header = exr_header(path, max_pixels)
    with _opened(path, separate_channels=True) as file:
        return header, {name: channel.pixels.copy() for name, channel in file.channels().items()}


def _size(header: dict[str, Any]) -> tuple[int, int]:
    """Width and height of the data window; both ends are in it."""
    (x0, y0), (x1, y1) = header["dataWindow"]
    return int(x1) - int(x0) + 1, int(y1) - int(y0) + 1


@contextmanager
def _opened(path: Path, **how: bool) -> Iterator[Any]:
    """Open a file; the library reports damage by printing, by a file without pictures, or by what its parts raise."""
    import OpenEXR

    printed = StringIO()
    try:
        with named_plainly(path) as name, redirect_stdout(printed), decoder_messages():
            file = OpenEXR.File(str(name), **how)
        if not file.parts:
            raise ValueError(printed.getvalue() or "it holds no picture")
        with file:
            yield file
    except (InputError, MemoryError):
        raise
    except Exception as error:
        why = str(error).partition("\n")[0].rpartition(" - ")[2].replace(f"'{path}'", "it")
        raise InputError(
            f"{path} cannot be read as OpenEXR ({shortened(why) or type(error).__name__}): if another program opens "
            "it, save it there again; otherwise copy it again"
        ) from error


def weights_of_header(header: dict[str, Any]) -> tuple[Weights, Finding]:
    """Weights of red, green and blue in luminance: by the chromaticities of the file, else ITU-R BT.709."""
    given = header.get("chromaticities")
    weights = None if given is None else luminance_weights(np.array(given, dtype=float).reshape(-1, 2).tolist())
    if weights is None:
        return BT709_LUMINANCE, info("colour-to-grey")
    return weights, info("colour-to-grey-by-file")


def exr_text(path: Path, max_pixels: int) -> dict[str, Any] | None:
    """Return what labcdp noted in a file it wrote, None for others; raises InputError as `exr_header`."""
    text = exr_header(path, max_pixels).get("labcdp")
    with suppress(InputError):
        values = parse_json(text) if isinstance(text, str) else None
        return values if isinstance(values, dict) else None
    return None
