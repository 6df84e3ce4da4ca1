"""Command rois: draw regions of an image on a page, or find them without it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import typer

from ...core.errors import InputError
from ...core.result import Finding, Result, info
from ...core.table import Column, Table
from ...evaluate.picture.conversion import PictureConversion
from ...files.read import read_picture
from ...files.video.selection import Position
from ...output.file_list import is_same_file
from ...regions import Shape, load_regions, new_shapes
from ...report.text import finding_text
from ...web.lock import locked
from ...web.maps.files import dataset_image
from ...web.maps.tab import map_page
from ...web.regions.drawing import Drawing
from ...web.regions.files import DrawingFiles, Start
from ...web.regions.measurements import Measurements
from ...web.regions.page_image import PageImage
from ...web.regions.proposals import propose
from ...web.regions.video_image import is_video, video_image
from ...web.regions.workspace import Workspace
from ...web.server import Address, Server, Site
from ..options import ADDRESS_OPTION, CONTRAST_HELP, MEASURED, PORT_OPTION, contrasts_or_measured
from ..output import FORCE_OPTION, output_file
from ..terminal import JSON_OPTION, print_result, say, say_where
from .picture_options import PictureLightOptions


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


def rois(
    context: typer.Context,
    regions: RegionFiles,
    light: PictureLightOptions,
    shown: PageOptions,
    file: Path = typer.Argument(
        metavar="FILE",
        help="Image to draw on: PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dump; or a video, a folder of numbered "
        "images, a recorded session.",
    ),
    frame: str | None = typer.Option(
        None, help="Frame of a video to draw on, for example 250, 10s or 1:30; default: the first."
    ),
    detect: Literal["checkerboard", "step-chart", "superpixels"] | None = typer.Option(
        None, help="Find regions and propose them for confirmation on the page."
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Draw regions in an image or video frame, on a page in the browser.

    The page shows DN and cd/m² under the pointer, the mean of each region, and the CDP of two regions. labcdp prints
    the address of the page, also for a browser on another computer. Ctrl-C ends the command. Regions that are not
    saved are kept next to the output, and the same command resumes with them.
    """
    contrasts = contrasts_or_measured(shown.contrast)
    if not shown.page and detect is None:
        raise InputError("--no-page writes what --detect finds: give --detect too, or leave --no-page out")
    _require_of_kind(file, frame, light.pixel_format or light.size)
    target = regions.target(context, file, shown.page)
    image = _image(file, frame, light.conversion())
    files = DrawingFiles(target, image.size)
    found = () if detect is None else _found(image, detect)
    with locked(target) as tell_others:
        read = () if regions.roi in (None, target) else load_regions(regions.roi, files.size)
        start = Start.of(files, read, found)
        if not shown.page:
            _write(files, start, as_json)
            return
        place = _Place(shown.address, shown.port, tell_others, context.info_name == "view")
        _serve(image, files, start, contrasts, place, as_json)


@dataclass(frozen=True)
class _Place:
    """Address of the page, what announces it to other processes, and whether the luminance is shown first."""

    address: str
    port: int
    tell_others: Callable[[str], None]
    map_first: bool


def _require_of_kind(file: Path, frame: str | None, of_dumps: str | None) -> None:
    """Refuse options of videos for pictures, and of raw dumps for videos."""
    if is_video(file):
        if of_dumps is not None:
            raise InputError("--size and --pixel-format are for raw dumps: leave them out for a video")
    elif frame is not None:
        raise InputError(f"--frame chooses a frame of a video, and {file} is none: leave it out")


def _image(file: Path, frame: str | None, conversion: PictureConversion) -> PageImage:
    if file.suffix.lower() == ".nc":
        return dataset_image(file)
    if is_video(file):
        return video_image(file, Position.parse(frame or "0", "--frame"), conversion)
    return PageImage.of(read_picture(file, conversion.options), conversion)


def _found(image: PageImage, detect: Literal["checkerboard", "step-chart", "superpixels"]) -> tuple[Shape, ...]:
    return propose(image, detect)


def _write(files: DrawingFiles, start: Start, as_json: bool) -> None:
    before, found = start.read or start.saved, start.proposals
    drawing = Drawing.of(files.size, before)
    new = new_shapes(found, drawing.shapes)
    if new:
        drawing = drawing.proposed(new).accepted()
    changed = drawing.shapes != start.saved
    if changed:
        if files.fingerprint(files.output) != start.stored:
            raise InputError(f"{files.output} was changed by another program: repeat the command")
        files.save(files.output, drawing.shapes)
    names = [shape.name for shape in drawing.shapes[len(before) :]]
    n_known = len(found) - len(new)
    findings = [info("regions-not-confirmed", regions=len(names))] if names else []
    findings += [info("regions-known", regions=n_known)] if n_known else []
    if as_json:
        state = "written" if changed else "unchanged"
        print_result(_result(files, drawing, names, {str(files.output): state}, findings=findings), as_json)
        return
    known = f"; {n_known} more were found that are there already" if new and n_known else ""
    if changed:
        say(f"Written: {files.output} with {_count(len(drawing.shapes))}, {len(names)} of them new{known}")
    else:
        say(f"Nothing written: {_count(n_known)} found, all already in {files.output}")
    say(f"Regions found by --detect are not confirmed: check them with labcdp rois FILE --roi {files.output}")


def _serve(
    image: PageImage,
    files: DrawingFiles,
    start: Start,
    contrasts: tuple[float, ...] | None,
    place: _Place,
    as_json: bool,
) -> None:
    server = Server(place.address, place.port)
    workspace = Workspace(Measurements(image, contrasts), files, start, server.elsewhere)
    title = f"{image.name} - labcdp regions"

    def tab(document: Any) -> Any:
        return map_page(workspace, document, map_first=place.map_first)

    site = Site(title, tab, workspace.begin, workspace.warn)
    shown: list[Address] = []

    def ready(where: Address) -> None:
        shown.append(where)
        place.tell_others(where.place)
        _tell(image, files, start, where)

    server.run(site, ready)
    if not as_json:
        for line in workspace.last_words():
            say(line)
        return
    states = {str(path): "written" for path in workspace.written}
    if workspace.unsaved and files.unsaved.exists():
        states[str(files.unsaved)] = "unsaved"
    url = shown[0].url if shown else None
    print_result(_result(files, workspace.drawing, [], states, url), as_json)


def _result(
    files: DrawingFiles,
    drawing: Drawing,
    new: Sequence[str],
    states: Mapping[str, str],
    page: str | None = None,
    findings: Sequence[Finding] = (),
) -> Result:
    """Return the regions, whether each was found now, and their files."""
    regions = (
        Column("region", "region"),
        Column("area_px", "area", "px", "Area of its outline."),
        Column("new", "found now", "", "Whether --detect found it now; it is not confirmed."),
    )
    rows = [{"region": one.name, "area_px": one.area, "new": one.name in new} for one in drawing.rois]
    paths = (Column("path", "file"), Column("state", "state", "", "Whether it was written."))
    return Result(
        "rois",
        files.output.name,
        (
            Table.of_rows("regions", "Regions", regions, rows),
            Table("files", "Files", paths, {"path": list(states), "state": list(states.values())}),
        ),
        findings=tuple(findings),
        configuration={"output": str(files.output), "page": page},
    )


def _tell(image: PageImage, files: DrawingFiles, start: Start, where: Address) -> None:
    width, height = image.size
    say(f"{image.name}: {width} x {height} pixels")
    for finding in image.findings:
        say(f"{finding.severity}: {finding_text(finding)}")
    if start.kept:
        n = _count(len(start.kept))
        say(f"Resuming with {n} drawn earlier and not saved; Undo returns to the saved file")
    elif start.read and start.saved:
        say(f"warning: {files.output} exists; Save replaces it")
    say(f"Save writes {files.output}; until then the drawing is kept in {files.unsaved}")
    say_where(where)


def _count(n: int) -> str:
    return f"{n} region{'' if n == 1 else 's'}"


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
