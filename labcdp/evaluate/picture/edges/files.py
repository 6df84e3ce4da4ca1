"""A contrast map as files: page, picture, spreadsheet, NetCDF and JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ....core.result import Result
from ....output import Destination, write_files
from ....report.envelope import envelope_json
from ....report.netcdf import dataset_bytes
from ....report.sheets import result_workbook
from .edges import EdgeKind
from .figure import overlay, overlay_figure
from .map import ContrastMap
from .page import map_page
from .result import KINDS, MapSource, edge_table

if TYPE_CHECKING:
    from xarray import Dataset


def write_contrast_map(found: ContrastMap, source: MapSource, result: Result, folder: Destination) -> list[Path]:
    """Write a contrast map with all that it shows, into a folder as `write_files` takes it.

    Returns
    -------
    list of Path
        report.html, contrast-map.png, results.xlsx with a row for each edge, results.nc and results.json.

    Raises
    ------
    InputError
        If the folder cannot be made or a file cannot be written.
    """
    drawn = overlay(found)
    edges = replace(result, tables=(result.table("summary"), edge_table(found, source)))
    files = {
        "report.html": map_page(found, drawn, source, result).encode(),
        "contrast-map.png": overlay_figure(found, drawn, source),
        "results.xlsx": result_workbook(edges, datetime.now(UTC)),
        "results.nc": dataset_bytes(contrast_map_dataset(found, source, result), "contrast map"),
        "results.json": envelope_json(result).encode(),
    }
    return write_files(folder, "image-map", files)


def contrast_map_dataset(found: ContrastMap, source: MapSource, result: Result) -> Dataset:
    """All of a contrast map as a dataset: the label of each pixel, a row for each region, and one for each edge."""
    import xarray as xr

    edges, regions, step = found.edges, found.regions, found.luminance.step
    light = {"units": "1" if source.unit == "relative" else "cd m-2"}
    one, pixels = {"units": "1"}, {"units": "pixel"}
    flags = {
        "flag_values": np.array([int(kind) for kind in KINDS], dtype=np.int8),
        "flag_meanings": " ".join(name.replace(" ", "_") for name, _ in KINDS.values()),
    }
    return xr.Dataset(
        {
            "label": (("y", "x"), regions.labels),
            "region_mean": ("region", regions.mean, light),
            "region_std": ("region", regions.std, light),
            "region_noise": ("region", regions.noise, light),
            "region_measured_pixels": ("region", regions.n_pixels, one),
            "region_saturated_share": ("region", regions.saturated_share, one),
            "region_invalid_share": ("region", regions.invalid_share, one),
            "region_centre_x": ("region", regions.centre_px[:, 0] * step, pixels),
            "region_centre_y": ("region", regions.centre_px[:, 1] * step, pixels),
            "bright_region": ("edge", edges.bright),
            "dark_region": ("edge", edges.dark),
            "border_length": ("edge", edges.border_px * step, pixels),
            "border_x": ("edge", edges.middle_px[:, 0] * step, pixels),
            "border_y": ("edge", edges.middle_px[:, 1] * step, pixels),
            "kind": ("edge", edges.kind, flags),
            "contrast": ("edge", edges.contrast, one),
            "u_contrast": ("edge", edges.contrast_standard_uncertainty, one),
            "asked_contrast": ("edge", edges.asked_contrast, one),
            "significant_contrast": ("edge", edges.significant_contrast, one),
            "cdp": ("edge", edges.cdp, one),
            "u_cdp": ("edge", edges.cdp_standard_error, one),
            "cdp_low": ("edge", edges.cdp_low, one),
            "cdp_high": ("edge", edges.cdp_high, one),
        },
        attrs={
            "title": f"Contrast map of {source.file}",
            "file": source.file,
            "sha256": source.sha256,
            "image_pixels_per_label": step,
            "detected_edges": found.count(EdgeKind.SEEN),
            "lost_edges": found.count(EdgeKind.LOST),
            "configuration": json.dumps(dict(result.configuration), ensure_ascii=False),
        },
    )
