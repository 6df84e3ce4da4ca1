"""Options for what image files do not say themselves: exposure, gain, bits, and the layout of raw dumps."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import typer

from ..errors import InputError

if TYPE_CHECKING:
    from ..sources.picture import PictureOptions

EXPOSURE_OPTION = typer.Option(None, "--exposure", help="Exposure time, for example 5ms; default: as each file says.")
GAIN_OPTION = typer.Option(None, "--gain-db", help="Gain in dB; default: as each file says, else 0.")
BITS_OPTION = typer.Option(
    None, "--bit-depth", help="Bits of the values in files of 16 bits, for example 12; default: guessed.", min=1, max=16
)
FORMAT_OPTION = typer.Option(
    None, "--pixel-format", help="GenICam pixel format of raw dumps, for example Mono12Packed; needs --size."
)
SIZE_OPTION = typer.Option(None, "--size", help="Width and height of raw dumps, for example 2464x2056.")


def picture_options(
    options: PictureOptions,
    exposure: str | None,
    gain_db: float | None,
    bit_depth: int | None,
    pixel_format: str | None,
    size: str | None,
) -> PictureOptions:
    """Put what was typed over what a calibration or camera specification says; it counts before what files say.

    Raises
    ------
    InputError
        If a text cannot be read, or a value is not possible.
    """
    values = {
        "exposure_s": None if exposure is None else seconds(exposure, "--exposure"),
        "gain_db": gain_db,
        "bit_depth": bit_depth,
        "pixel_format": pixel_format,
        "size": None if size is None else _size(size),
    }
    given: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
    return replace(options, **given, told=options.told | given.keys())


def seconds(text: str, name: str) -> float:
    """Turn ``5ms`` into 0.005.

    Raises
    ------
    InputError
        If it is not a number above 0 with s, ms or us.
    """
    for unit, scale in (("ms", 1e-3), ("us", 1e-6), ("s", 1.0)):
        if text.endswith(unit):
            try:
                value = float(text.removesuffix(unit)) * scale
            except ValueError:
                break
            if isfinite(value) and value > 0:
                return value
            break
    raise InputError(f"{name} is {text!r}: give a number above 0 with s, ms or us, for example 5ms")


def _size(text: str) -> tuple[int, int]:
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise InputError(f"--size is {text!r}: give width and height in pixels, for example 2464x2056") from None
    return width, height
