"""What command info says of CSV files: meter readings, and the spectral sensitivity of a camera."""

from __future__ import annotations

from pathlib import Path

from ..core.disk import read_csv
from ..core.errors import InputError
from ..core.photometry import source_names, spectral_weights
from ..core.reading import MeterIdentity
from ..core.spectra import (
    COMMON_ILLUMINANTS,
    SpectralTable,
    f1_prime,
    least_f1_prime,
    mismatch_factor,
    read_spectral_file,
    weighted_sum,
)
from ..core.table import Column, Table
from ..drivers.csv_meter import CsvMeter
from ..drivers.manual import MeterAccuracy
from .info_results import Description


def describe_csv(path: Path, source: str) -> Description:
    """Describe readings of a luminance meter, or a spectral sensitivity; raises InputError for any other file."""
    if "patch" in map(str.lower, read_csv(path, "meter readings or a spectral sensitivity").header):
        return _readings(path)
    return _sensitivity(path, source)


def _readings(path: Path) -> Description:
    unknown = MeterIdentity("unknown", "unknown")
    with CsvMeter(path, unknown, MeterAccuracy(0.0, 0.0, 0)) as meter:
        counts = {f"readings of {patch}": str(len(readings)) for patch, readings in meter.readings.items()}
    return Description("meter readings", ("import PLAN SESSION --light FILES --readings {file}",), counts)


def _sensitivity(path: Path, source: str) -> Description:
    """Return f1' of a spectral sensitivity, and the mismatch factors of common lights (CIE 244)."""
    file = read_spectral_file(path)
    weights = least_f1_prime(file.columns) if len(file.columns) > 1 else {}
    whole = weighted_sum(file.columns, weights) if weights else file.only
    light = _light(source)
    properties = {
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


def _light(source: str) -> str | SpectralTable:
    if Path(source).is_file():
        return read_spectral_file(source).only
    try:
        spectral_weights(source)
    except InputError as error:
        names = ", ".join(source_names())
        raise InputError(f"--source: {error}, or a CSV file; lights by name: {names}") from error
    return source
