"""A luminance map that Python saved as NetCDF, as the image of a page."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.luminance import LuminanceMap
from ...report.netcdf import read_dataset
from ..regions.page_image import PageImage


def dataset_image(path: Path) -> PageImage:
    """Read what ``labcdp.read_image(...).to_dataset().to_netcdf(path)`` wrote; its U is that of single pixels.

    Raises
    ------
    InputError
        If the file cannot be read, or lacks luminance, its standard uncertainty or flags.
    """
    dataset = read_dataset(path, "luminance map")
    missing = sorted({"luminance", "u_luminance", "invalid"} - set(map(str, dataset.data_vars)))
    if missing or dataset["luminance"].ndim != 2:
        raise InputError(f"{path} is no luminance map of a picture: it lacks {', '.join(missing) or 'y or x'}")
    light = dataset["luminance"].to_numpy().astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        random_rel = dataset["u_luminance"].to_numpy() / np.abs(light)
    luminance = LuminanceMap(light, random_rel, (), dataset["invalid"].to_numpy().astype(np.uint8))
    return PageImage(path.name, light, False, None, luminance, str(dataset.attrs.get("unit", "relative")))
