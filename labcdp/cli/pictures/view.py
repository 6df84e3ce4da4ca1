"""Command view: the luminance of an image on a page."""

from __future__ import annotations

from pathlib import Path

import typer

from ..options import ADDRESS_OPTION, PORT_OPTION
from ..terminal import JSON_OPTION
from .picture_options import PictureLightOptions
from .rois import rois
from .rois_options import PageOptions, RegionFiles


def view(
    context: typer.Context,
    light: PictureLightOptions,
    file: Path = typer.Argument(
        metavar="FILE",
        help="Luminance written by labcdp luminance (TIFF, OpenEXR, NPZ) or saved from Python (NetCDF), a picture or "
        "frame, a video or a recorded session.",
    ),
    frame: str | None = typer.Option(None, help="Frame of a video or session, for example 250; default: the first."),
    roi: Path | None = typer.Option(None, help="Region file to start from."),
    port: int = PORT_OPTION,
    address: str = ADDRESS_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """View luminance in false colours, on a page in the browser.

    The page shows the value with U under the cursor, profiles, isolines, statistics of regions and whether they are
    within limits; it exports PNG, TIFF, OpenEXR and CSV. It is the page of labcdp rois with the luminance first.

    Example: labcdp view target.exr
    """
    page = PageOptions(page=True, port=port, address=address, contrast=[])
    rois(context, RegionFiles(None, roi, False), light, page, file, frame, None, as_json)
