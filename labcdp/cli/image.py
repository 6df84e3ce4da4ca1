"""Command image: CDP, contrast and signal-to-noise ratios of pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import typer

from ..errors import InputError
from .batch import Failure, end_batch, worked_through
from .contrasts import CONTRAST_HELP, parse_contrasts
from .picture_options import BITS_OPTION, EXPOSURE_OPTION, FORMAT_OPTION, GAIN_OPTION, SIZE_OPTION, picture_options
from .terminal import JSON_OPTION, fraction_of_percent, print_json, print_table, progress_bars, say

if TYPE_CHECKING:
    from ..evaluate.image import ImageEvaluation, ImageRequest
    from ..evaluate.light import PictureConversion
    from ..report.image_folder import ResultFolder
    from ..report.image_page import ReportedPicture
    from ..sources.picture import PictureOptions
    from ..sources.stored_image import Encoding

#: Longer tables are left to the page and the spreadsheet.
_MOST_ROWS = 30
_ENCODINGS = ("linear", "srgb")


def image(
    files: list[Path] = typer.Argument(
        metavar="FILE...",
        help="Image files (PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dumps), or folders of them.",
    ),
    roi: Path | None = typer.Option(
        None, "--roi", help="File with the regions: JSON as labcdp rois saves it, or ImageJ's .roi or .zip."
    ),
    contrast: list[str] = typer.Option(["100%"], "--contrast", help=CONTRAST_HELP),
    epsilon: str = typer.Option("50%", help="Tolerance of the contrast."),
    pair: list[str] = typer.Option(
        [],
        "--pair",
        metavar="BRIGHT,DARK",
        help="Two regions by name, the brighter one first; may be repeated. Default: all pairs, of up to 6 regions.",
    ),
    neighbours: bool = typer.Option(
        False, "--neighbours", help="CDP of each pixel against its neighbours, for patterns that are one pixel wide."
    ),
    rectangle: str | None = typer.Option(
        None, "--rectangle", metavar="X0,Y0,X1,Y1", help="The same, inside a rectangle given by two corner pixels."
    ),
    calibration: Path | None = typer.Option(None, "--calibration", help="Calibration file, for cd/m^2."),
    camera: Path | None = typer.Option(
        None, "--camera", help="Camera specification (TOML), for cd/m^2 by guessed parameters."
    ),
    encoding: str | None = typer.Option(
        None, "--encoding", help="How values follow light: linear or srgb; default: what the kind of file suggests."
    ),
    exposure: str | None = EXPOSURE_OPTION,
    gain_db: float | None = GAIN_OPTION,
    bit_depth: int | None = BITS_OPTION,
    pixel_format: str | None = FORMAT_OPTION,
    size: str | None = SIZE_OPTION,
    surface: bool | None = typer.Option(
        None,
        "--surface/--no-surface",
        help="Also a page with the luminance as a surface, of 6 MB a picture.",
        show_default="for a single picture",
    ),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for the results.", show_default="PICTURE-cdp, or pictures-cdp"
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Tell how probable it is that a contrast is detected in pictures: CDP of two regions, with contrast, SNR and CSNR.

    Without calibration and camera specification, values are proportional to light, which contrasts do not mind.
    Writes a page, a spreadsheet with a column for each picture, and numbers as JSON.

    Example: labcdp image night-*.png --roi rois.json --contrast 10%:200%:10%
    """
    from ..evaluate.light import picture_conversion
    from ..report.image_folder import ResultFolder
    from ..report.image_results import image_values, summary_files

    if encoding is not None and encoding not in _ENCODINGS:
        raise InputError(f"--encoding is {encoding!r}: give {' or '.join(_ENCODINGS)}")
    request = _request(roi, contrast, epsilon, pair, neighbours, rectangle)
    conversion = picture_conversion(calibration, camera, cast("Encoding | None", encoding))
    options = picture_options(conversion.options, exposure, gain_db, bit_depth, pixel_format, size)
    paths = _paths(files)
    folder = output or Path("pictures-cdp" if len(paths) > 1 else f"{paths[0].stem or 'picture'}-cdp")
    work = _Work(request, conversion, options, roi, len(paths) == 1 if surface is None else surface)
    configuration = {
        "roi": None if roi is None else str(roi),
        "pairs": [list(one) for one in request.chosen_pairs],
        "neighbours": request.neighbours,
        "rectangle": request.rectangle,
        "calibration": None if calibration is None else str(calibration),
        "camera": None if camera is None else str(camera),
        "encoding": encoding,
        "exposure_s": options.exposure_s,
        "gain_db": options.gain_db,
        "bit_depth": options.bit_depth,
        "pixel_format": options.pixel_format,
        "size": options.size,
    }
    with ResultFolder(folder) as results:
        pictures = _evaluated(paths, work, results)
        if any(picture.evaluation is not None for picture in pictures):
            results.add(summary_files(pictures, request, conversion.description, configuration, results.names))
            results.finish()
    values = image_values(pictures, request, conversion.description, configuration)
    _tell(pictures, values, folder, as_json)
    failures = [Failure(one.file, one.failure) for one in pictures if one.evaluation is None]
    end_batch(failures, len(pictures), "pictures")


@dataclass(frozen=True)
class _Work:
    """What is done with each picture."""

    request: ImageRequest
    conversion: PictureConversion
    options: PictureOptions
    roi: Path | None
    surface: bool

    def __call__(self, path: Path) -> tuple[ImageEvaluation, dict[str, bytes]]:
        """Evaluate a picture and make its files."""
        from ..evaluate.image import evaluate_image
        from ..regions import load_regions
        from ..report.image_results import picture_files
        from ..sources.picture import read_picture

        picture = read_picture(path, self.options)
        height, width = picture.shape
        if self.roi is not None:
            # Says which region does not lie in this picture, or that the file was drawn on one of another size.
            load_regions(self.roi, (width, height))
        luminance = self.conversion.luminance(picture)
        evaluation = evaluate_image(
            picture, luminance, self.conversion.unit_of(picture), self.request, self.conversion.warnings(picture)
        )
        files = picture_files(
            evaluation, picture, luminance, self.conversion.description, self.request.epsilon, self.surface
        )
        return evaluation, files


def _evaluated(paths: Sequence[Path], work: _Work, results: ResultFolder) -> list[ReportedPicture]:
    """Work through the pictures and keep their files."""
    from ..report.image_page import ReportedPicture
    from ..report.image_results import picture_folder

    pictures = []
    with progress_bars() as bars:
        for number, (path, made) in enumerate(worked_through(paths, work), start=1):
            folder = picture_folder(number, path) if len(paths) > 1 else ""
            if isinstance(made, Failure):
                pictures.append(ReportedPicture(number, str(path), folder, None, made.reason))
            else:
                evaluation, files = made
                results.add({f"{folder}/{name}" if folder else name: data for name, data in files.items()})
                pictures.append(ReportedPicture(number, str(path), folder, evaluation))
            bars.update("Pictures", number, len(paths))
    return pictures


def _request(
    roi: Path | None,
    contrasts: Sequence[str],
    epsilon: str,
    pairs: Sequence[str],
    neighbours: bool,
    rectangle: str | None,
) -> ImageRequest:
    from ..evaluate.image import ImageRequest
    from ..regions import load_regions, rois_of

    if roi is None and not (neighbours or rectangle):
        raise InputError("there are no regions: give a file with --roi (labcdp rois draws one), or --neighbours")
    if roi is None and pairs:
        raise InputError("--pair names regions: give their file with --roi")
    rois = () if roi is None else rois_of(load_regions(roi))
    tolerance = fraction_of_percent(epsilon, "--epsilon")
    if not 0 < tolerance <= 1:
        raise InputError(f"--epsilon is {epsilon!r}: give a percentage above 0%, up to 100%")
    return ImageRequest(
        contrasts=parse_contrasts(contrasts),
        epsilon=tolerance,
        rois=rois,
        pairs=tuple(_pair(text, [one.name for one in rois]) for text in pairs) or None,
        neighbours=neighbours or rectangle is not None,
        rectangle=None if rectangle is None else _rectangle(rectangle),
    )


def _pair(text: str, names: Sequence[str]) -> tuple[str, str]:
    """Split at the comma between two regions; their names may hold commas too."""
    splits = [(text[:at].strip(), text[at + 1 :].strip()) for at, letter in enumerate(text) if letter == ","]
    for bright, dark in splits:
        if bright in names and dark in names:
            return bright, dark
    if not splits:
        raise InputError(f"--pair is {text!r}: give two regions with a comma between them, for example bright,dark")
    missing = next((name for name in splits[0] if name not in names), text)
    raise InputError(f"--pair is {text!r}, but there is no region {missing!r}: choose from {', '.join(names)}")


def _rectangle(text: str) -> tuple[int, int, int, int]:
    try:
        x0, y0, x1, y1 = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--rectangle is {text!r}: give two corner pixels x0,y0,x1,y1 as whole numbers, for example 100,50,299,149"
        ) from None
    return x0, y0, x1, y1


def _paths(files: Sequence[Path]) -> list[Path]:
    """Pictures to evaluate, each file once."""
    from ..sources.picture import picture_paths

    found: dict[Path, Path] = {}
    for path in picture_paths(files):
        first = found.setdefault(path.resolve(), path)
        if first is not path:
            say(f"Note: {path} is the same file as {first}, and evaluated once")
    return list(found.values())


def _tell(pictures: Sequence[ReportedPicture], values: dict[str, Any], folder: Path, as_json: bool) -> None:
    from ..report.image_page import shared_warnings
    from ..report.image_tables import neighbour_table, overview_table, pair_table, region_table

    good = [picture.evaluation for picture in pictures if picture.evaluation is not None]
    if as_json:
        print_json({"output": str(folder) if good else None, **values})
        return
    for warning in shared_warnings(good):
        say(f"Warning: {warning}")
    if len(pictures) == 1 and good:
        if good[0].regions:
            print_table("Regions", *region_table(good[0]))
        if good[0].pairs and len(pair_table(good[0]).rows) <= _MOST_ROWS:
            print_table("Contrast detection probability", *pair_table(good[0]))
        if good[0].neighbours is not None and len(good[0].neighbours.results) <= _MOST_ROWS:
            print_table("Contrast detection probability from pixel to pixel", *neighbour_table(good[0]))
    elif 0 < len(overview_table(good).rows) <= _MOST_ROWS:
        print_table("Contrast detection probability", *overview_table(good))
    if good:
        say(f"Report: {folder / 'report.html'}; also results.xlsx and results.json")
