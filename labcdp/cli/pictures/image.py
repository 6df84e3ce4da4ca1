"""Command image: CDP, contrast and signal-to-noise ratios of pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import typer

from ...core.disk import real_path
from ...core.errors import InputError
from ..options import (
    CAMERA_SPEC_OPTION,
    CONTRAST_HELP,
    MEASURED,
    PAIR_METAVAR,
    contrasts_or_measured,
    parse_pair,
    parse_tolerance,
)
from ..output import FORCE_OPTION, OPEN_OPTION, output_option, results_folder, show_page
from ..terminal import JSON_OPTION, print_result, progress_bars, say
from .batch import Failure, end_batch, worked_through
from .picture_options import (
    BITS_OPTION,
    EXPOSURE_OPTION,
    FORMAT_OPTION,
    GAIN_OPTION,
    SIZE_OPTION,
    input_files,
    picture_options,
)

if TYPE_CHECKING:
    from ...core.result import InputFile
    from ...evaluate.picture.image import ImageEvaluation
    from ...evaluate.picture.light.picture import PictureConversion
    from ...evaluate.picture.request import ImageRequest
    from ...evaluate.picture.tables import ReportedPicture
    from ...files.formats.colour import Encoding
    from ...files.picture.read import PictureOptions
    from ...output import ResultsFolder

_ENCODINGS = ("linear", "srgb")


def image(
    context: typer.Context,
    files: list[Path] = typer.Argument(
        metavar="FILE...",
        help="Image files (PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dumps), or folders of them.",
    ),
    roi: Path | None = typer.Option(
        None, "--roi", help="Region file: .json of labcdp rois, or .roi or .zip of ImageJ."
    ),
    contrast: list[str] = typer.Option([], "--contrast", help=CONTRAST_HELP, show_default=MEASURED),
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast."),
    pair: list[str] = typer.Option(
        [],
        "--pair",
        metavar=PAIR_METAVAR,
        help="Names of two regions, the brighter one first; may be repeated. Default: all pairs of up to 6 regions.",
    ),
    neighbours: bool = typer.Option(
        False,
        "--neighbours",
        help="Compute the nearest-neighbour CDP: each pixel and its neighbours, for patterns 1 pixel wide.",
    ),
    rectangle: str | None = typer.Option(
        None,
        "--rectangle",
        metavar="X0,Y0,X1,Y1",
        help="Compute the nearest-neighbour CDP inside a rectangle, given by two corner pixels.",
    ),
    calibration: Path | None = typer.Option(None, "--calibration", help="Calibration file, for values in cd/m²."),
    camera_spec: Path | None = CAMERA_SPEC_OPTION,
    encoding: str | None = typer.Option(
        None,
        "--encoding",
        help="Encoding of the pixel values, linear or srgb; default: usual encoding of the file type.",
    ),
    exposure: str | None = EXPOSURE_OPTION,
    gain_db: float | None = GAIN_OPTION,
    bit_depth: int | None = BITS_OPTION,
    pixel_format: str | None = FORMAT_OPTION,
    size: str | None = SIZE_OPTION,
    pages: bool = typer.Option(
        True, "--pages/--no-pages", help="Write a page with figures for each picture, or the tables alone."
    ),
    surface: bool = typer.Option(
        False, "--surface", help="Also write a page with the luminance as an interactive surface, 6 MB per picture."
    ),
    output: Path | None = output_option("PICTURE-image, or pictures-image"),
    force: bool = FORCE_OPTION,
    open_page: bool = OPEN_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Compute contrast detection probability (CDP), contrast, SNR and CSNR of regions in pictures.

    Without --contrast, the CDP of the measured contrast of each pair is computed. Without calibration and camera
    specification, relative luminance is used; contrasts are unaffected. Writes a page, a spreadsheet and JSON.

    Example: labcdp image night-*.png --roi rois.json --contrast 10%:200%:20
    """
    from ...evaluate.picture.files import summary_files
    from ...evaluate.picture.light.picture import picture_conversion
    from ...evaluate.picture.result import image_result

    if encoding is not None and encoding not in _ENCODINGS:
        raise InputError(f"--encoding is {encoding!r}: give {' or '.join(_ENCODINGS)}")
    request = _request(roi, contrast, epsilon, pair, neighbours, rectangle)
    conversion = picture_conversion(calibration, camera_spec, cast("Encoding | None", encoding))
    options = picture_options(conversion.options, exposure, gain_db, bit_depth, pixel_format, size)
    paths = _paths(files)
    configuration: dict[str, object] = {
        "contrasts": None if request.contrasts is None else list(request.contrasts),
        "epsilon": request.epsilon,
        "conversion": conversion.description,
        "roi": None if roi is None else str(roi),
        "pairs": [list(one) for one in request.chosen_pairs],
        "neighbours": request.neighbours,
        "rectangle": request.rectangle,
        "calibration": None if calibration is None else str(calibration),
        "camera": None if camera_spec is None else str(camera_spec),
        "encoding": encoding,
        "exposure_s": options.exposure_s,
        "gain_db": options.gain_db,
        "bit_depth": options.bit_depth,
        "pixel_format": options.pixel_format,
        "size": options.size,
    }
    inputs = input_files({"regions": roi, "calibration": calibration, "camera specification": camera_spec})
    if surface and not pages:
        raise InputError("--surface is a page: leave it out, or --no-pages")
    work = _Work(request, conversion, options, roi, pages, surface, configuration, inputs)
    with results_folder(context, files[0] if len(files) == 1 else "pictures", output, force) as results:
        folder = results.folder
        pictures = _evaluated(paths, work, results)
        result = image_result(pictures, request, configuration, inputs)
        good = any(picture.evaluation is not None for picture in pictures)
        if good:
            results.add(summary_files(pictures, result, conversion.description))
    if as_json:
        print_result(result, as_json)
    elif good:
        # Failures are reported last.
        print_result(
            replace(result, findings=tuple(one for one in result.findings if one.severity != "error")), as_json
        )
        page = "report.html" if pages or len(paths) > 1 else "results.xlsx"
        say(f"Report: {folder / page}; also results.xlsx and results.json")
    failures = [Failure(one.file, one.failure) for one in pictures if one.evaluation is None]
    show_page(folder / "report.html", open_page and good and (pages or len(paths) > 1))
    end_batch(failures, len(pictures), "pictures")


@dataclass(frozen=True)
class _Work:
    """Evaluation of each picture."""

    request: ImageRequest
    conversion: PictureConversion
    options: PictureOptions
    roi: Path | None
    pages: bool
    surface: bool
    configuration: dict[str, object]
    inputs: list[InputFile]

    def __call__(self, path: Path) -> tuple[ImageEvaluation, dict[str, bytes]]:
        """Evaluate a picture and write its files."""
        from ...evaluate.picture.files import picture_files
        from ...evaluate.picture.image import evaluate_image
        from ...evaluate.picture.result import image_result
        from ...evaluate.picture.tables import ReportedPicture
        from ...files.picture.read import read_picture
        from ...regions import load_regions

        picture = read_picture(path, self.options)
        height, width = picture.shape
        if self.roi is not None:
            # Reports regions outside the picture, or drawn on a picture of another size.
            load_regions(self.roi, (width, height))
        luminance = self.conversion.luminance(picture)
        evaluation = evaluate_image(
            picture, luminance, self.conversion.unit_of(picture), self.request, self.conversion.findings(picture)
        )
        if not self.pages:
            return evaluation, {}
        alone = [ReportedPicture(1, str(path), "", evaluation)]
        result = image_result(alone, self.request, self.configuration, self.inputs)
        files = picture_files(evaluation, picture, luminance, result, self.conversion.description, self.surface)
        return evaluation, files


def _evaluated(paths: Sequence[Path], work: _Work, results: ResultsFolder) -> list[ReportedPicture]:
    """Process the pictures and write their files."""
    from ...evaluate.picture.files import picture_folder
    from ...evaluate.picture.tables import ReportedPicture

    pictures: dict[int, ReportedPicture] = {}
    with progress_bars() as bars:
        for index, made in worked_through(paths, work):
            path, number = paths[index], index + 1
            folder = picture_folder(number, path) if len(paths) > 1 and work.pages else ""
            if isinstance(made, Failure):
                pictures[index] = ReportedPicture(number, str(path), folder, None, made.reason)
            else:
                evaluation, files = made
                results.add({f"{folder}/{name}" if folder else name: data for name, data in files.items()})
                pictures[index] = ReportedPicture(number, str(path), folder, evaluation)
            bars.update("Pictures", len(pictures), len(paths))
    return [pictures[index] for index in sorted(pictures)]


def _request(
    roi: Path | None,
    contrasts: Sequence[str],
    epsilon: str,
    pairs: Sequence[str],
    neighbours: bool,
    rectangle: str | None,
) -> ImageRequest:
    from ...evaluate.picture.request import ImageRequest
    from ...regions import load_regions, rois_of

    if roi is None and not (neighbours or rectangle):
        raise InputError("no regions given: give a file with --roi (see labcdp rois), or --neighbours")
    if roi is None and pairs:
        raise InputError("--pair names regions: give their file with --roi")
    rois = () if roi is None else rois_of(load_regions(roi))
    return ImageRequest(
        contrasts=contrasts_or_measured(contrasts),
        epsilon=parse_tolerance(epsilon),
        rois=rois,
        pairs=tuple(parse_pair(text, [one.name for one in rois]) for text in pairs) or None,
        neighbours=neighbours or rectangle is not None,
        rectangle=None if rectangle is None else _rectangle(rectangle),
    )


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
    from ...files.picture.read import picture_paths

    found: dict[Path, Path] = {}
    for path in picture_paths(files):
        first = found.setdefault(real_path(path), path)
        if first is not path:
            say(f"Note: {path} is the same file as {first} and is evaluated once")
    return list(found.values())
