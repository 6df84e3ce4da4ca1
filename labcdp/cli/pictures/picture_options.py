"""Options for what image files may not state: exposure, gain, bit depth, and the layout of raw dumps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ...core.errors import InputError
from ..options import parse_seconds

if TYPE_CHECKING:
    from ...core.result import InputFile
    from ...files.picture.read import PictureOptions

EXPOSURE_OPTION = typer.Option(
    None, "--exposure", help="Exposure time, for example 5ms; default: as stated by each file."
)
GAIN_OPTION = typer.Option(None, "--gain-db", help="Gain in dB; default: as stated by each file, else 0.")
BITS_OPTION = typer.Option(
    None,
    "--bit-depth",
    help="Bit depth of the values in 16-bit files, for example 12; default: estimated.",
    min=1,
    max=16,
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
    """Override the values of a calibration or camera specification, and of the files, by options.

    Raises
    ------
    InputError
        If a text cannot be read, or a value is not possible.
    """
    values = {
        "exposure_s": None if exposure is None else parse_seconds(exposure, "--exposure"),
        "gain_db": gain_db,
        "bit_depth": bit_depth,
        "pixel_format": pixel_format,
        "size": None if size is None else _size(size),
    }
    given: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
    return replace(options, **given, overrides=options.overrides | given.keys())


def _size(text: str) -> tuple[int, int]:
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise InputError(f"--size is {text!r}: give width and height in pixels, for example 2464x2056") from None
    return width, height


def input_files(files: Mapping[str, Path | None]) -> list[InputFile]:
    """Return records of the input files other than pictures, by role; raises InputError if one cannot be read."""
    from ...core.result import InputFile

    return [InputFile.of(role, path) for role, path in files.items() if path is not None]
