"""What pictures, page and spreadsheet of a map call its axes, variables, ranges and dips."""

from __future__ import annotations

from math import isfinite, isnan, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from ..evaluate.map_axes import At, MapAxis
from .digits import printable, significant

if TYPE_CHECKING:
    from xarray import Dataset

    from ..evaluate.map_dips import SnrDip
    from ..evaluate.map_ranges import UsableInterval
    from ..evaluate.maps import MapAnalysis

#: Short names of the variables that every sweep has; their own are too long for legends and heads of columns.
_NAMES = {
    "cdp": "CDP",
    "standard_error": "standard error of CDP",
    "below": "share of pairs below the interval",
    "above": "share of pairs above the interval",
    "mean_contrast": "mean contrast",
    "csnr": "CSNR",
    "snr_dark": "SNR, dark region",
    "snr_bright": "SNR, bright region",
    "snr_dark_standard_error": "standard error of SNR, dark region",
    "snr_bright_standard_error": "standard error of SNR, bright region",
    "saturated_share": "saturated share, bright region",
}


#: Parts of units as they are typed, and as they are printed.
_PRINTED = {"^2": "²", "^3": "³", "m2": "m²", "degC": "°C"}

#: More dips than this are not listed below a picture.
_MOST_DIPS = 6


def unit_text(unit: str) -> str:
    """Write a unit as in print; a plain ratio has none."""
    if unit in ("", "1"):
        return ""
    printed = printable(unit)
    for typed, written in _PRINTED.items():
        printed = printed.replace(typed, written)
    return printed


def axis_name(axis: MapAxis) -> str:
    """Name an axis for people."""
    return printable(axis.long_name or axis.name.rpartition(".")[2].replace("_", " "))


def axis_label(axis: MapAxis) -> str:
    """Label an axis, with its unit; contrasts are in percent."""
    unit = "%" if axis.is_contrast else unit_text(axis.unit)
    return f"{axis_name(axis)} in {unit}" if unit else axis_name(axis)


def shown(axis: MapAxis, values: Any) -> Any:
    """Return coordinates as they are drawn: contrasts in percent."""
    return 100 * np.asarray(values) if axis.is_contrast else np.asarray(values)


def plain(value: float, n_digits: int = 3) -> str:
    """Write a value with so many digits, 0 to 999999 without a power of ten, and no zeros at its end."""
    rounded = float(f"{value:.{n_digits - 1}e}")
    return f"{rounded:.7g}" if 1e-4 <= abs(rounded) < 1e6 or not rounded else f"{rounded:g}"


def value_text(axis: MapAxis, value: float | str) -> str:
    """Write a coordinate with its unit."""
    if isinstance(value, str):
        return printable(value)
    if axis.is_contrast:
        return f"{plain(100 * value, 4)} %"
    unit = unit_text(axis.unit)
    number = plain(value)
    return f"{number} {unit}" if unit else number


def at_text(at: At, axes: dict[str, MapAxis]) -> str:
    """Write the values of fixed parameters; those that the map does not vary are left out."""
    parts = [
        f"{axis_name(axes[name])} {value_text(axes[name], value)}"
        for name, value in at.items()
        if axes[name].values.size > 1
    ]
    return ", ".join(parts)


def variable_name(dataset: Dataset, name: str) -> str:
    """Name a variable of a map for people, with its unit if it has one."""
    attributes = dataset[name].attrs
    text = printable(str(_NAMES.get(name) or attributes.get("long_name") or name.replace("_", " ")))
    unit = unit_text(str(attributes.get("unit", "")))
    return f"{text} in {unit}" if unit else text


def title(dataset: Dataset) -> str:
    """Title of a map."""
    return printable(str(dataset.attrs.get("title") or "Map of CDP"))


def conditions(dataset: Dataset) -> str:
    """Say in a line how the map was made and for which contrast."""
    attributes = dataset.attrs
    parts = []
    contrast, epsilon = (_number(attributes.get(name)) for name in ("contrast", "epsilon"))
    if isfinite(contrast):
        parts.append(f"contrast {plain(100 * contrast, 4)} %")
    if isfinite(epsilon):
        parts.append(f"tolerance ε {epsilon:g}")
    method = printable(str(attributes.get("method", "")))
    if method:
        parts.append(f"method: {method}")
    position = printable(str(attributes.get("position", "")))
    if position:
        parts.append(position)
    error = largest_error(dataset)
    if isfinite(error):
        parts.append(f"largest standard error of CDP {significant(error, 2)}")
    return ", ".join(parts)


def largest_error(dataset: Dataset) -> float:
    """Largest standard error of CDP; nan if the map is exact or does not tell."""
    if "standard_error" not in dataset:
        return nan
    errors = dataset["standard_error"].values
    errors = errors[np.isfinite(errors)]
    return float(errors.max()) if errors.size else nan


def interval_text(axis: MapAxis, interval: UsableInterval) -> str:
    """Write an interval with its ratio, if that tells something; what the map does not show of an end is not told.

    An end of the map is a bound; an end between two grid points of very different CDP is only known to be there.
    """
    start = _end_text(axis, interval.low, "≤ " if interval.low_open else "")
    end = _end_text(axis, interval.high, "≥ " if interval.high_open else "")
    if not interval.low_resolved:
        start = f"from {_between(axis, interval.low_bracket)}"
    if not interval.high_resolved:
        end = _between(axis, interval.high_bracket)
    unit = "%" if axis.is_contrast else unit_text(axis.unit)
    text = f"{start} to {end}{unit and ' '}{unit}"
    if not isfinite(interval.decades):
        return text
    known = interval.low_resolved and interval.high_resolved and not (interval.low_open or interval.high_open)
    return f"{text} ({'' if known else 'at least '}{interval.decades:.2f} decades, {interval.range_db:.1f} dB)"


def _end_text(axis: MapAxis, value: float, bound: str = "") -> str:
    return f"{bound}{plain(float(shown(axis, value)), 4 if axis.is_contrast else 3)}"


def _between(axis: MapAxis, bracket: tuple[float, float]) -> str:
    return f"between {_end_text(axis, bracket[0])} and {_end_text(axis, bracket[1])}"


def widest_text(analysis: MapAnalysis, axes: dict[str, MapAxis]) -> str:
    """Say in a line over which range CDP is high enough, where that is widest."""
    one = analysis.widest
    if one is None or one.widest is None:
        return f"CDP is nowhere as high as {analysis.level:g}"
    where = at_text(one.at, axes)
    what = "widest usable range" if where or len(one.intervals) > 1 else "usable range"
    return f"{what} (CDP ≥ {one.level:g}){where and f', at {where}'}: {interval_text(axes[one.axis], one.widest)}"


def dip_text(dip: SnrDip, axes: dict[str, MapAxis], axis: MapAxis) -> str:
    """Write a dip in a line."""
    if dip.variable == "cdp":
        depth = f"from {dip.highest:.3g} to {dip.highest / dip.depth_ratio:.3g}"
    else:
        depth = f"{dip.depth_db:.1f} dB" if isfinite(dip.depth_db) else "to zero"
    where = at_text(dip.at, axes)
    name = _NAMES.get(dip.variable, dip.variable)
    text = f"dip of {name} at {value_text(axis, dip.position)}{where and f', {where}'}: {depth}"
    if isfinite(dip.recovery):
        text += f", recovered at {value_text(axis, dip.recovery)}"
    if dip.variable != "cdp" and isfinite(dip.lowest_cdp):
        text += f", lowest CDP {dip.lowest_cdp:.3g}"
    if isfinite(dip.expected):
        text += f"; change of exposure at {value_text(axis, dip.expected)}"
    return text


def notes(analysis: MapAnalysis, axes: dict[str, MapAxis]) -> list[str]:
    """Say in a few lines what the map shows: usable ranges, then dips, those of most weight first."""
    if not analysis.usable_ranges:
        return []
    several = len(analysis.usable_ranges) > 1
    lines = [widest_text(analysis, axes)]
    for variable in analysis.dip_variables:
        dips = sorted((dip for dip in analysis.dips if dip.variable == variable), key=lambda dip: -dip.depth_db)
        deepest = dips[: 1 if several else _MOST_DIPS]
        lines += [dip_text(dip, axes, axes[analysis.x]) for dip in sorted(deepest, key=lambda dip: dip.position)]
        if len(dips) > len(deepest):
            more = len(dips) - len(deepest)
            lines.append(f"and {more} more dip{'s' if more > 1 else ''} of {_NAMES[variable]}, not deeper")
    return lines


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return nan


def provenance(dataset: Dataset) -> list[tuple[str, str]]:
    """Attributes of a map for people, without its title, the text of its chain, and what is nan."""
    return [
        (printable(str(name)).replace("_", " "), printable(str(value)))
        for name, value in dataset.attrs.items()
        if name not in ("title", "chain") and not (isinstance(value, float) and isnan(value))
    ]
