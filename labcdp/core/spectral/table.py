"""Spectra as tables: relative sensitivity of a camera, or power of a light source, over the wavelength."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..disk import CsvRow, quoted, read_csv, shortened
from ..errors import InputError
from .photometry import WAVELENGTH_RANGE_NM

#: Name of the first column.
_WAVELENGTH = "wavelength_nm"
#: Columns of a camera with colour filters.
_COLOURS = ("R", "G", "B")
#: What a single column is called, whatever its name in the file.
ONLY = "relative"
#: A table may end inside the visible range where it has fallen to this share of its maximum.
_LARGEST_END = 0.05
#: Share of the maximum by which a value may lie below zero: noise of a measured table.
_SMALLEST = -0.02


@dataclass(frozen=True)
class SpectralTable:
    """A relative quantity over the wavelength; straight lines between the points, zero outside.

    Parameters
    ----------
    wavelength_nm : tuple of float
        Rising, at least two.
    values : tuple of float
        In any unit. Sensitivities are those to radiant power (A/W), not to photons (quantum efficiency). A sum of
        sensitivities with weights may be negative somewhere.

    Raises
    ------
    InputError
        If there are fewer than two points, wavelengths do not rise, a value is not finite, none is above zero, or the
        table ends where it still matters for 380 to 780 nm.
    """

    wavelength_nm: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        nm, values = np.array(self.wavelength_nm, dtype=float), np.array(self.values, dtype=float)
        if nm.size != values.size or nm.size < 2:
            raise InputError(
                f"a spectrum has {nm.size} wavelengths and {values.size} values: give at least 2 pairs of them"
            )
        if not (np.isfinite(nm).all() and nm[0] > 0 and (np.diff(nm) > 0).all()):
            at = int(np.argmax(np.diff(nm) <= 0)) + 1
            raise InputError(f"wavelengths do not rise at {nm[at]:g} nm: give each once, in rising order, in nm")
        if not np.isfinite(values).all() or values.max() <= 0:
            raise InputError("a spectrum has no value above 0, or one that is not finite: give relative values")
        first, last = WAVELENGTH_RANGE_NM
        for end, visible, side in ((0, nm[0] <= first, "begins"), (-1, nm[-1] >= last, "ends")):
            if not visible and values[end] > _LARGEST_END * values.max():
                raise InputError(
                    f"the spectrum {side} at {nm[end]:g} nm with {values[end] / values.max():.0%} of its maximum: give "
                    f"it from {first:g} to {last:g} nm, or to where it vanishes"
                )

    def at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Values at wavelengths of any shape; zero outside the table."""
        nm = np.asarray(wavelength_nm, dtype=float)
        values: NDArray[np.float64] = np.interp(nm, self.wavelength_nm, self.values, left=0.0, right=0.0)
        return values


@dataclass(frozen=True)
class SpectralFile:
    """What a file of spectra says.

    Parameters
    ----------
    columns : dict of str to SpectralTable
        ``R``, ``G`` and ``B``, or a single one called `ONLY`.
    sha256 : str
        Hash of the file's bytes, for the record.
    """

    columns: Mapping[str, SpectralTable]
    sha256: str

    @property
    def only(self) -> SpectralTable:
        """The one column; raises InputError if there are R, G and B."""
        if len(self.columns) > 1:
            raise InputError(f"the file has the columns {', '.join(self.columns)}: give one with a single column")
        return next(iter(self.columns.values()))


def read_spectral_file(path: str | PathLike[str]) -> SpectralFile:
    """Read spectra from a CSV file.

    The file is UTF-8 text with a header: ``wavelength_nm``, then one column of any name, or the three ``R``, ``G``
    and ``B``. Comma, semicolon or tab separate; with semicolon or tab a number may have a decimal comma.

    Raises
    ------
    InputError
        If it cannot be read or is no such file; the message names the line.
    """
    path = Path(path)
    read = read_csv(path, "a CSV file with the columns wavelength_nm and R, G, B or a single one")
    names = _names(path, read.header)
    table = np.array([_numbers(path, row, read.separator) for row in read.rows])
    if len(table) == 0:
        raise InputError(f"{path} has a header and no values: add lines of wavelength and values below it")
    columns = {name: _column(path, name, table[:, 0], table[:, i]) for i, name in enumerate(names, start=1)}
    return SpectralFile(columns, hashlib.sha256(read.data).hexdigest())


def _names(path: Path, header: Sequence[str]) -> list[str]:
    names = [name.upper() for name in header[1:]]
    if header[0].lower() != _WAVELENGTH or not (len(names) == 1 or sorted(names) == sorted(_COLOURS)):
        raise InputError(
            f"{path} has the columns {shortened(', '.join(header))}: give wavelength_nm and then one column, or R, G "
            "and B"
        )
    return names if len(names) > 1 else [ONLY]


def _numbers(path: Path, row: CsvRow, separator: str) -> list[float]:
    try:
        return [float(cell.replace(",", ".") if separator != "," else cell) for cell in row.cells]
    except ValueError as error:
        raise InputError(
            f"{path}, line {row.line}: {quoted(separator.join(row.cells))} holds no number in a cell"
        ) from error


def _column(path: Path, name: str, nm: NDArray[Any], values: NDArray[Any]) -> SpectralTable:
    try:
        table = SpectralTable(tuple(nm.tolist()), tuple(values.tolist()))
    except InputError as error:
        raise InputError(f"{path}, column {name}: {error}") from error
    lowest = int(np.argmin(values))
    if values[lowest] < _SMALLEST * values.max():
        raise InputError(
            f"{path}, column {name}: it has {values[lowest]:g} at {nm[lowest]:g} nm: give values of at least 0"
        )
    return table
