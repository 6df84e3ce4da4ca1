"""A map of CDP as files: for machines, for people, and for spreadsheets."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ..evaluate.maps import analyse_map
from ..json_text import results_json
from .folder import write_files
from .map_figure import map_figure
from .map_page import map_page
from .map_sheets import map_spreadsheet
from .map_tables import map_values
from .netcdf import netcdf_bytes

if TYPE_CHECKING:
    from xarray import Dataset


def write_map(
    dataset: Dataset, folder: str | PathLike[str], level: float = 0.9, expected: Sequence[float] = ()
) -> list[Path]:
    """Analyse a map and write it with all that it shows.

    Everything is made before the first file is written, and each file is there whole or not at all. Files of an
    earlier map in the folder are replaced.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map.
    folder : path
        Made if it does not exist.
    level : float
        CDP that is high enough, above 0, up to 1.
    expected : sequence of float
        Luminances at which the sensor changes exposure, for the dips.

    Returns
    -------
    list of Path
        map.nc, map.png, map.html, map.xlsx and map.json, which holds what `map_values` returns.

    Raises
    ------
    InputError
        If the dataset is no map, has too many axes to be drawn, or a file cannot be written.
    """
    analysis = analyse_map(dataset, level, expected)
    files = {
        "map.nc": netcdf_bytes(dataset),
        "map.png": map_figure(dataset, analysis),
        "map.html": map_page(dataset, analysis).encode(),
        "map.xlsx": map_spreadsheet(dataset, analysis, datetime.now(UTC)),
        "map.json": results_json(map_values(dataset, analysis)).encode(),
    }
    return write_files(Path(folder), files)
