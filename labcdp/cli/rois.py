"""Command rois: the page on which the regions of an image are drawn, and regions found without it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from ..errors import InputError
from .contrasts import CONTRAST_HELP, parse_contrasts
from .picture_options import BITS_OPTION, EXPOSURE_OPTION, FORMAT_OPTION, GAIN_OPTION, SIZE_OPTION, picture_options
from .terminal import JSON_OPTION, print_json, say

if TYPE_CHECKING:
    from ..evaluate.light import PictureConversion
    from ..regions import Shape
    from ..roi_page.files import DrawingFiles
    from ..roi_page.page_image import PageImage
    from ..roi_page.server import Address
    from ..sources.picture import PictureOptions


def rois(
    file: Path = typer.Argument(
        metavar="FILE",
        help="Image to draw on: PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dump; or a video, a folder of numbered "
        "images, a recorded session.",
    ),
    frame: str | None = typer.Option(
        None, help="Frame of a video to draw on, for example 250, 10s or 1:30; default: the first."
    ),
    output: Path | None = typer.Option(
        None,
        "--output",
        "-o",
        help="File of regions to write: .json, or for ImageJ .zip or .roi. Default: the file of --roi, else beside the "
        "image or video, for example picture.rois.json.",
    ),
    roi: Path | None = typer.Option(
        None, help="Regions to begin with: .json of labcdp, .roi or .zip of ImageJ. Default: what --output holds."
    ),
    calibration: Path | None = typer.Option(
        None, help="Calibration file, as labcdp calibrate saved it, for values in cd/m^2."
    ),
    camera: Path | None = typer.Option(
        None, help="Camera specification (TOML) for values in cd/m^2 where there is no calibration."
    ),
    encoding: Literal["linear", "srgb"] | None = typer.Option(
        None, help="How values follow light; default: what the kind of file suggests."
    ),
    exposure: str | None = EXPOSURE_OPTION,
    gain_db: float | None = GAIN_OPTION,
    bit_depth: int | None = BITS_OPTION,
    pixel_format: str | None = FORMAT_OPTION,
    size: str | None = SIZE_OPTION,
    contrast: list[str] = typer.Option(["100%"], "--contrast", help=CONTRAST_HELP),
    detect: Literal["checkerboard", "step-chart", "superpixels"] | None = typer.Option(
        None, help="Find regions and propose them; on the page a person confirms them."
    ),
    page: bool = typer.Option(True, "--page/--no-page", help="Without the page, --detect writes what it finds."),
    port: int = typer.Option(0, min=0, max=65535, help="Port of the page; default: any that is free."),
    address: str = typer.Option(
        "127.0.0.1", help="Address the page is served on. The default is reached from this computer, or through ssh."
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Draw regions of an image or of a video's frame by mouse, on a page in the browser.

    The page shows DN and cd/m^2 under the pointer, the mean of each region, and the CDP of two regions. labcdp prints
    the address of the page, and what to type where the browser runs on another computer. Ctrl-C ends it. What is not
    saved then is kept beside the output, and the same command goes on with it.
    """
    from ..evaluate.light import picture_conversion
    from ..roi_page.files import DrawingFiles
    from ..roi_page.lock import locked

    contrasts = parse_contrasts(contrast)
    if not page and detect is None:
        raise InputError("--no-page writes what --detect finds: give --detect too, or leave --no-page out")
    _require_of_kind(file, frame, pixel_format or size)
    target = _output(file, output, roi)
    conversion = picture_conversion(calibration, camera, encoding)
    options = picture_options(conversion.options, exposure, gain_db, bit_depth, pixel_format, size)
    image = _image(file, frame, conversion, options)
    files = DrawingFiles(target, image.size)
    found = () if detect is None else _found(image, detect)
    with locked(target) as tell_others:
        start = _start(files, roi)
        if not page:
            _write(files, start, found, as_json)
            return
        _serve(image, files, start, found, contrasts, _Place(address, port, tell_others), as_json)


@dataclass(frozen=True)
class _Place:
    """Where the page is served, and what tells other processes of it."""

    address: str
    port: int
    tell_others: Callable[[str], None]


@dataclass(frozen=True)
class _Files:
    """What there is to begin with: in the output, in another file, and drawn before but not saved."""

    #: Fingerprint of the output.
    stored: str
    saved: tuple[Shape, ...]
    read: tuple[Shape, ...]
    kept: tuple[Shape, ...]


def _output(file: Path, output: Path | None, roi: Path | None) -> Path:
    name = file.name if file.is_dir() else file.stem
    target = output or roi or file.parent / f"{name or 'video'}.rois.json"
    if target.parent.is_dir() and not os.access(target.parent, os.W_OK):
        raise InputError(f"{target.parent} may not be written to: give --output in another folder")
    return target


def _require_of_kind(file: Path, frame: str | None, of_dumps: str | None) -> None:
    """Refuse options of videos for pictures, and of raw dumps for videos."""
    from ..roi_page.video_image import is_video

    if is_video(file):
        if of_dumps is not None:
            raise InputError("--size and --pixel-format are for raw dumps: leave them out for a video")
    elif frame is not None:
        raise InputError(f"--frame chooses a frame of a video, and {file} is none: leave it out")


def _image(file: Path, frame: str | None, conversion: PictureConversion, options: PictureOptions) -> PageImage:
    from ..roi_page.page_image import PageImage
    from ..roi_page.video_image import is_video, video_image
    from ..sources.picture import read_picture
    from ..sources.video_selection import Position

    if is_video(file):
        return video_image(file, Position.parse(frame or "0", "--frame"), conversion, options)
    return PageImage.of(read_picture(file, options), conversion)


def _found(image: PageImage, detect: Literal["checkerboard", "step-chart", "superpixels"]) -> tuple[Shape, ...]:
    from ..roi_page.proposals import propose

    return propose(image, detect)


def _start(files: DrawingFiles, roi: Path | None) -> _Files:
    from ..regions import load_regions

    # Before it is read: what changes it in between is then noticed.
    stored = files.fingerprint(files.output)
    saved = load_regions(files.output, files.size) if files.output.exists() else ()
    read = () if roi is None or roi == files.output else load_regions(roi, files.size)
    return _Files(stored, saved, read, files.kept())


def _write(files: DrawingFiles, start: _Files, found: tuple[Shape, ...], as_json: bool) -> None:
    from ..regions import new_shapes
    from ..roi_page.drawing import Drawing

    before = start.read or start.saved
    drawing = Drawing.of(files.size, before)
    new = new_shapes(found, drawing.shapes)
    if new:
        drawing = drawing.proposed(new).accepted()
    changed = drawing.shapes != start.saved
    if changed:
        if files.fingerprint(files.output) != start.stored:
            raise InputError(f"{files.output} was changed by somebody else meanwhile: give the command again")
        files.save(files.output, drawing.shapes)
    names = [shape.name for shape in drawing.shapes[len(before) :]]
    n_known = len(found) - len(new)
    if as_json:
        regions = [one.name for one in drawing.rois]
        written = str(files.output) if changed else None
        print_json({"written": written, "found": names, "known": n_known, "regions": regions})
        return
    known = f"; {n_known} more were found that are there already" if new and n_known else ""
    if changed:
        say(f"Written: {files.output} with {_count(len(drawing.shapes))}, {len(names)} of them new{known}")
    else:
        say(f"Nothing written: {_count(n_known)} found, none of them new, {files.output} has them already")
    say(f"Nobody has confirmed them: look at them with labcdp rois FILE --roi {files.output}")


def _serve(
    image: PageImage,
    files: DrawingFiles,
    start: _Files,
    found: tuple[Shape, ...],
    contrasts: tuple[float, ...],
    place: _Place,
    as_json: bool,
) -> None:
    from ..roi_page.drawing import Drawing, History
    from ..roi_page.measurements import Measurements
    from ..roi_page.server import Server
    from ..roi_page.workspace import Start

    history = History(Drawing.of(files.size, start.read or start.saved))
    if start.kept:
        history = history.changed(Drawing.of(files.size, start.kept))
    begin = Start(history, start.saved, start.read, found, start.stored)
    server = Server(Measurements(image, contrasts), files, begin, place.address, place.port)
    shown: list[Address] = []

    def ready(where: Address) -> None:
        shown.append(where)
        place.tell_others(where.place)
        _tell(image, files, start, where)

    server.run(ready)
    lines = server.workspace.last_words()
    if as_json:
        print_json(_result(server.workspace, files, shown))
    else:
        for line in lines:
            say(line)


def _result(workspace: Any, files: DrawingFiles, shown: list[Address]) -> dict[str, Any]:
    kept = files.unsaved.exists() and workspace.unsaved
    return {
        "page": shown[0].url if shown else None,
        "saved": [str(path) for path in dict.fromkeys(workspace.written)],
        "unsaved": workspace.unsaved,
        "kept_in": str(files.unsaved) if kept else None,
        "regions": [one.name for one in workspace.drawing.rois],
    }


def _tell(image: PageImage, files: DrawingFiles, start: _Files, where: Address) -> None:
    width, height = image.size
    say(f"{image.name}: {width} x {height} pixels")
    for warning in image.warnings:
        say(f"Warning: {warning}")
    if start.kept:
        n = _count(len(start.kept))
        say(f"The page goes on with {n} drawn before and not saved; Undo leads back to the file")
    elif start.read and start.saved:
        say(f"Warning: {files.output} is there and is replaced when you save")
    say(f"Save writes {files.output}; until then the drawing is kept in {files.unsaved}")
    say(f"Open: {where.url}")
    if where.loopback:
        say(f"From another computer, first there: {where.tunnel}")
    else:
        say("Warning: the page can be reached over the network, and is not encrypted: whoever reads along gets in")
    say("Ctrl-C ends the page")


def _count(n: int) -> str:
    return f"{n} region{'' if n == 1 else 's'}"
