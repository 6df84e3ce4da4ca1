"""Measured spectra, f1', and spectral mismatch factors between light sources."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .disk import quoted, shortened
from .errors import InputError, naming
from .photometry import THESIS_SPECTRUM, WAVELENGTH_RANGE_NM, colour_matching, spectral_weights
from .result import Finding, FindingValue, info, warning

if TYPE_CHECKING:
    from .disk.tables import WrittenRow

#: Name of the first column.
_WAVELENGTH = "wavelength_nm"
#: Columns of a camera with colour filters.
_COLOURS = ("R", "G", "B")
#: What a single column is called, whatever its name in the file.
ONLY = "relative"
#: A number with a decimal point; float() also takes other digits and 1_000.
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
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
    """Read spectra from a CSV file or a spreadsheet.

    The file is UTF-8 text with a header: ``wavelength_nm``, also written ``wavelength (nm)``, then one column of any
    name, or the three ``R``, ``G`` and ``B``. Comma, semicolon or tab separate; with semicolon or tab a number may have
    a decimal comma. Or it is a spreadsheet (.xlsx) with such a table, of numbers, in one of its sheets.

    Raises
    ------
    InputError
        If it cannot be read or is no such file; the message names the line or cell.
    """
    # Most commands read no file of spectra.
    from .disk.tables import read_table

    read = read_table(path, f"a CSV file or .xlsx with the columns {_WAVELENGTH} and R, G, B or a single one",
                      is_spectral_header)  # fmt: skip
    header = read.header.cells
    names = [name.upper() for name in header[1:]]
    if not is_spectral_header(header) or not (len(names) == 1 or sorted(names) == sorted(_COLOURS)):
        raise InputError(
            f"{path} has the columns {shortened(', '.join(header))}: give {_WAVELENGTH} and then one column, or "
            "R, G and B"
        )
    rows, marks = [], set[str]()
    for row in read.rows:
        numbers = _numbers(row, path, read.comma_is_decimal)
        marks |= {",", "."} & set("".join(row.cells))
        if len(marks) > 1:
            raise InputError(
                f"{path}, {row.place()}: {quoted(row.raw)} has another decimal mark than the numbers above: write all "
                "with a point or all with a comma, and no mark of thousands"
            )
        rows.append(numbers)
    if not rows:
        raise InputError(f"{path} has a header and no values: add lines of wavelength and values below it")
    nm, *values = np.array(rows).T
    columns = {}
    for name, column in zip(names if len(names) > 1 else [ONLY], values, strict=True):
        with naming(f"{path}, column {name}"):
            columns[name] = SpectralTable(tuple(nm.tolist()), tuple(column.tolist()))
        lowest = int(np.argmin(column))
        if column[lowest] < _SMALLEST * column.max():
            raise InputError(
                f"{path}, column {name}: it has {column[lowest]:g} at {nm[lowest]:g} nm: give values of at least 0"
            )
    return SpectralFile(columns, hashlib.sha256(read.data).hexdigest())


def is_spectral_header(names: Sequence[str]) -> bool:
    """Whether names of columns are those of spectra: a wavelength in nm comes first."""
    from .disk.tables import quantity_and_unit

    first = names[0] if names else ""
    return first.lower() == _WAVELENGTH or quantity_and_unit(first) == ("wavelength", "nm")


def _numbers(row: WrittenRow, path: str | PathLike[str], comma_is_decimal: bool) -> list[float]:
    """Return the numbers of a row; raises InputError."""
    numbers = []
    for at in range(len(row.cells)):
        with naming(f"{path}, {row.place(at)}"):
            cell = row.number_text(at)
            text = cell.replace(",", ".") if comma_is_decimal else cell
            if _NUMBER.fullmatch(text) is None:
                raise InputError(f"{quoted(row.raw)} has a cell that is not a number")
            numbers.append(float(text))
    return numbers


#: A light source: by the name of its spectrum, as `labcdp.core.photometry` knows it, or measured.
Source = str | SpectralTable

#: Illuminants of a table of mismatch factors: incandescent, daylight, LED, and a fluorescent lamp of each group.
COMMON_ILLUMINANTS = (
    "A", "D50", "D65", "E", "LED-B1", "LED-B2", "LED-B3", "LED-B4", "LED-B5", "LED-BH1", "LED-RGB1", "LED-V1",
    "LED-V2", "FL2", "FL7", "FL11", "HP1", "HP4",
)  # fmt: skip

#: Relative change of a luminance below which another light does no harm worth a number.
_NEGLIGIBLE = 0.001


def f1_prime(sensitivity: SpectralTable) -> float:
    """General V(lambda) mismatch index f1' of a sensitivity, as a fraction.

    f1' = integral |s*(lambda) - V(lambda)| / integral V(lambda), 380 to 780 nm, with s* = s times integral(S_A V) /
    integral(S_A s), S_A the CIE illuminant A (ISO/CIE 19476:2014, CIE S 023, section 5.2.2).

    Parameters
    ----------
    sensitivity : SpectralTable
        Relative sensitivity to radiant power.
    """
    nm, illuminant_a, visibility = spectral_weights("A")
    s = sensitivity.at(nm)
    matched = s * (illuminant_a @ visibility) / _seen(float(illuminant_a @ s), "A")
    return float(np.abs(matched - visibility).sum() / visibility.sum())


def mismatch_factor(sensitivity: SpectralTable, test: Source, calibration: Source) -> float:
    """Spectral mismatch correction factor F: the true luminance over the indicated one.

    F = integral(S_t V) integral(S_c s) / (integral(S_t s) integral(S_c V)) (ISO/CIE 19476:2014, CIE S 023, section
    5.2.3, there for calibration in illuminant A). Multiply a luminance that was measured in the light S_t, with a
    calibration in the light S_c, by F.

    Parameters
    ----------
    sensitivity : SpectralTable
        Relative sensitivity to radiant power.
    test, calibration : str or SpectralTable
        The light that is measured, and the light of the calibration.

    Raises
    ------
    InputError
        If a source is not known, or the sensitivity sees none of its light.
    """
    return response_per_luminance(sensitivity, calibration) / response_per_luminance(sensitivity, test)


def chromaticity(source: Source) -> tuple[float, float]:
    """Chromaticity coordinates x and y of a light, for the CIE 1931 standard observer (CIE 15:2018, 7.1).

    Parameters
    ----------
    source : str or SpectralTable
        The light.

    Raises
    ------
    InputError
        If a source is not known, or nothing of it is seen.

    Examples
    --------
    >>> from labcdp.core.spectra import chromaticity
    >>> [round(coordinate, 3) for coordinate in chromaticity("D65")]
    [0.313, 0.329]
    """
    nm, power, _ = _nodes(source)
    known_nm, functions = colour_matching()
    x, y, z = (float(power @ np.interp(nm, known_nm, function, left=0, right=0)) for function in functions)
    total = _seen(x + y + z, _name(source))
    return x / total, y / total


def response_per_luminance(sensitivity: SpectralTable, source: Source) -> float:
    """Response of a sensitivity to a light over that of V(lambda); raises as `mismatch_factor`."""
    nm, power, visibility = _nodes(source)
    luminance = _seen(float(power @ visibility), _name(source))
    return _seen(float(power @ sensitivity.at(nm)), _name(source)) / luminance


def least_f1_prime(sensitivities: Mapping[str, SpectralTable]) -> dict[str, float]:
    """Weights of the sum of sensitivities with the smallest f1'.

    With each sensitivity scaled to the same integral with illuminant A, f1' of a sum with weights b, sum b = 1, is a
    sum of absolute values that are linear in b: the minimum is that of a linear program.

    Parameters
    ----------
    sensitivities : mapping of str to SpectralTable
        Of the planes, relative to radiant power.

    Returns
    -------
    dict of str to float
        Factors of the sensitivities as given, scaled so that the sum has the response of V(lambda) to illuminant A.
    """
    from scipy.optimize import linprog

    nm, illuminant_a, visibility = spectral_weights("A")
    light = float(illuminant_a @ visibility)
    scale = {name: light / _seen(float(illuminant_a @ one.at(nm)), "A") for name, one in sensitivities.items()}
    matched = np.column_stack([scale[name] * one.at(nm) for name, one in sensitivities.items()])
    n, planes = matched.shape
    # Variables: b, and for each wavelength a bound u >= |sum b s* - V|.
    cost = np.concatenate([np.zeros(planes), np.ones(n)])
    above = np.block([[matched, -np.eye(n)], [-matched, -np.eye(n)]])
    limits = np.concatenate([visibility, -visibility])
    sum_of_b = np.concatenate([np.ones(planes), np.zeros(n)])[None]
    bounds = [(None, None)] * planes + [(0, None)] * n
    found = linprog(cost, A_ub=above, b_ub=limits, A_eq=sum_of_b, b_eq=[1.0], bounds=bounds, method="highs")
    assert found.x is not None, found.message  # feasible for any b, and bounded below by 0
    return {name: float(b) * scale[name] for name, b in zip(sensitivities, found.x[:planes], strict=True)}


def weighted_sum(sensitivities: Mapping[str, SpectralTable], weights: Mapping[str, float]) -> SpectralTable:
    """Sensitivity of a weighted sum of planes, at 1 nm from 380 to 780 nm; raises InputError if none is above 0."""
    first, last = WAVELENGTH_RANGE_NM
    nm = np.arange(first, last + 1)
    total = np.sum([weights[name] * one.at(nm) for name, one in sensitivities.items()], axis=0)
    return SpectralTable(tuple(nm.tolist()), tuple(total.tolist()))


def mismatch_findings(
    calibration_source: Source, session_source: Source, sensitivity: SpectralTable | None
) -> list[Finding]:
    """Return what it costs to measure in another light than that of the calibration.

    Parameters
    ----------
    calibration_source, session_source : str or SpectralTable
        The two lights; two are the same if they are equal.
    sensitivity : SpectralTable or None
        Of the calibrated camera, None if it is not known.

    Returns
    -------
    list of Finding
        One, or none in the same light.
    """
    if calibration_source == session_source:
        return []
    lights = {"calibrated": _name(calibration_source), "measured": _name(session_source)}
    if sensitivity is None:
        return [warning("light-differs", **lights)]
    try:
        factor = mismatch_factor(sensitivity, session_source, calibration_source)
    except InputError as error:
        return [warning("light-differs-unknown", **lights, reason=str(error))]
    deviation = 1 / factor - 1
    values: dict[str, FindingValue] = {**lights, "deviation_rel": deviation, "f1_prime": f1_prime(sensitivity)}
    if abs(deviation) < _NEGLIGIBLE:
        return [info("light-differs-negligible", **values)]
    return [warning("light-differs-by", **values, factor=factor)]


def _name(source: Source) -> str:
    return source if isinstance(source, str) else "a measured"


def _nodes(source: Source) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    if source == THESIS_SPECTRUM:
        raise InputError(f"{THESIS_SPECTRUM} is a conversion and no spectrum: name the spectrum of the light")
    if isinstance(source, str):
        return spectral_weights(source)
    nm, _, visibility = spectral_weights("E")
    return nm, source.at(nm), visibility


def _seen(integral: float, source: str) -> float:
    if not integral > 0:
        raise InputError(f"nothing of {source} light is seen between 380 and 780 nm: check both spectra")
    return integral
