"""What command info says of a camera's spectral sensitivity."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..core.errors import InputError
from ..core.photometry import source_names, spectral_weights
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


def spectral_properties(path: Path, source: str) -> tuple[dict[str, str], Table]:
    """Return f1' of a spectral sensitivity, and the mismatch factors of common lights (CIE 244); raises InputError."""
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
        Column("light", "measured light"),
        Column("factor", "factor F", meaning="Multiply a luminance measured in this light by it.", decimals=4),
        Column("error_rel", "error without it", "%", "Deviation of a luminance that is not corrected.", decimals=2),
    )
    factors = [mismatch_factor(whole, name, light) for name in COMMON_ILLUMINANTS]
    data: dict[str, list[Any]] = {
        "light": list(COMMON_ILLUMINANTS),
        "factor": factors,
        "error_rel": [1 / factor - 1 for factor in factors],
    }
    table = Table("mismatch", f"Spectral mismatch, calibrated in {source} light", columns, data)
    return properties, table


def _light(source: str) -> str | SpectralTable:
    if Path(source).is_file():
        return read_spectral_file(source).only
    try:
        spectral_weights(source)
    except InputError as error:
        names = ", ".join(source_names())
        raise InputError(f"--source: {error}, or a CSV file; lights by name: {names}") from error
    return source
