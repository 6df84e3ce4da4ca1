"""Command `labcdp sfr`: sharpness of a camera by the slanted edges in pictures."""

from __future__ import annotations

from pathlib import Path

import typer

from ...core.errors import InputError
from ...evaluate.sharpness.result import SharpnessSettings, evaluate_sharpness
from ...files.read import picture_paths
from ...regions import read_region_file, rois_of
from ..options import Results
from .options import PictureLightOptions, each_once


def sfr(
    light: PictureLightOptions,
    results: Results,
    files: tuple[Path, ...],
    *,
    roi: Path | None = None,
    chain: str | None = None,
) -> None:
    """Measure the sharpness (SFR) of a camera: MTF50, MTF10 and overshoot at slanted edges over the field.

    Each region holds one straight edge between a dark and a bright area, slanted by about 5° against the rows or
    columns of pixels. Several pictures have the same edges at the same places. Values are taken as light: gamma and
    companding are undone as for labcdp image. Writes a page, a spreadsheet, NetCDF and JSON.

    Example: labcdp sfr edges.tif --roi edges.json --chain manta-g505

    Parameters
    ----------
    files : FILE...
        Images: PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, raw dump, or a luminance map written by labcdp; or a folder
        of images.
    roi
        Region file with a region about each edge: .json from labcdp rois, or .roi or .zip from ImageJ.
    chain
        Name of a preset (see labcdp presets), or chain file: also write it with the measured MTF in its lens.
    """
    if roi is None:
        raise InputError("no regions: add --roi with a region about each edge (see labcdp rois)")
    shapes, image_size, regions = read_region_file(roi)
    inputs, loaded = [regions, *light.inputs()], None
    if chain is not None:
        from ...chain import Chain

        loaded = Chain.load(chain)
    settings = SharpnessSettings(rois_of(shapes), light.converter(), loaded, image_size, tuple(inputs))
    paths = each_once(picture_paths(files))
    with results.folder(files[0] if len(files) == 1 else "pictures") as folder:
        result, written = evaluate_sharpness(settings, paths)
        folder.add(written)
    results.show(result, folder)
    if any(finding.severity == "error" for finding in result.findings):
        raise typer.Exit(1)
