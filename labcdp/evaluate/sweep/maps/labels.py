"""Labels of the axes, variables and ranges of a map in its tables, picture and page."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from ....core.table import Column
from ....report.text import percent, printable
from .axes import VARIABLES, At, MapAxis, unit_of
from .ranges import UsableInterval

if TYPE_CHECKING:
    from xarray import Dataset


def axis_name(axis: MapAxis) -> str:
    """Name an axis."""
    return printable(axis.long_name or axis.name.rpartition(".")[2].replace("_", " "))


def axis_unit(axis: MapAxis) -> str:
    """Return the unit in which an axis is shown; contrasts are in percent."""
    return "%" if axis.is_contrast else axis.unit


def axis_label(axis: MapAxis) -> str:
    """Label an axis, with its unit."""
    unit = axis_unit(axis)
    return f"{axis_name(axis)} in {unit}" if unit else axis_name(axis)


def shown(axis: MapAxis, values: Any) -> Any:
    """Return coordinates as they are drawn: contrasts in percent."""
    return 100 * np.asarray(values) if axis.is_contrast else np.asarray(values)


def plain(value: float, n_digits: int = 3) -> str:
    """Write a value with a number of digits, 0 to 999999 without a power of ten, and no zeros at its end."""
    rounded = float(f"{value:.{n_digits - 1}e}")
    return f"{rounded:.7g}" if 1e-4 <= abs(rounded) < 1e6 or not rounded else f"{rounded:g}"


def value_text(axis: MapAxis, value: float | str) -> str:
    """Write a coordinate with its unit."""
    if isinstance(value, str):
        return printable(value)
    return f"{plain(float(shown(axis, value)), 4 if axis.is_contrast else 3)} {axis_unit(axis)}".rstrip()


def at_text(at: At, axes: dict[str, MapAxis]) -> str:
    """Write the values of fixed parameters; those that the map does not vary are left out."""
    varied = [name for name in at if axes[name].values.size > 1]
    return ", ".join(f"{axis_name(axes[name])} {value_text(axes[name], at[name])}" for name in varied)


def ends_text(axis: MapAxis, interval: UsableInterval, n_digits: int = 4) -> str:
    """Write the ends of an interval, with up to a number of digits; an end of the map is a bound."""
    most = 4 if axis.is_contrast else 3
    digits = [most if end.is_open else min(most, n_digits) for end in interval.ends]
    ends = [plain(float(shown(axis, end.place)), n) for end, n in zip(interval.ends, digits, strict=True)]
    low, high = (sign if end.is_open else "" for sign, end in zip("≤≥", interval.ends, strict=True))
    return f"{low and f'{low} '}{ends[0]} to {high and f'{high} '}{ends[1]}"


def width_text(interval: UsableInterval) -> str:
    """Write the ratio of the ends of an interval, if it is meaningful."""
    if not isfinite(interval.decades):
        return ""
    known = all(end.resolved and not end.is_open for end in interval.ends)
    return f"{'' if known else 'at least '}{interval.decades:.2f} decades, {interval.range_db:.1f} dB"


def variable_column(dataset: Dataset, name: str) -> Column:
    """Describe a variable of a map; those of sweeps are known."""
    text = printable(str(dataset[name].attrs.get("long_name", "")))
    meaning = f"{text[0].upper()}{text[1:]}." if text else ""
    return VARIABLES.get(name) or Column(name, text or name.replace("_", " "), unit_of(dataset[name]), meaning)


def title(dataset: Dataset) -> str:
    """Title of a map."""
    return printable(str(dataset.attrs.get("title") or "Map of CDP"))


def conditions(dataset: Dataset) -> str:
    """Write in a line how the map was made and for which contrast."""
    attributes = dataset.attrs
    contrast, epsilon = (_number(attributes.get(name)) for name in ("contrast", "epsilon"))
    parts = [
        f"contrast {plain(100 * contrast, 4)} %" if isfinite(contrast) else "",
        f"tolerance ε {percent(epsilon)}" if isfinite(epsilon) else "",
        *(printable(str(attributes.get(name, ""))) for name in ("method", "position")),
    ]
    return ", ".join(part for part in parts if part)


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("nan")
