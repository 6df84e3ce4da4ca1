"""What command info says of CSV files and spreadsheets: meter readings, and the spectral sensitivity of a camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

from ..core.disk.tables import read_table
from ..core.errors import InputError
from ..core.photometry import WAVELENGTH_RANGE_NM, source_names, spectral_weights
from ..core.reading import MeterIdentity
from ..core.spectra import (
    COMMON_ILLUMINANTS,
    SpectralTable,
    f1_prime,
    is_spectral_header,
    least_f1_prime,
    mismatch_factor,
    read_spectral_file,
    weighted_sum,
)
from ..core.table import Column, Table
from ..drivers.file_meter import READINGS_FILE, FileMeter, is_readings_header
from ..drivers.manual import MeterAccuracy
from ..report.text import span
from .info_results import Description, describe_workbook

#: Distance of points beyond which the lines between them are an assumption: a judgement, spectra are usually given in
#: steps of 5 or 10 nm.
_WIDEST_STEP_NM = 10.0
#: Most gaps that are named.
_MOST_NAMED = 3


def describe_table(path: Path, source: str) -> Description:
    """Describe readings of a luminance meter, or a spectral sensitivity; raises InputError for any other table."""
    table = read_table(
        path,
        f"meter readings, {READINGS_FILE}, or a spectral sensitivity",
        lambda names: is_readings_header(names) or is_spectral_header(names),
    )
    if "patch" in map(str.lower, table.header.cells):
        return _readings(path)
    return _sensitivity(path, source)


def describe_spreadsheet(path: Path, source: str) -> Description:
    """Describe a spreadsheet that labcdp wrote, or the table of another one; raises InputError."""
    return describe_workbook(path) or describe_table(path, source)


def _readings(path: Path) -> Description:
    unknown = MeterIdentity("unknown", "unknown")
    with FileMeter(path, unknown, MeterAccuracy(0.0, 0.0, 0)) as meter:
        counts = {f"readings of {patch}": str(len(readings)) for patch, readings in meter.readings.items()}
    return Description("meter readings", ("import PLAN SESSION --light FILES --readings {file}",), counts)


def _sensitivity(path: Path, source: str) -> Description:
    """Return f1' of a spectral sensitivity, and the mismatch factors of common lights (CIE 244)."""
    file = read_spectral_file(path)
    weights = least_f1_prime(file.columns) if len(file.columns) > 1 else {}
    whole = weighted_sum(file.columns, weights) if weights else file.only
    light = _light(source)
    properties = {
        "wavelengths": _wavelengths(next(iter(file.columns.values()))),
        **{f"not known {number}": text for number, text in enumerate(_not_known(file.columns), start=1)},
        "f1'": f"{f1_prime(whole):.2%} (DIN 5032-7: up to 3 % for meters of class A, 6 % for B)",
        **{f"weight of {name}": f"{weight:.3g}" for name, weight in weights.items()},
        **({f"f1' of {name}": f"{f1_prime(one):.1%}" for name, one in file.columns.items()} if weights else {}),
    }
    columns = (
        Column("light", "measured light", value="0"),
        Column("factor", "factor F", meaning="Multiply a luminance measured in this light by it.", decimals=4,
               value="1"),
        Column("error_rel", "error without it", "%", "Deviation of an uncorrected luminance.", decimals=2,
               value=lambda row: 1 / row[1] - 1),
    )  # fmt: skip
    factors = [(name, mismatch_factor(whole, name, light)) for name in COMMON_ILLUMINANTS]
    title = f"Spectral mismatch, calibrated in {source} light"
    return Description("spectral sensitivity", (), properties, (Table.of_items("mismatch", title, columns, factors),))


def _wavelengths(table: SpectralTable) -> str:
    nm = table.wavelength_nm
    steps = [after - before for before, after in pairwise(nm)]
    return f"{nm[0]:g} to {nm[-1]:g} nm, {len(nm)} points, steps of {span(f'{min(steps):g}', f'{max(steps):g}')} nm"


def _not_known(columns: Mapping[str, SpectralTable]) -> Iterator[str]:
    """Yield what a file of spectra leaves open, and what is assumed instead."""
    first, last = WAVELENGTH_RANGE_NM
    nm = next(iter(columns.values())).wavelength_nm
    ends = ((nm[0] > first, 0, f"below {nm[0]:g} nm"), (nm[-1] < last, -1, f"above {nm[-1]:g} nm"))
    for missing, end, where in ends:
        if missing:
            shares = [f"{one.values[end] / max(one.values):.1%}" for one in columns.values()]
            yield f"{where}: taken as 0; the last value is {', '.join(shares)} of the maximum"
    wide = [f"{a:g} to {b:g} nm" for a, b in pairwise(nm) if b - a > _WIDEST_STEP_NM and b > first and a < last]
    if wide:
        named = ", ".join(wide[:_MOST_NAMED]) + (f" and {len(wide) - _MOST_NAMED} more" if wide[_MOST_NAMED:] else "")
        yield f"between points more than {_WIDEST_STEP_NM:g} nm apart ({named}): taken as straight lines"
    if len(columns) == 1:
        yield "what it is of: taken as a camera's sensitivity; a light's spectral power is given with --source"
    yield "whether values are per power or per photon: taken per power; multiply a quantum efficiency by the wavelength"
    yield "whether lens, infrared filter and windscreen are included: taken as included"


def _light(source: str) -> str | SpectralTable:
    if Path(source).is_file():
        return read_spectral_file(source).only
    try:
        spectral_weights(source)
    except InputError as error:
        names = ", ".join(source_names())
        raise InputError(f"--source: {error}, or a CSV file or .xlsx; lights by name: {names}") from error
    return source
