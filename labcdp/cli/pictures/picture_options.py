"""Options of pictures and videos: how values become luminance, what files may not state, and pairs of regions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from ...core.errors import InputError
from ..options import CAMERA_SPEC_OPTION, CONTRAST_HELP, PAIR_METAVAR, parse_seconds

if TYPE_CHECKING:
    from ...core.result import InputFile
    from ...evaluate.picture.light.picture import PictureConversion
    from ...files.picture.read import PictureOptions


@dataclass(frozen=True)
class LightOptions:
    """Options of pictures and videos: the conversion to luminance, and what files may not state."""

    calibration: Path | None = typer.Option(
        None,
        "--calibration",
        help="Calibration file, for values in cd/m². Without it and --camera-spec, relative luminance is used.",
    )
    camera_spec: Path | None = CAMERA_SPEC_OPTION
    encoding: Literal["linear", "srgb"] | None = typer.Option(
        None,
        "--encoding",
        help="Encoding of the pixel values; default: as the camera specification or the file states, else the usual "
        "one of the file type.",
    )
    exposure: str | None = typer.Option(
        None, "--exposure", help="Exposure time, for example 5ms; default: as stated by each file."
    )
    gain_db: float | None = typer.Option(None, "--gain-db", help="Gain in dB; default: as stated by each file, else 0.")
    bit_depth: int | None = typer.Option(
        None,
        "--bit-depth",
        help="Bit depth of the values in 16-bit files, for example 12; default: estimated.",
        min=1,
        max=16,
    )

    def conversion(self) -> PictureConversion:
        """Load calibration or camera specification; raises InputError."""
        from ...evaluate.picture.light.picture import picture_conversion

        return picture_conversion(self.calibration, self.camera_spec, self.encoding)

    def stated(self) -> dict[str, Any]:
        """Return exposure_s, gain_db and bit_depth, None for what is not given; raises InputError."""
        exposure_s = None if self.exposure is None else parse_seconds(self.exposure, "--exposure")
        return {"exposure_s": exposure_s, "gain_db": self.gain_db, "bit_depth": self.bit_depth}

    def inputs(self, others: Mapping[str, Path | None]) -> list[InputFile]:
        """Return records of the input files other than pictures, by role; raises InputError if one cannot be read."""
        from ...core.result import InputFile

        files = {**others, "calibration": self.calibration, "camera specification": self.camera_spec}
        return [InputFile.of(role, path) for role, path in files.items() if path is not None]


@dataclass(frozen=True)
class PictureLightOptions(LightOptions):
    """The same, and the layout of raw dumps."""

    pixel_format: str | None = typer.Option(
        None, "--pixel-format", help="GenICam pixel format of raw dumps, for example Mono12Packed; needs --size."
    )
    size: str | None = typer.Option(None, "--size", help="Width and height of raw dumps, for example 2464x2056.")

    def over(self, options: PictureOptions) -> PictureOptions:
        """Override the values of a calibration or camera specification, and of the files, by what is given.

        Raises
        ------
        InputError
            If a text cannot be read, or a value is not possible.
        """
        size = None if self.size is None else _size(self.size)
        values = {**self.stated(), "pixel_format": self.pixel_format, "size": size}
        given: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
        return replace(options, **given, overrides=options.overrides | given.keys())


@dataclass(frozen=True)
class PairOptions:
    """Options of pictures and videos: regions, their pairs, and the contrasts to detect."""

    roi: Path | None = typer.Option(
        None,
        "--roi",
        help="Region file, of a video for its first frame: .json of labcdp rois, or .roi or .zip of ImageJ.",
    )
    contrast: list[str] = typer.Option(
        [],
        "--contrast",
        help=CONTRAST_HELP,
        show_default="the measured contrast of each pair, of a video in its first frame",
    )
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast.")
    pair: list[str] = typer.Option(
        [],
        "--pair",
        metavar=PAIR_METAVAR,
        help="Names of two regions, the brighter one first; may be repeated. Default: all pairs of up to 6 regions of "
        "a picture, the only pair of a video.",
    )
    neighbours: bool = typer.Option(
        False,
        "--neighbours",
        help="Compute the nearest-neighbour CDP: each pixel and its neighbours, for patterns 1 pixel wide.",
    )


def _size(text: str) -> tuple[int, int]:
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise InputError(f"--size is {text!r}: give width and height in pixels, for example 2464x2056") from None
    return width, height
