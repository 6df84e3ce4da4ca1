"""Variables of the datasets of pictures, videos and sessions, from the columns of their tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from xarray import Dataset

from ..core.result import Finding
from ..core.table import variables_of
from ..evaluate.columns import CDP, CONTRAST, CSNR, SHARES, by_itself, invalid_share, region_columns
from ..report.text import finding_text
from . import accessor as accessor  # registers it
from .arguments import ContrastRequest

#: What dimensions are, and other coordinates.
_COORDINATES = {
    "contrast": "Weber contrast to be detected, as a fraction (1.0 is 100 %)",
    "pair": "bright region / dark region",
    "side": "bright or dark region of the pair",
    "region": "name of the region",
    "frame": "number of the frame, from 0",
}


def described(dataset: Dataset, unit: str = "cd/m^2") -> Dataset:
    """Add descriptions of the coordinates, and units to all numbers; `unit` is the unit of luminances."""
    for name in dataset.variables:
        variable, attributes = dataset[name], dataset[name].attrs
        if name in _COORDINATES:
            attributes["long_name"] = _COORDINATES[str(name)]
        if variable.dtype.kind in "iufb" and name != "frame":
            attributes.setdefault("units", unit if name in ("mean", "u_mean") else "1")
    return dataset


def cdp_variables(dims: tuple[str, ...], items: Sequence[Any]) -> dict[str, Any]:
    """Return the variables of `Cdp`, or None for no CDP."""
    return variables_of((*CDP, *SHARES), dims, items)


def pair_variables(pairs: Sequence[Any], unit: str) -> dict[str, Any]:
    """Return the variables of `Pair`, and those of their regions: the bright one, then the dark one."""
    sides = [(pair.bright_region, pair.dark_region) for pair in pairs]
    columns = (*region_columns(unit), invalid_share("saturated"))
    return {
        **variables_of(by_itself(*CONTRAST, *CSNR), ("pair",), pairs),
        **variables_of(by_itself(*columns), ("pair", "side"), sides),
    }


def at_contrasts(dataset: Dataset, request: ContrastRequest, measured: Any) -> Dataset:
    """Add the target contrasts as a coordinate: those requested, or else the measured ones."""
    if request.values is None:
        return dataset.isel(contrast=0).assign_coords(contrast=measured)
    dataset = dataset.assign_coords(contrast=np.array(request.values))
    return dataset.isel(contrast=0) if request.scalar else dataset


def noted(findings: Sequence[Finding]) -> dict[str, str]:
    """Return findings as attributes of a dataset."""
    return {
        "notes": "\n".join(finding_text(finding) for finding in findings if finding.severity == "info"),
        "warnings": "\n".join(finding_text(finding) for finding in findings if finding.severity != "info"),
    }
