"""Results of a video's frames as one Dataset, whole or in blocks of frames, and what each of its variables is."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk import parse_json
from ...core.disk.journal import Row
from ...core.disk.text import json_values
from ...core.errors import InputError
from ...core.result import Finding
from ...core.table import Column, attributes_of
from ..columns import CDP, CONTRAST, CSNR, SHARES, TARGET, by_itself, invalid_share, region_columns

if TYPE_CHECKING:
    from xarray import Dataset


#: Stands for the unit of the video's means: cd/m² or none.
LIGHT = "light"
#: Over frame and contrast; taken from a `Cdp`.
OF_CONTRAST = by_itself(*CDP, *SHARES)
#: Over frame; taken from a `Pair`.
OF_PAIR = by_itself(*CONTRAST, *CSNR)
#: Over frame; taken from the `Cdp` of the reference contrast.
OF_REFERENCE = tuple(
    replace(one, name=f"reference_{one.name}", label=one.label.replace("CDP", "CDP of reference"))
    for one in by_itself(
        replace(TARGET, label="reference contrast", meaning="Contrast the frame is compared with."), *CDP
    )
    if one.name != "u_cdp"
)
OF_FRAME = (*OF_PAIR, *OF_REFERENCE)
#: Over frame and region; taken from a `RegionLight`.
OF_LIGHT = tuple(
    one
    for one in by_itself(*region_columns(LIGHT), invalid_share("saturated"))
    if one.name in ("mean", "u_mean", "snr", "u_snr", "saturated")
)
#: Over frame and region; taken from a `TrackedRoi`.
OF_PLACE = (
    Column("quality", "tracking quality", "", "Quality of the tracking, 0 to 1.", decimals=3,
           value=lambda one: float(one.quality)),
    Column("lost", "lost", "", "Whether the region was lost: 1 or 0.", decimals=0, value=lambda one: bool(one.lost)),
    Column("centre_x", "centre x", "pixel", "Centre of the region, to the right.", decimals=2, value="roi.centre.0"),
    Column("centre_y", "centre y", "pixel", "Centre of the region, down.", decimals=2, value="roi.centre.1"),
)  # fmt: skip
OF_REGION = (*OF_LIGHT, *OF_PLACE)
#: Over frame, region and corner; taken from a `TrackedRoi`.
OF_CORNER = (
    Column("corner_x", "x", "pixel", "Corners of the region, to the right.", decimals=2,
           value=lambda one: [x for x, _ in one.roi.corners]),
    Column("corner_y", "y", "pixel", "Corners of the region, down.", decimals=2,
           value=lambda one: [y for _, y in one.roi.corners]),
)  # fmt: skip
TIME = Column("time_s", "time", "s", "Time since the first frame.", decimals=3)
NOTE = Column("note", "note", meaning="Why a value is missing, or a warning about it.")
FINDINGS = Column("findings", "findings", meaning="The notes with code, subject and values, as JSON.")


def names(columns: tuple[Column, ...]) -> tuple[str, ...]:
    """Return the names of columns."""
    return tuple(column.name for column in columns)


def as_json(values: Any) -> str:
    """Attribute of a dataset that holds more than a text or a number."""
    return json.dumps(json_values(values), ensure_ascii=False, sort_keys=True)


def recorded(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Return findings as values JSON can hold."""
    return [
        {"code": one.code, "severity": one.severity, "subject": one.subject, "values": dict(one.values)}
        for one in findings
    ]


def restored(values: Iterable[Mapping[str, Any]]) -> tuple[Finding, ...]:
    """Return findings as they were before `recorded`."""
    return tuple(Finding(**one) for one in values)


#: Frames of a block.
BLOCK = 1000
#: Shown as "frame" and "contrast" in the Dataset.
_AXES = ("frame", "contrast")


@dataclass(frozen=True, eq=False)
class VideoRows:
    """Results of a video's frames, which are read when they are needed.

    Parameters
    ----------
    read : callable
        Begins to read the rows, one a frame, by the names of the variables.
    contrasts : tuple of float
        In the order of each row's lists.
    regions : tuple of str
        Names in the order of each row's lists; none for nearest neighbours.
    order : tuple of int
        Places of the regions in the Dataset: the one that is brighter in the first frame that was measured comes first.
    n_corners : int
        Most corners of a region.
    unit : str
        Of the means.
    attrs : mapping
        Attributes of the Dataset.
    """

    read: Callable[[], Iterator[Row]]
    contrasts: tuple[float, ...]
    regions: tuple[str, ...]
    order: tuple[int, ...]
    n_corners: int
    unit: str
    attrs: Mapping[str, Any]

    def dataset(self) -> Dataset:
        """Return all frames."""
        return self._joined(list(self.read()))

    def blocks(self) -> Iterator[Dataset]:
        """Iterate over blocks of frames; memory does not grow with the video."""
        rows = self.read()
        while block := list(islice(rows, BLOCK)):
            yield self._joined(block)

    def _joined(self, rows: Sequence[Row]) -> Dataset:
        import xarray as xr

        def values(column: Column, *shape: int) -> NDArray[np.float64]:
            return np.array([row[column.name] for row in rows], dtype=float).reshape(len(rows), *shape)

        texts = [
            (column, ("frame",), np.array([row[column.name] for row in rows], object)) for column in (NOTE, FINDINGS)
        ]
        found: list[tuple[Column, tuple[str, ...], NDArray[Any]]] = [
            *((column, _AXES, values(column, len(self.contrasts))) for column in OF_CONTRAST),
            (TIME, ("frame",), values(TIME)),
        ]
        coordinates: dict[str, Any] = {"frame": [row["frame"] for row in rows], "contrast": list(self.contrasts)}
        if self.regions:
            n, order = len(self.regions), list(self.order)
            found += [(column, ("frame",), values(column)) for column in OF_FRAME]
            found += [(column, ("frame", "region"), values(column, n)[:, order]) for column in OF_REGION]
            found += [(column, ("frame", "region", "corner"), self._corners(rows, column)) for column in OF_CORNER]
            coordinates["region"] = np.array([self.regions[place] for place in order], dtype=object)
        data = {}
        for column, axes, array in (*found, *texts):
            unit = self.unit if column.unit == LIGHT else column.unit
            array = array.astype(bool) if column.name == "lost" else array
            data[column.name] = (axes, array, attributes_of(replace(column, unit=unit), array))
        return xr.Dataset(data, coordinates, dict(self.attrs)).set_coords(TIME.name)

    def _corners(self, rows: Sequence[Row], column: Column) -> NDArray[np.float64]:
        array = np.full((len(rows), len(self.regions), self.n_corners), nan)
        for place, row in enumerate(rows):
            for region, corners in enumerate(row[column.name]):
                array[place, region, : len(corners)] = corners
        return array[:, list(self.order)]


def blocks_of(dataset: Dataset) -> Iterator[Dataset]:
    """Iterate over blocks of the frames of a Dataset; one that is read from a file is loaded block by block."""
    for start in range(0, dataset.sizes["frame"], BLOCK):
        yield dataset.isel(frame=slice(start, start + BLOCK)).load()


def findings_of(block: Dataset) -> list[tuple[Finding, ...]]:
    """Return the findings about each frame."""
    if FINDINGS.name not in block:
        return [()] * block.sizes["frame"]
    return [restored(parse_json(str(text), allow_nan=True)) if text else () for text in block[FINDINGS.name].values]


def check_video(dataset: Dataset) -> None:
    """Refuse a Dataset that is no result of a video.

    Raises
    ------
    InputError
        If a variable every video has is missing or has other axes, or there is no frame.
    """
    for name in names(OF_CONTRAST):
        if name not in dataset.data_vars or dataset[name].dims != _AXES:
            raise InputError(f"the results have no variable {name} over frame and contrast: give results of a video")
    for axis in _AXES:
        if axis not in dataset.coords:
            raise InputError(f"axis {axis} of the results has no coordinates: give results of a video")
        if dataset.sizes[axis] == 0:
            raise InputError(f"the results have no {axis}: evaluate at least one")
