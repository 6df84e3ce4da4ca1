"""Tables and Dataset of the flare of a camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import hypot
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.quantity import Quantity
from ...core.table import Column, Table, uncertain
from ...metrics.stray_light import Flare, StrayLight, attenuation_db

if TYPE_CHECKING:
    from xarray import Dataset

#: Names of the stray light in each unit, with label and meaning.
FIGURES = {
    "light": ("stray light", "Stray light."),
    "intensity": ("over illuminance", "Pi times the stray luminance over the illuminance at the camera."),
    "normalised": ("over source", "Stray light over the light of the source itself."),
}
#: Most places that are listed, and least distance between two of them in blocks.
_MOST_PLACES, _APART = 8, 2.5
#: Least light of a ghost over its ring, and least excess in its u: of thousands of blocks none by chance.
_LEAST_EXCESS, _LEAST_SIGMAS = 1.1, 5.0


@dataclass(frozen=True)
class Place:
    """Stray light at a place.

    Parameters
    ----------
    name : str
        Which one.
    x_px, y_px, radius_px : float or None
        Where it is, and how far from the middle of the source; None for all places.
    over_ring : float or None
        Its light over that of the ring about the source; a ghost has much more than 1.
    figures : dict of str to Quantity
        Stray light by the names of `FIGURES`.
    """

    name: str
    x_px: float | None
    y_px: float | None
    radius_px: float | None
    over_ring: float | None
    figures: dict[str, Quantity]


def figures_of(flare: Flare) -> dict[str, StrayLight]:
    """Return the stray light in all units that it has, by their names in `FIGURES`.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import Roi
    >>> from labcdp.evaluate.flare.tables import figures_of
    >>> from labcdp.metrics import flare
    >>> list(figures_of(flare(np.ones((60, 80)), [Roi.rectangle("lamp", 30, 20, 10, 10)])))
    ['light']
    """
    named = {name: getattr(flare, name) for name in FIGURES}
    return {name: stray for name, stray in named.items() if stray is not None}


def flare_places(flare: Flare, ghosts: bool = False) -> list[Place]:
    """Return the blocks with the most stray light, none beside another one of them.

    Parameters
    ----------
    flare : Flare
        The flare.
    ghosts : bool
        Whether those count that exceed their ring about the source most: by a tenth, and by five of their u.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import Roi
    >>> from labcdp.evaluate.flare.tables import flare_places
    >>> from labcdp.metrics import flare
    >>> light = np.ones((64, 96))
    >>> light[48:64, 80:96] = 5.0
    >>> ghost = flare_places(flare(light, [Roi.rectangle("lamp", 16, 16, 16, 16)]))[0]
    >>> (ghost.x_px, ghost.y_px), ghost.figures["light"].value
    ((88.0, 56.0), 5.0)
    """
    values, u = flare.light.blocks.value, np.nan_to_num(flare.light.blocks.u)
    rows, columns = ((np.arange(size) + 0.5) * flare.block_px for size in values.shape)
    radius = np.hypot(columns - flare.centre_px[0], rows[:, None] - flare.centre_px[1])
    over_ring = flare.over_ring
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = values * (1 - 1 / over_ring)
        is_ghost = (over_ring > _LEAST_EXCESS) & (excess > _LEAST_SIGMAS * u)
    counted = np.isfinite(values) & (is_ghost if ghosts else True)
    rank = np.where(counted, over_ring if ghosts else values, np.nan)
    places: list[Place] = []
    taken: list[tuple[int, int]] = []
    for flat in np.argsort(-np.nan_to_num(rank, nan=-np.inf), axis=None, kind="stable").tolist():
        row, column = divmod(flat, values.shape[1])
        if len(places) == _MOST_PLACES or not np.isfinite(rank[row, column]):
            break
        if any(hypot(row - other[0], column - other[1]) < _APART for other in taken):
            continue
        taken.append((row, column))
        at_block = {
            name: Quantity(float(stray.blocks.value[row, column]), float(stray.blocks.u[row, column]))
            for name, stray in figures_of(flare).items()
        }
        places.append(
            Place(
                str(len(places) + 1), float(columns[column]), float(rows[row]), float(radius[row, column]),
                _known(over_ring[row, column]), at_block,
            )
        )  # fmt: skip
    return places


def flare_tables(flare: Flare, unit: str) -> tuple[Table, ...]:
    """Return the tables: mean and worst place, the brightest places, and the radial profile."""
    figures = figures_of(flare)
    x, y = flare.worst_px
    radius = hypot(x - flare.centre_px[0], y - flare.centre_px[1])
    both = [
        Place("mean beside the source", None, None, None, None, {name: stray.mean for name, stray in figures.items()}),
        Place("worst place", x, y, radius, None, {name: stray.worst for name, stray in figures.items()}),
    ]
    where = (
        Column("x_px", "x", "px", "Middle of the block.", decimals=0),
        Column("y_px", "y", "px", "Middle of the block.", decimals=0),
        Column("radius_px", "distance", "px", "Distance from the middle of the source.", decimals=0),
    )
    columns = tuple(_columns(figures, unit))
    note = f"Places are blocks of {flare.block_px} x {flare.block_px} pixels."
    first = Table.of_items("flare", "Flare", (Column("place", "place", value="name"), *where, *columns), both, note)
    ring = Column("over_ring", "over its ring", "", "Over the mean of its ring: a ghost has much more than 1.", 3)
    of_place = (Column("place", "place", "", "Its number.", value="name"), *where, *columns, ring)
    titles = {"places": "Places with the most stray light", "ghosts": "Places that exceed their ring most"}
    listed = (
        Table.of_items(name, title, of_place, flare_places(flare, ghosts=name == "ghosts"), note)
        for name, title in titles.items()
    )
    return first, *(table for table in listed if len(table)), _profile_table(flare, figures, unit)


def _known(value: Any, factor: float = 1.0) -> float | None:
    return factor * float(value) if np.isfinite(value) else None


def _key(name: str, unit: str) -> tuple[str, str, float]:
    """Name of the column of a stray light, its unit there, and its factor."""
    if name == "light":
        return "stray_light", "" if unit == "relative" else unit, 1.0
    return f"{name}_ppm", "ppm", 1e6


def _columns(figures: dict[str, StrayLight], unit: str) -> Iterator[Column]:
    """Yield the columns of the stray light of a place in all units."""
    for name in figures:
        label, meaning = FIGURES[name]
        key, shown_unit, factor = _key(name, unit)

        def part(attribute: str, name: str = name, factor: float = factor) -> Callable[[Place], float | None]:
            return lambda place: _known(getattr(place.figures[name], attribute), factor)

        yield from uncertain(Column(key, label, shown_unit, meaning, value=part("value")), part("u"), part("U"))
    if "normalised" in figures:
        yield Column(
            "attenuation_db", "attenuation", "dB", "10 log10 of the inverse of the stray light over the source.",
            decimals=1, value=lambda place: _known(attenuation_db(place.figures["normalised"].value)),
        )  # fmt: skip


def _profile_table(flare: Flare, figures: dict[str, StrayLight], unit: str) -> Table:
    columns = [Column("radius_px", "distance", "px", "Mean distance of a ring from the middle of the source.", 4)]
    data: dict[str, Any] = {"radius_px": flare.radius_px.tolist()}
    for name, stray in figures.items():
        label, meaning = FIGURES[name]
        key, shown_unit, factor = _key(name, unit)
        columns += uncertain(Column(key, label, shown_unit, meaning))
        for prefix, part in (("", "value"), ("expanded_", "U"), ("u_", "u")):
            data[f"{prefix}{key}"] = [_known(value, factor) for value in getattr(stray.profile, part)]
    return Table("profile", "Radial profile", tuple(replace(c, value="") for c in columns), data, detail=True)


def flare_dataset(flare: Flare, unit: str, attributes: dict[str, Any]) -> Dataset:
    """Return flare as a Dataset: maps of blocks over y and x, profiles over radius, mean and worst place.

    Parameters
    ----------
    flare : Flare
        The flare.
    unit : str
        Unit of its light.
    attributes : dict
        Attributes of the Dataset.
    """
    from xarray import Dataset

    data: dict[str, Any] = {}
    for name, stray in figures_of(flare).items():
        label, meaning = FIGURES[name]
        key = "stray_light" if name == "light" else name
        attrs = {"long_name": label, "description": meaning}
        attrs["units"] = "1" if name != "light" or unit == "relative" else unit.replace("²", "^2")
        for part, dims in (("blocks", ("y", "x")), ("profile", ("radius",)), ("mean", ()), ("worst", ())):
            quantity = getattr(stray, part)
            label_of = key if part == "blocks" else f"{key}_{part}"
            data[label_of], data[f"u_{label_of}"] = (dims, quantity.value, attrs), (dims, quantity.u, attrs)
    rows, columns = flare.light.blocks.value.shape
    pixels = {"units": "pixel"}
    coordinates = {
        "y": ("y", (np.arange(rows) + 0.5) * flare.block_px, pixels),
        "x": ("x", (np.arange(columns) + 0.5) * flare.block_px, pixels),
        "radius": ("radius", flare.radius_px, pixels),
    }
    where = {"source_x": flare.centre_px[0], "source_y": flare.centre_px[1]}
    where |= {"worst_x": flare.worst_px[0], "worst_y": flare.worst_px[1]}
    return Dataset(data, coordinates, attributes | where)
