"""Options of videos: frames, reference contrast and cluster; and regions and pairs as they are typed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from ...core.errors import InputError
from ..options import parse_pair
from ..terminal import fraction_of_percent
from .picture_options import PairOptions

if TYPE_CHECKING:
    from ...core.roi import Roi
    from ...evaluate.video.archive.evaluate import Workers
    from ...evaluate.video.settings import Reference
    from ...files.video.selection import Selection


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
        from ...files.video.selection import Position, Selection

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
        from ...core.computer.cluster import TlsFiles
        from ...evaluate.video.archive.evaluate import Workers

        tls = None if self.cluster_tls is None else TlsFiles(*self.cluster_tls)
        return Workers(self.cluster, self.workers, tls)


def rois_and_pairs(
    path: Path | None, pairs: Sequence[str], neighbours: bool
) -> tuple[tuple[Roi, ...], tuple[tuple[str, str], ...]]:
    """Regions, and the pairs of them that are evaluated; none for nearest-neighbour CDP. Raises InputError."""
    from ...regions import load_regions, rois_of

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
