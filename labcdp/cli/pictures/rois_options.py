"""Options of the command rois: its page and its region files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import typer

from ...core.errors import InputError
from ...output.file import is_same_file
from ..options import ADDRESS_OPTION, CONTRAST_HELP, MEASURED, PORT_OPTION
from ..output import FORCE_OPTION, output_file


@dataclass(frozen=True)
class PageOptions:
    """Options of the page."""

    page: bool = typer.Option(
        True, "--page/--no-page", help="Show the page; without it, write the regions that --detect finds."
    )
    port: int = PORT_OPTION
    address: str = ADDRESS_OPTION
    contrast: list[str] = typer.Option([], "--contrast", help=CONTRAST_HELP, show_default=MEASURED)


@dataclass(frozen=True)
class RegionFiles:
    """Options for the region files."""

    output: Path | None = typer.Option(
        None,
        "--output",
        "-o",
        help="Region file to write: .json, or for ImageJ .zip or .roi. Default: the JSON file of --roi, else next "
        "to the image or video, for example picture.rois.json.",
    )
    roi: Path | None = typer.Option(
        None, help="Region file to start from: .json of labcdp, .roi or .zip of ImageJ. Default: the file of --output."
    )
    force: bool = FORCE_OPTION

    def target(self, context: typer.Context, file: Path, page: bool) -> Path:
        """Return the file that is written, checked before any work; raises InputError."""
        roi = self.roi if page else None
        target = _output(file, self.output, roi)
        # A region file of labcdp is edited in place; other programs' files are never.
        is_edited = target.suffix == ".json" and (self.roi is None or (roi is not None and is_same_file(roi, target)))
        if not (target.exists() and is_edited) or is_same_file(file, target):
            output_file(context, target, self.force)
        return target


def _output(file: Path, output: Path | None, roi: Path | None) -> Path:
    name = file.name if file.is_dir() else file.stem
    edited = roi if roi is not None and roi.suffix == ".json" else None
    target = output or edited or file.parent / f"{name or 'video'}.rois.json"
    if target.parent.is_dir() and not os.access(target.parent, os.W_OK):
        raise InputError(f"{target.parent} may not be written to: give --output in another folder")
    return target
