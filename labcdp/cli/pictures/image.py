"""Command `labcdp image`: CDP, contrast and signal-to-noise ratios of regions in pictures."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from ...core.computer import Processes, attempted, usable_cores
from ...core.disk.files import shown
from ...core.errors import InputError, LabcdpError
from ...core.result import InputFile, Result
from ...evaluate.judgement import verdicts_of
from ...evaluate.picture.image import MeasuredPicture
from ...evaluate.picture.result import evaluate_picture, image_result, picture_folder, summary_files
from ...evaluate.picture.settings import ImageSettings
from ...files.kinds import no_picture
from ...files.read import picture_paths
from ...output import ResultsFolder
from ..commands import As
from ..options import Results, end_by_requirement, require_together
from ..terminal import print_result, progress_bars, say
from .options import (
    ChartOptions,
    PictureLightOptions,
    each_once,
    parse_pairs,
    read_chart,
    read_regions,
    require_kind,
)

#: Pictures that are named of those that fail for one reason.
_MOST_NAMED = 8
_LOGGER = logging.getLogger(__name__)


def _rectangle(text: str, name: str) -> tuple[int, int, int, int]:
    try:
        x0, y0, x1, y1 = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"{name} is {shown(text)}: give two corner pixels x0,y0,x1,y1 as whole numbers, for example 100,50,299,149"
        ) from None
    return x0, y0, x1, y1


@dataclass(frozen=True)
class ImageOptions(Results, PictureLightOptions, ChartOptions):
    """Options of the command.

    Parameters
    ----------
    rectangle : X0,Y0,X1,Y1
        Compute the nearest-neighbour CDP inside a rectangle, given by two corner pixels.
    dark_surroundings
        Picture of the chart from the same place, with the same settings and dark surroundings: the veiling glare by
        bright ones follows from both, and the dynamic range without it.
    colours
        Also tell how well the colours of the regions of each pair can be told apart: distance, colour separation
        probability (CSP), and the share of pairs of pixels that keep the difference of colour.
    pages
        Write a page with figures for each picture, or only the tables.
    surface
        Also write a page with the luminance as an interactive surface, 6 MB per picture.
    """

    rectangle: Annotated[tuple[int, int, int, int] | None, As(parse=_rectangle)] = None
    dark_surroundings: Path | None = None
    colours: bool = False
    pages: bool = True
    surface: bool = False


def image(options: ImageOptions, files: tuple[Path, ...]) -> None:
    """Compute contrast detection probability (CDP), contrast, SNR and CSNR of regions in pictures.

    Without --contrast, the CDP of the measured contrast of each pair is computed. Without calibration and camera
    specification, luminance is relative, and contrasts of regions at different places include the lens's vignetting.
    Writes a page, a spreadsheet and JSON.

    Example: labcdp image night-*.png --roi rois.json --contrast 10%:200%:20

    Parameters
    ----------
    files : FILE...
        Image files (PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dumps), or folders of them.
    """
    if options.surface and not options.pages:
        raise InputError("--surface is a page: leave it out, or --no-pages")
    require_kind(files, no_picture)
    settings, paths = _settings(options), each_once(picture_paths(files))
    with options.folder(files[0] if len(files) == 1 else "pictures") as folder:
        pictures, result = _evaluated(paths, settings, folder, pages=options.pages, surface=options.surface)
        failed = [picture for picture in pictures if picture.source is None]
        good = len(failed) < len(pictures)
        if good:
            folder.add(summary_files(pictures, result, settings.converter.description))
    if good:
        # Failures are reported last.
        shown = tuple(finding for finding in result.findings if options.as_json or finding.severity != "error")
        page = "report.html" if options.pages or len(paths) > 1 else "results.xlsx"
        options.show(replace(result, findings=shown), folder, page)
    elif options.as_json:
        print_result(result)
    if failed:
        # Most messages already name the file.
        several = [f"{len(failed)} of {len(pictures)} pictures failed:", *(f"  {line}" for line in _failures(failed))]
        say("labcdp: " + "\n".join(several if len(pictures) > 1 else _failures(failed)))
        raise typer.Exit(1)
    end_by_requirement(verdicts_of(result))


def _failures(failed: Sequence[MeasuredPicture]) -> list[str]:
    """Say why pictures have no result; those that fail for one reason share a line."""
    reasons: dict[str, list[MeasuredPicture]] = {}
    for picture in failed:
        reasons.setdefault(picture.failure.replace(picture.file, ""), []).append(picture)
    lines = []
    for first, *others in reasons.values():
        # Most messages already name the file.
        line = first.failure if first.file in first.failure else f"{first.file}: {first.failure}"
        named = ", ".join(picture.file for picture in others[:_MOST_NAMED])
        more = f", and {len(others) - _MOST_NAMED} more" if len(others) > _MOST_NAMED else ""
        lines.append(f"{line} (and {len(others)} more alike: {named}{more})" if others else line)
    return lines


def _settings(options: ImageOptions) -> ImageSettings:
    if options.rectangle is not None:
        options = replace(options, neighbours=True)
    of_chart = {"--corners": options.corners, "--dark-surroundings": options.dark_surroundings}
    require_together(of_chart, {"--chart": options.chart})
    chart = None
    if options.chart is None:
        rois, image_size, files = read_regions(options)
    else:
        chart, rois, image_size, files = read_chart(options)
    names = [roi.name for roi in rois] if chart is None else chart.names
    given = {"dark surroundings": options.dark_surroundings, "requirement": options.require}
    files += [InputFile.of(role, path) for role, path in given.items() if path is not None]
    return ImageSettings(
        **options.targets(),
        rois=rois,
        pairs=parse_pairs(options, names) or None,
        neighbours=options.neighbours,
        rectangle=options.rectangle,
        chart=chart,
        dark_surroundings=options.dark_surroundings,
        colours=options.colours,
        converter=options.converter(),
        image_size=image_size,
        inputs=(*files, *options.inputs()),
    )


def _evaluated(
    paths: Sequence[Path], settings: ImageSettings, results: ResultsFolder, *, pages: bool, surface: bool
) -> tuple[list[MeasuredPicture], Result]:
    """Process the pictures, on all cores if there are enough of them, and write their files.

    What is done with a result is outside: a full disk ends the command, and is no failure of the picture.
    """
    work = partial(evaluate_picture, settings, pages=pages, surface=surface)
    # A process takes about as long to start as two pictures.
    n_processes = min(usable_cores(), len(paths) // 2)
    alone = ((path, *attempted(work, path)) for path in paths)
    outcomes = alone if n_processes < 2 else Processes[Path](n_processes).run(work, paths)
    numbers = {path: number for number, path in enumerate(paths, start=1)}
    pictures: dict[int, MeasuredPicture] = {}
    result: Result | None = None
    with progress_bars() as bars:
        for path, made, error in outcomes:
            number = numbers[path]
            folder = picture_folder(number, path) if len(paths) > 1 and pages else ""
            picture, result, files = made or (MeasuredPicture(str(path), None), None, {})
            if error is not None:
                picture = replace(picture, failure=_failure(error, path))
            results.add({f"{folder}/{name}" if folder else name: data for name, data in files.items()})
            pictures[number] = replace(picture, number=number, folder=folder)
            bars.set("Pictures", len(pictures), len(paths))
    in_order = [pictures[number] for number in sorted(pictures)]
    # The result of a single picture is that of its page.
    return in_order, result if result is not None and len(paths) == 1 else image_result(in_order, settings)


def _failure(error: BaseException, path: Path) -> str:
    """Say in a line why a picture has no result; an unexpected error is given with its type."""
    text = " ".join(str(error).split())
    if isinstance(error, LabcdpError):
        return text
    if isinstance(error, ImportError):
        raise error
    if isinstance(error, OSError):
        return f"it cannot be read ({text}): check the file and its permissions"
    if isinstance(error, MemoryError):
        return "not enough memory: use fewer pixels"
    # An error of a library in one of thousands of files does not lose the results of the others.
    _LOGGER.debug("%s failed", path, exc_info=error)
    what = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return f"unexpected error ({what}): please report it with this file"
