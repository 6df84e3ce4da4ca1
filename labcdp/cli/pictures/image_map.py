"""Command `labcdp image-map`: the CDP of all edges in an image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.result import InputFile
from ...evaluate.picture.edges.edges import ContrastMapSettings
from ...evaluate.picture.edges.map import contrast_map
from ...evaluate.picture.edges.page import contrast_map_files
from ...evaluate.picture.edges.result import map_result
from ...files.read import read_picture
from ..options import Contrasts, Percent, Results, Tolerance, one_or_all
from .options import PictureLightOptions


@dataclass(frozen=True)
class EdgeOptions:
    """Options of the map: its regions, and which contrasts are to be detected at their edges.

    Parameters
    ----------
    region_size
        Side of the regions in pixels, at least 10: about half the size of the smallest relevant object.
    minimum_contrast
        Smallest contrast of an edge; weaker edges are ignored.
    contrast
        Target contrasts at all edges: 100%, a list such as 50%,100%, or a range START:STOP:COUNT[:log] such as
        10%:200%:20. May be repeated; default: that of each edge.
    detected
        Smallest CDP of a detected edge, above 0 and up to 1.
    """

    region_size: int = 40
    epsilon: Tolerance = 0.5
    minimum_contrast: Percent = 0.1
    contrast: Contrasts = None
    detected: float = 0.9


def image_map(
    light: PictureLightOptions,
    edges: EdgeOptions,
    results: Results,
    file: Path,
    *,
    reference: Path | None = None,
) -> None:
    """Map the CDP of all edges in an image, to show where the camera loses objects.

    The image is segmented into regions whose borders follow its edges. Each edge is coloured by the probability (CDP)
    that a pixel on one side and a pixel on the other show the contrast of the edge; warm colours are edges that are
    lost. This is the contrast in the image itself, without what a veil or blur has removed; --reference or --contrast
    give that of the scene. Edges whose contrast is within the noise are not drawn. Writes an interactive page, a
    picture, a spreadsheet with a row for each edge, NetCDF and JSON.

    Example: labcdp image-map night.png --calibration camera.json --exposure 8ms --region-size 30 --minimum-contrast 20%

    Parameters
    ----------
    file : FILE
        Image: PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dump, or a luminance map written by labcdp.
    reference
        Image of the scene without veil or blur; its edges and their contrasts are to be detected.
    """
    settings = ContrastMapSettings(
        edges.region_size, edges.epsilon, edges.minimum_contrast, edges.detected, one_or_all(edges.contrast)
    )
    converter = light.converter()
    inputs = [*([] if reference is None else [InputFile.of("reference", reference)]), *light.inputs()]
    with results.folder(file) as folder:
        picture = read_picture(file, converter.options)
        scene = None if reference is None else converter.luminance(read_picture(reference, converter.options))
        edge_map = contrast_map(converter.luminance(picture), settings, scene)
        source = converter.source(picture)
        result = map_result(edge_map, source, inputs)
        folder.add(contrast_map_files(edge_map, source, result))
    results.show(result, folder)
