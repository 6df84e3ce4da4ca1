"""Tables and Dataset of the sharpness of a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.quantity import Quantity
from ...core.table import Column, Table, attributes_of, uncertain, variables_of
from .measure import FieldEdge, MeasuredSharpness

if TYPE_CHECKING:
    from xarray import Dataset

_CYCLES = "cycles/pixel"
_NOTE = (
    "A vertical edge shows the sharpness along the rows, horizontal. U of an edge is by its rows; that of a mean is by "
    "the scatter from edge to edge, noise and field together."
)
#: Columns of an edge in the field.
_PLACE = (
    Column("edge", "edge", "", "Name of its region.", value="roi.name"),
    Column("direction", "direction", "", "Direction in which the sharpness is measured: across the edge.",
           value="sfr.direction"),
    Column("field", "field", "%", "Distance from the middle of the image over half its diagonal.", 3),
    Column("distance_px", "distance", "px", "Distance from the middle of the image.", 4, shown=False),
    Column("x_px", "x", "px", "Middle of the edge.", 5, shown=False),
    Column("y_px", "y", "px", "Middle of the edge.", 5, shown=False),
    Column("angle_deg", "angle", "°", "Angle between the edge and the columns or rows of pixels.", 3, shown=False,
           value="sfr.angle_deg"),
)  # fmt: skip


_PICTURE = Column("picture", "picture", "", "Name of the picture.")


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _quantity(column: Column, name: str, factor: float = 1.0) -> tuple[Column, ...]:
    """Columns of a quantity of the response, with U and u; none where it is not known."""

    def of(item: Any) -> Quantity:
        quantity: Quantity = getattr(item.sfr, name)
        return quantity

    shown = replace(column, value=lambda item: _known(factor * of(item).value))
    return uncertain(shown, lambda item: _known(factor * of(item).u), lambda item: _known(factor * of(item).U))


def _responses(pixel_pitch_m: float | None) -> tuple[Column, ...]:
    """Columns of what both an edge and a mean have."""
    in_mm: tuple[Column, ...] = ()
    if pixel_pitch_m is not None:
        meaning = "Spatial frequency on the sensor at which the response is 50 %."
        in_mm = _quantity(Column("mtf50_lp_mm", "MTF50", "lp/mm", meaning), "mtf50", 1e-3 / pixel_pitch_m)
    return (
        *_quantity(Column("mtf50", "MTF50", _CYCLES, "Spatial frequency at which the response is 50 %."), "mtf50"),
        *_quantity(Column("mtf10", "MTF10", _CYCLES, "Spatial frequency at which the response is 10 %."), "mtf10"),
        *in_mm,
        *_quantity(Column("overshoot", "overshoot", "%", "Excess over the bright side, in steps."), "overshoot"),
        *_quantity(Column("undershoot", "undershoot", "%", "Excess below the dark side, in steps.", shown=False),
                   "undershoot"),
    )  # fmt: skip


def sharpness_tables(measured: MeasuredSharpness) -> tuple[Table, ...]:
    """Return the tables: means, edges, the response over the frequency, and the MTF of the lens."""
    columns = _responses(measured.pixel_pitch_m)
    of_means = (
        Column("edges", "edges", "", "All, or those that show the sharpness in one direction.", value="name"),
        Column("n_edges", "number", "", "Number of these edges.", 0),
        *columns,
    )
    tables = [Table.of_items("sharpness", "Sharpness", of_means, measured.means, _NOTE)]
    place: tuple[Column, ...] = _PLACE
    if measured.over_pictures:
        of_pictures = (_PICTURE, of_means[1], *columns)
        note = "U of a picture is by the scatter of its edges: to compare pictures, compare the same edge."
        pictures = [replace(_PICTURE, value="name"), *of_pictures[1:]]
        tables.append(Table.of_items("pictures", "Pictures", pictures, measured.over_pictures, note))
        place = (_PLACE[0], _PICTURE, *_PLACE[1:])
    tables += [Table.of_items("edges", "Edges", (*place, *columns), measured.edges), _response_table(measured)]
    if measured.mtf:
        frequency = Column("lp_per_mm", "frequency", "lp/mm", "Spatial frequency on the sensor, in line pairs per mm.")
        modulation = Column("modulation", "modulation", "", "MTF of the lens, without the pixels.", decimals=4)
        data = dict(zip(("lp_per_mm", "modulation"), map(list, zip(*measured.mtf, strict=True)), strict=True))
        title = "MTF of the lens, as a chain file takes it"
        tables.append(Table("mtf", title, (frequency, modulation), data, detail=True))
    return tuple(tables)


def _response_table(measured: MeasuredSharpness) -> Table:
    mean = measured.means[0].sfr
    columns = (
        Column("frequency", "frequency", _CYCLES, "Spatial frequency.", decimals=4),
        *uncertain(Column("response", "mean", "", "Mean of the responses of all edges.", decimals=4)),
        *(Column(f"response_{n}", edge.name, "", "Response of this edge.", decimals=4)
          for n, edge in enumerate(measured.edges, 1)),
    )  # fmt: skip
    data = {
        "frequency": mean.frequency.tolist(),
        "response": mean.response.value.tolist(),
        "expanded_response": np.asarray(mean.response.U).tolist(),
        "u_response": np.asarray(mean.response.u).tolist(),
        **{f"response_{n}": edge.sfr.response.value.tolist() for n, edge in enumerate(measured.edges, 1)},
    }
    return Table("response", "Spatial frequency response", columns, data, detail=True)


def sharpness_dataset(edges: Sequence[FieldEdge], attributes: dict[str, Any]) -> Dataset:
    """Return the edges as a Dataset: responses over edge and frequency, MTF50, MTF10, excess and place over edge.

    Parameters
    ----------
    edges : sequence of FieldEdge
        At least one.
    attributes : dict
        Attributes of the Dataset.
    """
    from xarray import Dataset

    # Each by itself: u stays, U follows.
    columns = [c for c in (*_PLACE[1:], *_responses(None)) if not c.name.startswith("expanded_")]
    kept = tuple(replace(column, expanded="") for column in columns)
    responses = {
        name: (("edge", "frequency"), np.array([getattr(edge.sfr.response, part) for edge in edges]), {"units": "1"})
        for name, part in (("response", "value"), ("u_response", "u"))
    }
    frequency = edges[0].sfr.frequency
    column = Column("frequency", "spatial frequency", _CYCLES, "Spatial frequency across the edge.")
    coordinates = {
        "edge": [edge.name for edge in edges],
        "frequency": ("frequency", frequency, attributes_of(column, frequency)),
    }
    return Dataset(variables_of(kept, ("edge",), edges) | responses, coordinates, attributes)
