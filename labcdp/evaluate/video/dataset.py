"""Results of a video's frames as one Dataset, whole or in blocks of frames."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk import parse_json
from ...core.errors import InputError
from ...core.result import Finding
from ...core.table import Column
from .findings import restored

if TYPE_CHECKING:
    from xarray import Dataset

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

    read: Callable[[], Iterator[Mapping[str, Any]]]
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

    def _joined(self, rows: Sequence[Mapping[str, Any]]) -> Dataset:
        import xarray as xr

        def values(column: Column, *shape: int) -> NDArray[np.float64]:
            return np.array([row[column.name] for row in rows], dtype=float).reshape(len(rows), *shape)

        data: dict[str, Any] = {column.name: (_AXES, values(column, len(self.contrasts))) for column in OF_CONTRAST}
        if self.regions:
            n, order = len(self.regions), list(self.order)
            data |= {column.name: ("frame", values(column)) for column in OF_FRAME}
            data |= {column.name: (("frame", "region"), values(column, n)[:, order]) for column in OF_REGION}
            data["lost"] = (data["lost"][0], data["lost"][1].astype(bool))
            data |= {column.name: (("frame", "region", "corner"), self._corners(rows, column)) for column in OF_CORNER}
        for column in (NOTE, FINDINGS):
            data[column.name] = ("frame", np.array([row[column.name] for row in rows], dtype=object))
        coordinates: dict[str, Any] = {
            "frame": np.array([row["frame"] for row in rows], dtype=np.int64),
            "contrast": np.array(self.contrasts),
            TIME.name: ("frame", values(TIME)),
        }
        if self.regions:
            coordinates["region"] = np.array([self.regions[place] for place in self.order], dtype=object)
        dataset = xr.Dataset(data, coordinates, dict(self.attrs))
        for column in (*OF_CONTRAST, *OF_FRAME, *OF_REGION, *OF_CORNER, NOTE, FINDINGS, TIME):
            if column.name in dataset.variables:
                unit = {LIGHT: self.unit, "%": ""}.get(column.unit, column.unit)
                attributes = {"long_name": column.meaning.rstrip("."), "units": unit}
                dataset[column.name].attrs |= {name: text for name, text in attributes.items() if text}
        return dataset

    def _corners(self, rows: Sequence[Mapping[str, Any]], column: Column) -> NDArray[np.float64]:
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


def as_json(values: Any) -> str:
    """Attribute of a dataset that holds more than a text or a number."""
    return json.dumps(values, ensure_ascii=False, sort_keys=True)


def _column(name: str, label: str, unit: str, decimals: int, meaning: str) -> Column:
    return Column(name, label, unit, meaning, decimals=decimals)


#: Stands for the unit of the video's means: cd/m² or none.
LIGHT = "light"
#: Over frame and contrast.
OF_CONTRAST = (
    _column("cdp", "CDP", "", 4, "Contrast detection probability."),
    _column("cdp_standard_uncertainty", "u of CDP", "", 4, "Standard uncertainty of the CDP."),
    _column("cdp_low", "CDP, low end of 95 %", "", 4, "Lower end of the 95 % interval of the CDP."),
    _column("cdp_high", "CDP, high end of 95 %", "", 4, "Upper end of the 95 % interval of the CDP."),
    _column("below", "share below", "", 4, "Share of pairs with a lower contrast."),
    _column("above", "share above", "", 4, "Share of pairs with a higher contrast."),
)
#: Over frame.
OF_FRAME = (
    _column("measured_contrast", "measured contrast", "%", 2, "Weber contrast of the regions' means."),
    _column(
        *("measured_contrast_standard_uncertainty", "u of measured contrast", "%", 2),
        "Standard uncertainty of the contrast.",
    ),
    _column("csnr", "CSNR", "", 2, "Contrast signal-to-noise ratio."),
    _column("csnr_standard_uncertainty", "u of CSNR", "", 3, "Standard uncertainty of the CSNR."),
    _column("reference_contrast", "reference contrast", "%", 2, "Contrast the frame is compared with."),
    _column("reference_cdp", "CDP of reference", "", 4, "Contrast detection probability of the reference contrast."),
    _column("reference_cdp_low", "CDP of reference, low end of 95 %", "", 4, "Lower end of its 95 % interval."),
    _column("reference_cdp_high", "CDP of reference, high end of 95 %", "", 4, "Upper end of its 95 % interval."),
)
#: Over frame and region.
OF_REGION = (
    _column("mean", "mean", LIGHT, 4, "Mean of the region."),
    _column("mean_standard_uncertainty", "u of mean", LIGHT, 5, "Standard uncertainty of the mean."),
    _column("snr", "spatial SNR", "", 2, "Mean over standard deviation of the pixels of the frame."),
    _column("snr_standard_uncertainty", "u of spatial SNR", "", 3, "Standard uncertainty of the spatial SNR."),
    _column("saturated", "share saturated", "", 4, "Share of saturated pixels."),
    _column("quality", "tracking quality", "", 3, "Quality of the tracking, 0 to 1."),
    _column("lost", "lost", "", 0, "Whether the region was lost: 1 or 0."),
    _column("centre_x", "centre x", "pixel", 2, "Middle of the region, to the right."),
    _column("centre_y", "centre y", "pixel", 2, "Middle of the region, down."),
)
#: Over frame, region and corner.
OF_CORNER = (
    _column("corner_x", "x", "pixel", 2, "Corners of the region, to the right."),
    _column("corner_y", "y", "pixel", 2, "Corners of the region, down."),
)
TIME = _column("time_s", "time", "s", 3, "Time since the first frame.")
NOTE = Column("note", "note", meaning="Why a value is missing, or a warning about it.")
FINDINGS = Column("findings", "findings", meaning="The notes with code, subject and values, as JSON.")


def names(columns: tuple[Column, ...]) -> tuple[str, ...]:
    """Return the names of columns."""
    return tuple(column.name for column in columns)
