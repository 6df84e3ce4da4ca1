"""A contrast map as files: for people, for spreadsheets and for machines."""

from __future__ import annotations

from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..evaluate.contrast_map_edges import EdgeKind
from ..json_text import results_json
from .contrast_map_figure import overlay, overlay_figure
from .contrast_map_page import contrast_map_page
from .contrast_map_sheets import contrast_map_workbook
from .contrast_map_wording import KIND_NAMES, MapSource, map_values
from .folder import write_files

if TYPE_CHECKING:
    from xarray import Dataset

    from ..evaluate.contrast_map import ContrastMap

#: Compressed by zlib, with a checksum, so that damage is seen.
_COMPRESSED = {"zlib": True, "complevel": 1, "shuffle": True, "fletcher32": True}


def write_contrast_map(found: ContrastMap, source: MapSource, folder: str | PathLike[str]) -> list[Path]:
    """Write a contrast map with all that it shows; files of an earlier one in the folder are replaced.

    Everything is made before the first file is written, and each file is there whole or not at all.

    Returns
    -------
    list of Path
        contrast-map.png, .html, .xlsx, .nc and .json, which holds what `map_values` returns.

    Raises
    ------
    InputError
        If the folder cannot be made or a file cannot be written.
    """
    drawn = overlay(found)
    files = {
        "contrast-map.png": overlay_figure(found, drawn, source),
        "contrast-map.html": contrast_map_page(found, drawn, source).encode(),
        "contrast-map.xlsx": contrast_map_workbook(found, source, datetime.now(UTC)),
        "contrast-map.nc": _netcdf(contrast_map_dataset(found, source)),
        "contrast-map.json": results_json(map_values(found, source)).encode(),
    }
    return write_files(Path(folder), files)


def contrast_map_dataset(found: ContrastMap, source: MapSource) -> Dataset:
    """All of a contrast map as a dataset: the label of each pixel, a row for each region, and one for each edge."""
    import xarray as xr

    edges, regions, step = found.edges, found.regions, found.luminance.step
    light = {"units": "cd m-2" if source.unit == "cd/m^2" else "1"}
    one, pixels = {"units": "1"}, {"units": "pixel"}
    flags = {
        "flag_values": np.array([int(kind) for kind in KIND_NAMES], dtype=np.int8),
        "flag_meanings": " ".join(name.replace(" ", "_") for name in KIND_NAMES.values()),
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
            "contrast_standard_uncertainty": ("edge", edges.contrast_standard_uncertainty, one),
            "contrast_told_from_noise": ("edge", edges.least_told, one),
            "cdp": ("edge", edges.cdp, one),
            "cdp_standard_uncertainty": ("edge", edges.cdp_standard_error, one),
            "cdp_low": ("edge", edges.cdp_low, one),
            "cdp_high": ("edge", edges.cdp_high, one),
        },
        attrs={
            "title": f"Contrast map of {source.file}",
            "file": source.file,
            "sha256": source.sha256,
            "conversion": source.conversion,
            "image_pixels_per_label": step,
            "detected_edges": found.count(EdgeKind.SEEN),
            "lost_edges": found.count(EdgeKind.LOST),
            "settings": results_json(map_values(found, source)),
        },
    )


def _netcdf(dataset: Dataset) -> bytes:
    encoding = {name: _COMPRESSED for name, variable in dataset.data_vars.items() if variable.ndim}
    try:
        return bytes(dataset.to_netcdf(engine="netcdf4", format="NETCDF4", encoding=encoding))
    except (ValueError, RuntimeError) as error:
        raise InputError(f"the map cannot be written as NetCDF ({error}): give an image with a plain name") from error
