"""Command image-map: CDP of the edges in an image."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from ..options import CAMERA_SPEC_OPTION
from ..output import FORCE_OPTION, OPEN_OPTION, output_option, results_folder, show_page
from ..terminal import JSON_OPTION, fraction_of_percent, print_result, say
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
    from ...evaluate.picture.edges.result import MapSource
    from ...evaluate.picture.light.picture import PictureConversion
    from ...files.picture.picture import Picture


def image_map(
    context: typer.Context,
    file: Path = typer.Argument(
        metavar="FILE", help="Image: PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dump, or a luminance map of labcdp."
    ),
    calibration: Path | None = typer.Option(
        None,
        help="Calibration file, for values in cd/m². Without it and --camera-spec, relative luminance is used.",
    ),
    camera_spec: Path | None = CAMERA_SPEC_OPTION,
    encoding: Literal["linear", "srgb"] | None = typer.Option(
        None, help="Encoding of the pixel values; default: usual encoding of the file type."
    ),
    exposure: str | None = EXPOSURE_OPTION,
    gain_db: float | None = GAIN_OPTION,
    bit_depth: int | None = BITS_OPTION,
    pixel_format: str | None = FORMAT_OPTION,
    size: str | None = SIZE_OPTION,
    region_size: int = typer.Option(
        40, help="Side of the regions in pixels, at least 10: about half the size of the smallest relevant object."
    ),
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast."),
    minimum_contrast: str = typer.Option(
        "10%", help="Smallest contrast of an edge; edges of less contrast are ignored."
    ),
    contrast: str | None = typer.Option(
        None,
        help="Contrast that the objects of the scene have, to be detected at all edges; default: that of each edge.",
    ),
    reference: Path | None = typer.Option(
        None, help="Image of the scene without veil or blur; its edges and their contrasts are to be detected."
    ),
    detected: float = typer.Option(0.9, help="Smallest CDP of a detected edge, above 0 and up to 1."),
    output: Path | None = output_option("FILE-image-map"),
    force: bool = FORCE_OPTION,
    open_page: bool = OPEN_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Map the CDP of all edges in an image, to show where the camera loses objects.

    The image is segmented into regions whose borders follow its edges. Each edge is coloured by the probability (CDP)
    that a pixel on one side and a pixel on the other show the contrast of the edge; warm colours are edges that are
    lost. That contrast is the one in the image itself, which misses what a veil or blur took; --reference or --contrast
    give that of the scene. Edges whose contrast is within the noise are not drawn. Writes an interactive page, a
    picture, a spreadsheet with a row for each edge, NetCDF and JSON.

    Example: labcdp image-map night.png --calibration camera.json --region-size 30 --minimum-contrast 20%
    """
    from ...evaluate.picture.edges.files import write_contrast_map
    from ...evaluate.picture.edges.map import ContrastMapSettings, contrast_map
    from ...evaluate.picture.edges.result import map_result
    from ...evaluate.picture.light.picture import picture_conversion
    from ...files.picture.read import read_picture

    settings = ContrastMapSettings(
        region_size,
        fraction_of_percent(epsilon, "--epsilon"),
        fraction_of_percent(minimum_contrast, "--minimum-contrast"),
        detected,
        None if contrast is None else fraction_of_percent(contrast, "--contrast"),
    )
    conversion = picture_conversion(calibration, camera_spec, encoding)
    options = picture_options(conversion.options, exposure, gain_db, bit_depth, pixel_format, size)
    inputs = input_files({"calibration": calibration, "camera specification": camera_spec, "reference": reference})
    with results_folder(context, file, output, force) as results:
        folder = results.folder
        picture = read_picture(file, options)
        scene = None if reference is None else conversion.luminance(read_picture(reference, options))
        found = contrast_map(conversion.luminance(picture), settings, scene)
        source = _source(picture, conversion, inputs)
        result = map_result(found, source)
        write_contrast_map(found, source, result, results)
    print_result(result, as_json)
    show_page(folder / "report.html", open_page)
    if not as_json:
        say(f"Report: {folder / 'report.html'}; also contrast-map.png, results.xlsx, results.nc and results.json")


def _source(picture: Picture, conversion: PictureConversion, inputs: Sequence[InputFile]) -> MapSource:
    from ...evaluate.picture.edges.result import MapSource

    return MapSource(
        file=picture.path.name,
        sha256=picture.sha256,
        unit=conversion.unit_of(picture).replace("^2", "²"),
        conversion=conversion.description,
        simulated=picture.frame is not None and picture.frame.camera.simulated,
        findings=conversion.findings(picture),
        inputs=tuple(inputs),
    )
