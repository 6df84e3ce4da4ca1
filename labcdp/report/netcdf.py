"""Datasets as NetCDF-4 files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.disk import read_bytes, reason
from ..core.disk.child import read_in_child
from ..core.errors import InputError

if TYPE_CHECKING:
    from xarray import Dataset


#: Largest size of a file, and signatures of HDF5 and classic NetCDF.
_MOST_BYTES = 2**31
_SIGNATURES = (b"\x89HDF\r\n\x1a\n", b"CDF")
#: Compressed by zlib, with a checksum that detects damage.
_NUMBERS = {"zlib": True, "complevel": 4, "shuffle": True, "fletcher32": True}


def dataset_bytes(dataset: Dataset, what: str) -> bytes:
    """Return a labelled result as content of a NetCDF-4 file; equal results give equal bytes.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dataset whose attributes are texts and numbers.
    what : str
        Name of the result in messages.

    Raises
    ------
    InputError
        If it holds values that NetCDF cannot store.
    """
    encoding = {
        name: _NUMBERS for name, variable in dataset.data_vars.items() if variable.ndim and variable.dtype.kind in "iuf"
    }
    try:
        return bytes(dataset.to_netcdf(engine="netcdf4", format="NETCDF4", encoding=encoding))
    except (TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise InputError(
            f"the {what} holds what NetCDF cannot ({reason(error)}): give attributes that are texts or numbers"
        ) from error


def write_blocks(path: Path, blocks: Iterable[Dataset], along: str) -> None:
    """Write a Dataset block by block in constant memory; equal blocks give equal bytes.

    Parameters
    ----------
    path : Path
        Written incrementally: give a temporary name and rename.
    blocks : iterable of xarray.Dataset
        At least one; variables with the dimension `along` are concatenated, all others are taken from the first.
    along : str
        The dimension.
    """
    from netCDF4 import Dataset as File

    size = 0
    for block in blocks:
        start, size = size, size + block.sizes[along]
        grown = {name: variable for name, variable in block.variables.items() if along in variable.dims}
        if not start:
            encoding = {
                name: {**_NUMBERS, "chunksizes": variable.shape}
                for name, variable in grown.items()
                if variable.dtype.kind in "biuf" and variable.size
            }
            block.to_netcdf(path, engine="netcdf4", format="NETCDF4", encoding=encoding, unlimited_dims=[along])
            continue
        with File(path, "a") as file:
            file.set_auto_maskandscale(False)
            for name, variable in grown.items():
                index = tuple(slice(start, size) if name == along else slice(None) for name in variable.dims)
                file[str(name)][index] = variable.values


def read_dataset(path: Path, what: str) -> Dataset:
    """Read a labelled result into memory and close the file; `what` names it in messages.

    Raises
    ------
    InputError
        If the file is missing, cannot be read or is damaged.
    """
    data = read_bytes(path, f"the path of a {what} (.nc)", _MOST_BYTES)
    if not data.startswith(_SIGNATURES):
        raise InputError(f"{path} is no NetCDF file: give the path of a {what} (.nc)")
    try:
        # A single damaged byte can make HDF5 loop forever.
        dataset: Dataset = read_in_child(f"{__name__}:_load", data)
    except InputError as error:
        raise InputError(
            f"{path} is damaged or no NetCDF file ({error}): restore it from a copy, or make the {what} again"
        ) from error
    return dataset


def _load(data: bytes) -> Dataset:
    import xarray as xr

    return xr.load_dataset(data, engine="netcdf4")
