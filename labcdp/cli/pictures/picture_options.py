"""Options of pictures and videos: how values become luminance, what files may not state, and pairs of regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import typer

from ...core.cluster import TlsFiles
from ...core.errors import InputError
from ...core.result import InputFile
from ...core.roi import Roi
from ...evaluate.picture.conversion import PictureConversion, picture_conversion
from ...evaluate.video.archive_run import Workers
from ...evaluate.video.settings import Reference
from ...files.video.selection import Position, Selection
from ...regions import load_regions, rois_of
from ..options import CAMERA_SPEC_OPTION, CONTRAST_HELP, PAIR_METAVAR, parse_pair, parse_seconds
from ..terminal import fraction_of_percent


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
        return picture_conversion(self.calibration, self.camera_spec, self.encoding).given(**self.stated())

    def stated(self) -> dict[str, Any]:
        """Return what is given about the files, None for what is not; raises InputError."""
        exposure_s = None if self.exposure is None else parse_seconds(self.exposure, "--exposure")
        return {"exposure_s": exposure_s, "gain_db": self.gain_db, "bit_depth": self.bit_depth}

    def inputs(self, others: Mapping[str, Path | None]) -> list[InputFile]:
        """Return records of the input files other than pictures, by role; raises InputError if one cannot be read."""
        files = {**others, "calibration": self.calibration, "camera specification": self.camera_spec}
        return [InputFile.of(role, path) for role, path in files.items() if path is not None]


@dataclass(frozen=True)
class PictureLightOptions(LightOptions):
    """The same, and the layout of raw dumps."""

    pixel_format: str | None = typer.Option(
        None, "--pixel-format", help="GenICam pixel format of raw dumps, for example Mono12Packed; needs --size."
    )
    size: str | None = typer.Option(None, "--size", help="Width and height of raw dumps, for example 2464x2056.")

    def stated(self) -> dict[str, Any]:
        """Return what is given about the files, None for what is not; raises InputError."""
        size = None if self.size is None else _size(self.size)
        return {**super().stated(), "pixel_format": self.pixel_format, "size": size}


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


@dataclass(frozen=True)
class FrameOptions:
    """Options for which frames are evaluated."""

    damaged: bool = typer.Option(
        False, "--damaged", help="Also evaluate frames that are damaged or depend on damaged ones, with a note."
    )
    start: str = typer.Option("0", help="First frame, for example 250, 10s or 1:30; the regions refer to it.")
    stop: str | None = typer.Option(None, help="Frame to stop before; default: the end.")
    every: str = typer.Option(
        "1", help="Interval between evaluated frames, for example 25 or 1s; tracking uses all frames."
    )

    def selection(self) -> Selection:
        """Return which frames are meant; raises InputError."""
        stop = None if self.stop is None else Position.parse(self.stop, "--stop")
        return Selection(Position.parse(self.start, "--start"), stop, Position.parse(self.every, "--every"))


@dataclass(frozen=True)
class VideoPairOptions(PairOptions):
    """Options of regions in videos: how they are followed, and what contrast frames are compared with."""

    method: str = typer.Option(
        "follow",
        help="Tracking method: follow, homography (flat targets that tilt) or fixed; other ones for some regions: "
        "follow,wall=fixed.",
    )
    reference: str | None = typer.Option(
        None,
        "--reference",
        help="Reference contrast of each frame: a value such as 1000%, first (contrast of the first frame), or "
        "results.nc of another video, for example of a calibrated camera.",
    )
    reference_by: Literal["number", "time"] = typer.Option(
        "number", help="Match frames of a reference video by number or time."
    )

    def parsed_reference(self) -> Reference | None:
        """Return a reference contrast, or where it is; raises InputError."""
        text = self.reference
        if text is None:
            return None
        if text == "first":
            return "first"
        if text.endswith("%"):
            contrast = fraction_of_percent(text, "--reference")
            if not 0 < contrast < float("inf"):
                raise InputError(f"--reference is {text!r}: give a contrast above 0%")
            return contrast
        if not Path(text).is_file():
            raise InputError(
                f"--reference is {text!r}: give a contrast such as 1000%, first, or results.nc of another video"
            )
        return Path(text)


@dataclass(frozen=True)
class MadeOptions:
    """Options for what is made of each video besides its results."""

    annotated: bool = typer.Option(
        False, "--annotated", help="Also write a video with regions, tracking quality and CDP."
    )
    frames: bool = typer.Option(False, "--frames", help="Also write each evaluated frame as a PNG image.")


@dataclass(frozen=True)
class ClusterOptions:
    """Options for where several videos are evaluated."""

    cluster: str | None = typer.Option(
        None,
        "--cluster",
        metavar="ADDRESS",
        help="Address of a Dask scheduler for several videos, for example tls://192.0.2.7:8786.",
    )
    cluster_tls: tuple[Path, Path, Path] | None = typer.Option(
        None,
        "--cluster-tls",
        metavar="CA CERTIFICATE KEY",
        help="PEM files for a scheduler at an address tls://: certificate of the authority, own certificate and key.",
    )
    workers: int | None = typer.Option(
        None, help="Number of processes for several videos.", show_default="one per core", min=1
    )

    def chosen(self) -> Workers:
        """Return the processes or the cluster."""
        tls = None if self.cluster_tls is None else TlsFiles(*self.cluster_tls)
        return Workers(self.cluster, self.workers, tls)


def rois_and_pairs(
    path: Path | None, pairs: Sequence[str], neighbours: bool
) -> tuple[tuple[Roi, ...], tuple[tuple[str, str], ...]]:
    """Regions, and the pairs of them that are evaluated; none for nearest-neighbour CDP. Raises InputError."""
    if neighbours:
        if path is not None or pairs:
            raise InputError("--neighbours needs no regions: leave --roi and --pair out, or --neighbours")
        return (), ()
    if path is None:
        raise InputError("no regions given: give a file with --roi (see labcdp rois), or --neighbours")
    found = {one.name: one for one in rois_of(load_regions(path))}
    if not pairs:
        if len(found) != 2:
            raise InputError(
                f"{path} holds {len(found)} regions ({', '.join(found)}): choose pairs with --pair BRIGHT:DARK"
                if len(found) > 2
                else f"{path} holds one region: draw a second one, a CDP is of two"
            )
        first, second = found
        return tuple(found.values()), ((first, second),)
    chosen = tuple(dict.fromkeys(parse_pair(pair, list(found)) for pair in pairs))
    return tuple(found.values()), chosen
