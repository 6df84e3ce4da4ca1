"""Command image-map: CDP of the edges in an image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from ...core.result import InputFile
from ...evaluate.picture.conversion import PictureConversion
from ...evaluate.picture.edges.map import ContrastMapSettings, contrast_map
from ...evaluate.picture.edges.page import write_contrast_map
from ...evaluate.picture.edges.result import MapSource, map_result
from ...files.picture import Picture
from ...files.read import read_picture
from ..output import Results
from ..terminal import fraction_of_percent
from .picture_options import PictureLightOptions


@dataclass(frozen=True)
class EdgeOptions:
    """Options of the map: its regions, and which contrasts are to be detected at their edges."""

    region_size: int = typer.Option(
        40, help="Side of the regions in pixels, at least 10: about half the size of the smallest relevant object."
    )
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast.")
    minimum_contrast: str = typer.Option(
        "10%", help="Smallest contrast of an edge; edges of less contrast are ignored."
    )
    contrast: str | None = typer.Option(
        None,
        help="Contrast that the objects of the scene have, to be detected at all edges; default: that of each edge.",
    )
    detected: float = typer.Option(0.9, help="Smallest CDP of a detected edge, above 0 and up to 1.")

    def settings(self) -> ContrastMapSettings:
        """Return what is given as numbers; raises InputError."""
        return ContrastMapSettings(
            self.region_size,
            fraction_of_percent(self.epsilon, "--epsilon"),
            fraction_of_percent(self.minimum_contrast, "--minimum-contrast"),
            self.detected,
            None if self.contrast is None else fraction_of_percent(self.contrast, "--contrast"),
        )


def image_map(
    context: typer.Context,
    light: PictureLightOptions,
    edges: EdgeOptions,
    results: Results,
    file: Path = typer.Argument(
        metavar="FILE", help="Image: PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dump, or a luminance map of labcdp."
    ),
    reference: Path | None = typer.Option(
        None, help="Image of the scene without veil or blur; its edges and their contrasts are to be detected."
    ),
) -> None:
    """Map the CDP of all edges in an image, to show where the camera loses objects.

    The image is segmented into regions whose borders follow its edges. Each edge is coloured by the probability (CDP)
    that a pixel on one side and a pixel on the other show the contrast of the edge; warm colours are edges that are
    lost. That contrast is the one in the image itself, which misses what a veil or blur took; --reference or --contrast
    give that of the scene. Edges whose contrast is within the noise are not drawn. Writes an interactive page, a
    picture, a spreadsheet with a row for each edge, NetCDF and JSON.

    Example: labcdp image-map night.png --calibration camera.json --region-size 30 --minimum-contrast 20%
    """
    settings, conversion = edges.settings(), light.conversion()
    inputs = light.inputs({"reference": reference})
    with results.folder(context, file) as folder:
        picture = read_picture(file, conversion.options)
        scene = None if reference is None else conversion.luminance(read_picture(reference, conversion.options))
        found = contrast_map(conversion.luminance(picture), settings, scene)
        source = _source(picture, conversion, inputs)
        result = map_result(found, source)
        write_contrast_map(found, source, result, folder)
    results.show(result, folder, also="; also contrast-map.png, results.xlsx, results.nc and results.json")


def _source(picture: Picture, conversion: PictureConversion, inputs: Sequence[InputFile]) -> MapSource:
    return MapSource(
        file=picture.path.name,
        sha256=picture.sha256,
        unit=conversion.unit_of(picture).replace("^2", "²"),
        conversion=conversion.description,
        simulated=picture.frame is not None and picture.frame.camera.simulated,
        findings=conversion.findings(picture),
        inputs=tuple(inputs),
    )
