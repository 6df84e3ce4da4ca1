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
from ...core.errors import InputError
from ...core.result import Finding
from ...core.table import Column, values_of

if TYPE_CHECKING:
    from xarray import Dataset


def _with_u(column: Column, decimals: int, parts: Sequence[str] = ("value", "standard_error")) -> tuple[Column, ...]:
    """Columns of an estimate, taken from the column's value, and of its standard uncertainty."""
    path = f"{column.value}." if column.value else ""
    name, what = f"{column.name}_standard_uncertainty", f"Standard uncertainty of the {column.label}."
    u = Column(name, f"u of {column.label}", column.unit, what, decimals=decimals, value=path + parts[1])
    return replace(column, value=path + parts[0]), u


#: Stands for the unit of the video's means: cd/m² or none.
LIGHT = "light"
_LOW, _HIGH = (f"{end} end of the 95 % interval of the CDP." for end in ("Lower", "Upper"))
#: Over frame and contrast; taken from a `CalibratedCdp`.
OF_CONTRAST = (
    Column("cdp", "CDP", "", "Contrast detection probability.", decimals=4, value="result.cdp"),
    Column("cdp_standard_uncertainty", "u of CDP", "", "Standard uncertainty of the CDP.", decimals=4,
           value="standard_uncertainty"),
    Column("cdp_low", "CDP, low end of 95 %", "", _LOW, decimals=4, value="confidence_interval.0"),
    Column("cdp_high", "CDP, high end of 95 %", "", _HIGH, decimals=4, value="confidence_interval.1"),
    Column("below", "share below", "", "Share of pairs with a lower contrast.", decimals=4, value="result.below"),
    Column("above", "share above", "", "Share of pairs with a higher contrast.", decimals=4, value="result.above"),
)  # fmt: skip
#: Over frame; taken from a `PairResult`.
OF_PAIR = (
    *_with_u(Column("measured_contrast", "measured contrast", "%", "Weber contrast of the regions' means.", decimals=2,
                    value="contrast"), 2),
    *_with_u(Column("csnr", "CSNR", "", "Contrast signal-to-noise ratio.", decimals=2, value="csnr"), 3),
)  # fmt: skip
#: Over frame; taken from the `CalibratedCdp` of the reference contrast.
OF_REFERENCE = (
    Column("reference_contrast", "reference contrast", "%", "Contrast the frame is compared with.", decimals=2,
           value="result.contrast"),
    Column("reference_cdp", "CDP of reference", "", "CDP of the reference contrast.", decimals=4, value="result.cdp"),
    Column("reference_cdp_low", "CDP of reference, low end of 95 %", "", "Lower end of its 95 % interval.", decimals=4,
           value="confidence_interval.0"),
    Column("reference_cdp_high", "CDP of reference, high end of 95 %", "", "Upper end of its 95 % interval.",
           decimals=4, value="confidence_interval.1"),
)  # fmt: skip
OF_FRAME = (*OF_PAIR, *OF_REFERENCE)
#: Over frame and region; taken from a `RegionResult`.
OF_LIGHT = (
    *_with_u(Column("mean", "mean", LIGHT, "Mean of the region.", decimals=4), 5, ("mean", "standard_uncertainty")),
    *_with_u(Column("snr", "spatial SNR", "", "Mean over standard deviation of the pixels of the frame.", decimals=2,
                    value="snr"), 3),
    Column("saturated", "share saturated", "", "Share of saturated pixels.", decimals=4,
           value=lambda region: region.invalid_shares.get("saturated", 0.0)),
)  # fmt: skip
#: Over frame and region; taken from a `TrackedRoi`.
OF_PLACE = (
    Column("quality", "tracking quality", "", "Quality of the tracking, 0 to 1.", decimals=3,
           value=lambda one: float(one.quality)),
    Column("lost", "lost", "", "Whether the region was lost: 1 or 0.", decimals=0, value=lambda one: bool(one.lost)),
    Column("centre_x", "centre x", "pixel", "Middle of the region, to the right.", decimals=2, value="roi.centre.0"),
    Column("centre_y", "centre y", "pixel", "Middle of the region, down.", decimals=2, value="roi.centre.1"),
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


def taken(columns: tuple[Column, ...], items: Sequence[Any]) -> Row:
    """Return the values of columns, each a list with one for each item."""
    return values_of(columns, items)


def as_json(values: Any) -> str:
    """Attribute of a dataset that holds more than a text or a number."""
    return json.dumps(values, ensure_ascii=False, sort_keys=True)


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
            unit = {LIGHT: self.unit, "%": ""}.get(column.unit, column.unit)
            attributes = {"long_name": column.meaning.rstrip("."), "units": unit}
            array = array.astype(bool) if column.name == "lost" else array
            data[column.name] = (axes, array, {name: text for name, text in attributes.items() if text})
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
