"""Command rois: draw regions of an image on a page, or find them without it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from ...core.disk.files import plain_name
from ...core.errors import InputError
from ...core.result import Finding, Result, info
from ...core.table import Column, Table
from ...evaluate.picture.converter import Converter
from ...files.read import read_picture
from ...files.video.selection import Position
from ...output.folder import is_same_file
from ...regions import load_regions, new_shapes
from ...report.text import finding_text
from ...web.regions.drawing import Drawing
from ...web.regions.files import DrawingFiles, Start, locked
from ...web.regions.map_data import dataset_image
from ...web.regions.map_tab import map_page
from ...web.regions.measurements import Measurements
from ...web.regions.page_image import PageImage, is_video, video_image
from ...web.regions.shapes import propose
from ...web.regions.workspace import Workspace
from ...web.server import Address, Server, Site
from ..commands import COMMAND, As
from ..options import Contrasts, Force, PageOptions, output_file
from ..terminal import print_result, say
from .frames import FramePosition
from .options import PictureLightOptions


@dataclass(frozen=True)
class RegionPage(PageOptions):
    """Options of the page.

    Parameters
    ----------
    page
        Show the page; without it, write the regions that --detect finds.
    """

    page: bool = True
    contrast: Contrasts = None


@dataclass(frozen=True)
class RegionFiles:
    """Options for the region files.

    Parameters
    ----------
    output
        Region file to write: .json, or for ImageJ .zip or .roi. Default: the JSON file of --roi, else next to the image
        or video, for example picture.rois.json.
    roi
        Region file to start from: .json of labcdp, .roi or .zip of ImageJ. Default: the file of --output.
    """

    output: Annotated[Path | None, As(names=("--output", "-o"))] = None
    roi: Path | None = None
    force: Force = False

    def target(self, file: Path, page: bool) -> Path:
        """Return the file that is written, checked before any work; raises InputError."""
        roi = self.roi if page else None
        name = file.name if file.is_dir() else file.stem
        edited = roi if roi is not None and roi.suffix == ".json" else None
        target = self.output or edited or file.parent / f"{plain_name(name) or 'video'}.rois.json"
        if target.parent.is_dir() and not os.access(target.parent, os.W_OK):
            raise InputError(f"{target.parent} is not writable: choose --output in another folder")
        # A region file of labcdp is edited in place; other programs' files are never.
        is_edited = target.suffix == ".json" and (self.roi is None or (roi is not None and is_same_file(roi, target)))
        if not (target.exists() and is_edited) or is_same_file(file, target):
            output_file(target, self.force)
        return target


def rois(
    regions: RegionFiles,
    light: PictureLightOptions,
    shown: RegionPage,
    file: Path,
    *,
    frame: FramePosition | None = None,
    detect: Literal["checkerboard", "step-chart", "superpixels"] | None = None,
) -> None:
    """Draw regions in an image or video frame, on a page in the browser.

    The page shows DN and cd/m² under the pointer, the mean of each region, and the CDP of two regions. labcdp prints
    the address of the page, also for a browser on another computer. Ctrl-C ends the command. Unsaved regions are kept
    next to the output, and the same command resumes with them.

    Parameters
    ----------
    file : FILE
        Image to draw on: PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dump; or a video, a folder of numbered images,
        a recorded session.
    frame
        Frame of a video to draw on, for example 250, 10s or 1:30; default: the first.
    detect
        Find regions and propose them for confirmation on the page.
    """
    if not shown.page and detect is None:
        raise InputError("--no-page writes what --detect finds: add --detect, or leave out --no-page")
    if is_video(file) and (light.pixel_format is not None or light.size is not None):
        raise InputError("--size and --pixel-format are for raw dumps: leave them out for a video")
    if frame is not None and not is_video(file):
        raise InputError(f"--frame selects a frame of a video, but {file} is not one: leave it out")
    target = regions.target(file, shown.page)
    image = _image(file, frame, light.converter())
    files = DrawingFiles(target, image.size)
    detected = () if detect is None else propose(image, detect)
    with locked(target) as tell_others, ExitStack() as end:
        read = () if regions.roi in (None, target) else load_regions(regions.roi, files.size)
        start = Start.of(files, read, detected)
        if not shown.page:
            _write(files, start)
            return
        server = Server(shown.address, shown.port)
        workspace = Workspace(Measurements(image, shown.contrast), files, start, server.elsewhere)

        is_map = COMMAND.get() == "view"

        def tab(document: Any) -> Any:
            return map_page(workspace, document, map_first=is_map)

        def ready(where: Address) -> None:
            tell_others(where.url_without_token)
            _tell(image, files, start)
            shown.served(end, where)

        server.run(
            Site(
                f"{'Luminance' if is_map else 'Regions'}: {image.name} - labcdp", tab, workspace.begin, workspace.warn
            ),
            ready,
        )
    states = {str(path): "written" for path in workspace.written}
    if workspace.unsaved and files.unsaved.exists():
        states[str(files.unsaved)] = "unsaved"
    result = _result(files, workspace.drawing, [], states, server.address.url)
    print_result(result, *workspace.last_words())


def _image(file: Path, frame: Position | None, converter: Converter) -> PageImage:
    if file.suffix.lower() == ".nc":
        return dataset_image(file)
    if is_video(file):
        return video_image(file, frame or Position(0), converter)
    return PageImage.of(read_picture(file, converter.options), converter)


def _write(files: DrawingFiles, start: Start) -> None:
    before, detected = start.read or start.saved, start.proposals
    drawing = Drawing.of(files.size, before)
    new = new_shapes(detected, drawing.shapes)
    if new:
        drawing = drawing.proposed(new).accepted()
    changed = drawing.shapes != start.saved
    if changed:
        if files.fingerprint(files.output) != start.stored:
            raise InputError(f"{files.output} was changed by another program: repeat the command")
        files.save(files.output, drawing.shapes)
    names = [shape.name for shape in drawing.shapes[len(before) :]]
    n_known = len(detected) - len(new)
    findings = [info("regions-not-confirmed", regions=len(names))] if names else []
    findings += [info("regions-known", regions=n_known)] if n_known else []
    state = "written" if changed else "unchanged"
    following = f"Nothing written: {_count(n_known)} found, all already in {files.output}"
    if changed:
        following = f"Written: {files.output} with {_count(len(drawing.shapes))}, {len(names)} of them new"
    result = _result(files, drawing, names, {str(files.output): state}, findings=findings)
    print_result(result, following)


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
        Column("region", "region", value="name"),
        Column("area_px", "area", "px", "Area of its outline.", value="area"),
        Column("new", "found now", "", "Whether --detect found it this time; not yet confirmed.",
               value=lambda roi: roi.name in new),
    )  # fmt: skip
    paths = (
        Column("path", "file", value="0"),
        Column("state", "state", "", "Whether it was written.", value="1"),
    )
    tables = (
        Table.of_items("regions", "Regions", regions, drawing.rois, detail=True),
        Table.of_items("files", "Files", paths, states.items(), detail=True),
    )
    configuration = {"output": str(files.output), "page": page}
    return Result("rois", files.output.name, tables, findings=tuple(findings), configuration=configuration)


def _tell(image: PageImage, files: DrawingFiles, start: Start) -> None:
    width, height = image.size
    say(f"{image.name}: {width} x {height} pixels")
    for finding in image.findings:
        say(f"{finding.severity}: {finding_text(finding)}")
    if start.kept:
        n = _count(len(start.kept))
        say(f"Resuming with {n} unsaved from earlier; Undo returns to the saved file")
    elif start.read and start.saved:
        say(f"warning: {files.output} exists; Save replaces it")
    say(f"Save writes {files.output}; until then the drawing is kept in {files.unsaved}")


def _count(n: int) -> str:
    return f"{n} region{'' if n == 1 else 's'}"


def view(
    light: PictureLightOptions,
    page: PageOptions,
    file: Path,
    *,
    frame: FramePosition | None = None,
    roi: Path | None = None,
) -> None:
    """View luminance in false colours, on a page in the browser.

    The page shows the value with U under the cursor, profiles, isolines, statistics of regions and whether they are
    within limits; it exports PNG, TIFF, OpenEXR and CSV. It is the page of labcdp rois with the luminance first.

    Example: labcdp view target.exr

    Parameters
    ----------
    file : FILE
        Luminance written by labcdp luminance (TIFF, OpenEXR, NPZ) or saved from Python (NetCDF), a picture or frame, a
        video or a recorded session.
    frame
        Frame of a video or session, for example 250; default: the first.
    roi
        Region file to start from.
    """
    shown = RegionPage(**vars(page))
    rois(RegionFiles(roi=roi), light, shown, file, frame=frame)
