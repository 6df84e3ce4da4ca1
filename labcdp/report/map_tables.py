"""What a map shows as a table for the terminal, and as values for machines."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from .map_parts import axes_of
from .map_wording import axis_name, interval_text, notes, value_text
from .tables import Table

if TYPE_CHECKING:
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis


def usable_table(dataset: Dataset, analysis: MapAnalysis) -> Table:
    """Make a table of the usable ranges of a map: a row for each value of the other parameters.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map.
    analysis : MapAnalysis
        Of the same map.

    Returns
    -------
    Table
        Without rows if the map has no axis of numbers.
    """
    axes = axes_of(dataset)
    others = [name for name in axes if name != analysis.x]
    high_enough = f"{axis_name(axes[analysis.x])} of CDP ≥ {analysis.level:g}"
    columns = (*(axis_name(axes[name]) for name in others), high_enough)
    rows = tuple(
        (
            *(value_text(axes[name], one.at[name]) for name in others),
            "; ".join(interval_text(axes[one.axis], interval) for interval in one.intervals) or "nowhere",
        )
        for one in analysis.usable_ranges
    )
    return Table(columns, rows)


def map_values(dataset: Dataset, analysis: MapAnalysis) -> dict[str, Any]:
    """Return how a map was made, its axes, and its analysis, for `labcdp.json_text.results_json`.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map.
    analysis : MapAnalysis
        Of the same map.

    Returns
    -------
    dict
        The map's attributes without the text of its chain, `axes` with unit and values by name, and the fields of
        `MapAnalysis`.
    """
    axes = {name: {"unit": axis.unit, "values": axis.values.tolist()} for name, axis in axes_of(dataset).items()}
    made = {str(name): _plain(value) for name, value in dataset.attrs.items() if name != "chain"}
    return {**made, "axes": axes, **asdict(analysis)}


def map_notes(dataset: Dataset, analysis: MapAnalysis) -> list[str]:
    """Tell the widest usable range of a map and its deepest dips, in a few sentences."""
    return notes(analysis, axes_of(dataset))


def _plain(value: Any) -> Any:
    """Return what NumPy holds as Python's own; a file gives its attributes as NumPy's."""
    return value.tolist() if hasattr(value, "tolist") else value
