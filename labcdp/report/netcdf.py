"""Maps, and other labelled results, as NetCDF files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..evaluate.map_axes import check_map
from ..session.files import write_whole

if TYPE_CHECKING:
    from xarray import Dataset

#: Compressed by zlib, with a checksum, so that damage is seen.
_NUMBERS = {"zlib": True, "complevel": 4, "shuffle": True, "fletcher32": True}


def save_netcdf(dataset: Dataset, path: str | PathLike[str]) -> None:
    """Write a map as NetCDF-4 file, whole or not at all; equal maps give equal bytes.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map; its attributes are texts and numbers.
    path : path
        Replaced if it exists.

    Raises
    ------
    InputError
        If the dataset is no map, holds what NetCDF cannot, or the file cannot be written.
    """
    path = Path(path)
    data = netcdf_bytes(dataset)
    try:
        write_whole(path.parent, path.name, data)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): choose a folder that exists and that you may write to"
        ) from error


def netcdf_bytes(dataset: Dataset) -> bytes:
    """Return the content of the file that `save_netcdf` writes; raises InputError as it does."""
    check_map(dataset)
    return dataset_bytes(dataset, "map")


def dataset_bytes(dataset: Dataset, what: str) -> bytes:
    """Return any labelled result as content of a NetCDF-4 file; equal results give equal bytes.

    Parameters
    ----------
    dataset : xarray.Dataset
        Its attributes are texts and numbers.
    what : str
        What it is, for messages.

    Raises
    ------
    InputError
        If it holds what NetCDF cannot.
    """
    encoding = {
        name: _NUMBERS for name, variable in dataset.data_vars.items() if variable.ndim and variable.dtype.kind in "iuf"
    }
    try:
        return bytes(dataset.to_netcdf(engine="netcdf4", format="NETCDF4", encoding=encoding))
    except (TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise InputError(
            f"the {what} holds what NetCDF cannot ({_one_line(error)}): give attributes that are texts or numbers"
        ) from error


def load_netcdf(path: str | PathLike[str]) -> Dataset:
    """Read a map that `save_netcdf` wrote.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    xarray.Dataset
        In memory; the file is closed.

    Raises
    ------
    InputError
        If the file is missing, cannot be read, is damaged, or is no map of labcdp.
    """
    dataset = read_dataset(Path(path), "map")
    try:
        check_map(dataset)
    except InputError as error:
        raise InputError(f"{path} is no map of labcdp: {error}") from error
    return dataset


def read_dataset(path: Path, what: str) -> Dataset:
    """Read any labelled result into memory and close the file; `what` it should be is told in messages.

    Raises
    ------
    InputError
        If the file is missing, cannot be read or is damaged.
    """
    import xarray as xr

    try:
        # Bytes, so that an error of the file system is told from one of the format.
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): give the path of a {what} (.nc)") from error
    try:
        return xr.load_dataset(data, engine="netcdf4")
    except Exception as error:  # damage can surface as almost any error of the libraries
        raise InputError(
            f"{path} is damaged or no NetCDF file ({_one_line(error)}): restore it from a copy, or make the {what} "
            "again"
        ) from error


def _one_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
