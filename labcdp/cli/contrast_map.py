"""Command image-map: where in an image a camera loses objects."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from .picture_options import BITS_OPTION, EXPOSURE_OPTION, FORMAT_OPTION, GAIN_OPTION, SIZE_OPTION, picture_options
from .terminal import JSON_OPTION, fraction_of_percent, print_json, print_table, say

if TYPE_CHECKING:
    from ..evaluate.light import PictureConversion
    from ..report.contrast_map_wording import MapSource
    from ..sources.picture import Picture


def image_map(
    file: Path = typer.Argument(
        metavar="FILE", help="Image: PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dump, or a luminance map of labcdp."
    ),
    calibration: Path | None = typer.Option(
        None,
        help="Calibration of the camera. Without it and without --camera, light is relative; contrasts still hold.",
    ),
    camera: Path | None = typer.Option(None, help="Camera specification (TOML), in place of a calibration."),
    encoding: Literal["linear", "srgb"] | None = typer.Option(
        None, help="How values follow light; default: what the kind of file suggests."
    ),
    exposure: str | None = EXPOSURE_OPTION,
    gain_db: float | None = GAIN_OPTION,
    bit_depth: int | None = BITS_OPTION,
    pixel_format: str | None = FORMAT_OPTION,
    size: str | None = SIZE_OPTION,
    region_size: int = typer.Option(
        40, help="Side of the regions in pixels, 10 or more: about half the smallest object that matters."
    ),
    epsilon: str = typer.Option("50%", help="Tolerance of a contrast."),
    minimum_contrast: str = typer.Option("10%", help="Edges of less contrast are no edges of objects."),
    detected: float = typer.Option(0.9, help="CDP from which an edge counts as detected, above 0 and up to 1."),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for the results.", show_default="FILE-contrast-map"
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Show where in an image this camera loses objects: the CDP of every edge between neighbouring regions.

    The image is cut into regions whose borders follow its edges. An edge whose contrast is not told from noise is no
    edge of an object and is not drawn. The others are drawn over the image, coloured by the probability (CDP) that a
    pixel of one side and one of the other show the contrast of the edge: warm colours are edges that get lost. Writes a
    picture, an interactive page, a spreadsheet with a row for each edge, NetCDF and JSON. Example:

    labcdp image-map night.png --calibration camera.json --region-size 30 --minimum-contrast 20%
    """
    from ..evaluate.contrast_map import ContrastMapSettings, contrast_map
    from ..evaluate.light import picture_conversion
    from ..report.contrast_map_results import write_contrast_map
    from ..report.contrast_map_wording import map_values, result_text, weakest_table
    from ..report.folder import place_for_results
    from ..sources.picture import read_picture

    settings = ContrastMapSettings(
        region_size,
        fraction_of_percent(epsilon, "--epsilon"),
        fraction_of_percent(minimum_contrast, "--minimum-contrast"),
        detected,
    )
    conversion = picture_conversion(calibration, camera, encoding)
    options = picture_options(conversion.options, exposure, gain_db, bit_depth, pixel_format, size)
    folder = output or Path(f"{file.stem}-contrast-map")
    with place_for_results(folder):
        picture = read_picture(file, options)
        found = contrast_map(conversion.luminance(picture), settings)
        source = _source(picture, conversion)
        written = write_contrast_map(found, source, folder)
    if as_json:
        print_json({"written": [str(path) for path in written], **map_values(found, source)})
        return
    for warning in (*source.warnings, *found.warnings):
        say(f"Warning: {warning}")
    table = weakest_table(found, source)
    if table.rows:
        print_table("The weakest edges", *table)
    for text in result_text(found):
        say(text)
    say(f"Map: {folder / 'contrast-map.html'}; also .png, .xlsx, .nc and .json")


def _source(picture: Picture, conversion: PictureConversion) -> MapSource:
    from ..report.contrast_map_wording import MapSource

    simulated = picture.frame is not None and picture.frame.camera.simulated
    return MapSource(
        file=picture.path.name,
        sha256=picture.sha256,
        unit=conversion.unit_of(picture),
        conversion=conversion.description,
        simulated=simulated,
        warnings=(*picture.notes, *conversion.warnings(picture)),
    )
