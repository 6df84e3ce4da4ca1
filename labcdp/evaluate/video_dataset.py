"""Results of a video's frames as one dataset."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from math import isnan, nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from xarray import Dataset

#: Variables over frame and contrast; over frame; over frame and region.
BY_CONTRAST = ("cdp", "cdp_standard_uncertainty", "cdp_low", "cdp_high", "below", "above")
BY_FRAME = (
    "measured_contrast",
    "measured_contrast_standard_uncertainty",
    "csnr",
    "csnr_standard_uncertainty",
    "reference_contrast",
    "reference_cdp",
    "reference_cdp_low",
    "reference_cdp_high",
)
BY_REGION = (
    "mean",
    "mean_standard_uncertainty",
    "snr",
    "snr_standard_uncertainty",
    "saturated",
    "quality",
    "centre_x",
    "centre_y",
)
#: Share of saturated pixels above which a contrast of a region is not to be trusted.
TOO_SATURATED = 0.01
_CORNERS = ("corner_x", "corner_y")

_TITLES = {
    "cdp": "contrast detection probability",
    "cdp_standard_uncertainty": "standard uncertainty of the CDP",
    "cdp_low": "lower end of the 95 % interval of the CDP",
    "cdp_high": "upper end of the 95 % interval of the CDP",
    "below": "share of pairs with a lower contrast",
    "above": "share of pairs with a higher contrast",
    "measured_contrast": "Weber contrast of the regions' means",
    "measured_contrast_standard_uncertainty": "standard uncertainty of the contrast",
    "csnr": "contrast signal-to-noise ratio",
    "csnr_standard_uncertainty": "standard uncertainty of the contrast signal-to-noise ratio",
    "reference_contrast": "contrast the frame is compared with",
    "reference_cdp": "contrast detection probability of the reference contrast",
    "reference_cdp_low": "lower end of its 95 % interval",
    "reference_cdp_high": "upper end of its 95 % interval",
    "mean": "mean of the region",
    "mean_standard_uncertainty": "standard uncertainty of the mean",
    "snr": "signal-to-noise ratio",
    "snr_standard_uncertainty": "standard uncertainty of the signal-to-noise ratio",
    "saturated": "share of saturated pixels",
    "quality": "quality of the tracking, 0 to 1",
    "lost": "whether the region was lost",
    "centre_x": "middle of the region, to the right",
    "centre_y": "middle of the region, down",
    "corner_x": "corners of the region, to the right",
    "corner_y": "corners of the region, down",
    "note": "why a value is missing, or what to mind about it",
    "time_s": "time since the first frame",
}
_PIXELS = ("centre_x", "centre_y", *_CORNERS)


@dataclass(frozen=True)
class DatasetFrame:
    """What the rows of a video have in common.

    Parameters
    ----------
    contrasts : tuple of float
        In the order of each row's lists.
    regions : tuple of str
        Names in the order of each row's lists; none from pixel to pixel.
    unit : str
        Of the means.
    attrs : mapping
        Attributes of the dataset.
    """

    contrasts: tuple[float, ...]
    regions: tuple[str, ...]
    unit: str
    attrs: Mapping[str, Any]


def video_dataset(rows: Iterable[Mapping[str, Any]], about: DatasetFrame) -> Dataset:
    """Join rows to a dataset; the region that is brighter in the first frame that was measured comes first.

    Parameters
    ----------
    rows : iterable of mapping
        One a frame, by the names of the variables; read one by one.
    about : DatasetFrame
        What they have in common.

    Returns
    -------
    xarray.Dataset
    """
    import xarray as xr

    columns: dict[str, list[Any]] = {}
    for row in rows:
        for name, value in row.items():
            columns.setdefault(name, []).append(value)
    numbers = np.array(columns.get("frame", []), dtype=np.int64)
    data: dict[str, Any] = {
        name: (("frame", "contrast"), _array(columns, name, len(about.contrasts))) for name in BY_CONTRAST
    }
    if about.regions:
        order = _bright_first(columns["mean"])
        n = len(about.regions)
        data |= {name: (("frame",), _array(columns, name)) for name in BY_FRAME}
        data |= {name: (("frame", "region"), _array(columns, name, n)[:, order]) for name in BY_REGION}
        data["lost"] = (("frame", "region"), _array(columns, "lost", n)[:, order].astype(bool))
        most = max((len(corners) for corners in chain.from_iterable(columns["corner_x"])), default=0)
        for name in _CORNERS:
            padded = [[[*corners, *[nan] * (most - len(corners))] for corners in row] for row in columns[name]]
            array = np.array(padded, dtype=float).reshape(numbers.size, n, most)
            data[name] = (("frame", "region", "corner"), array[:, order])
    data["note"] = (("frame",), np.array(columns.get("note", []), dtype=object))
    coordinates: dict[str, Any] = {
        "frame": numbers,
        "contrast": np.array(about.contrasts),
        "time_s": ("frame", np.array(columns.get("time_s", []), dtype=float)),
    }
    if about.regions:
        coordinates["region"] = np.array([about.regions[place] for place in order], dtype=object)
    dataset = xr.Dataset(data, coordinates, dict(about.attrs))
    for name, text in _TITLES.items():
        if name in dataset.variables:
            dataset[name].attrs["long_name"] = text
    for name in ("mean", "mean_standard_uncertainty"):
        if name in dataset:
            dataset[name].attrs["units"] = about.unit
    for name in _PIXELS:
        if name in dataset:
            dataset[name].attrs["units"] = "pixel"
    dataset["time_s"].attrs["units"] = "s"
    return dataset


def _array(columns: Mapping[str, list[Any]], name: str, width: int | None = None) -> NDArray[np.float64]:
    values = np.array(columns.get(name, []), dtype=float)
    return values if width is None else values.reshape(-1, width)


def _bright_first(means: Sequence[Sequence[float]]) -> list[int]:
    first = next((row for row in means if not any(isnan(value) for value in row)), None)
    if first is None:
        return [0, 1]
    return [0, 1] if first[0] >= first[1] else [1, 0]


class Findings:
    """What to mind about the frames of a video, gathered row by row."""

    def __init__(self, regions: Sequence[str]) -> None:
        self._regions = regions
        self._n = 0
        self._faults: Counter[str] = Counter()
        self._first: dict[str, int] = {}
        self._invalid: dict[tuple[str, str], list[float]] = {}
        self._brighter: Counter[int] = Counter()
        self._saturated: dict[str, list[list[int]]] = {}
        self._n_saturated: Counter[str] = Counter()
        self.n_measured = 0
        self.first_note = ""

    def add(self, row: Mapping[str, Any]) -> None:
        """Take note of a row."""
        self._n += 1
        self.n_measured += not all(map(isnan, row["cdp"]))
        self.first_note = self.first_note or f"frame {row['frame']}: {row['note']}"
        kind = row.get("fault")
        if kind:
            self._faults[kind] += 1
            self._first.setdefault(kind, row["frame"])
        for region, shares in zip(self._regions, row.get("invalid") or [], strict=False):
            for reason, share in shares.items():
                self._invalid.setdefault((region, reason), []).append(share)
        for region, share in zip(self._regions, row.get("saturated") or [], strict=False):
            if share > TOO_SATURATED:
                self._add_saturated(region, row["frame"])
        if self._regions and not any(isnan(mean) for mean in row["mean"]):
            self._brighter[int(row["mean"][1] > row["mean"][0])] += 1

    def _add_saturated(self, region: str, frame: int) -> None:
        stretches = self._saturated.setdefault(region, [])
        if stretches and stretches[-1][2] == self._n - 1:
            stretches[-1][1:] = [frame, self._n]
        else:
            stretches.append([frame, frame, self._n])
        self._n_saturated[region] += 1

    @property
    def warnings(self) -> list[str]:
        """One line for each thing."""
        found = [
            f"{count} of {self._n} frames {_FAULTS[kind]}, frame {self._first[kind]} first"
            for kind, count in self._faults.items()
        ]
        for (region, reason), shares in self._invalid.items():
            found.append(
                f"region {region!r} has pixels that are {reason} in {len(shares)} of {self._n} frames, up to "
                f"{100 * max(shares):.3g} %"
            )
        for region, stretches in self._saturated.items():
            frames = ", ".join(str(a) if a == b else f"{a} to {b}" for a, b, _ in stretches[:_MOST_STRETCHES])
            more = f" and {len(stretches) - _MOST_STRETCHES} times more" if len(stretches) > _MOST_STRETCHES else ""
            found.append(
                f"more than {100 * TOO_SATURATED:g} % of region {region!r} is saturated in "
                f"{self._n_saturated[region]} of {self._n} frames ({frames}{more}): do not trust its mean, "
                "contrast and CDP there"
            )
        if len(self._brighter) > 1:
            fewer = min(self._brighter.values())
            found.append(f"in {fewer} frames the other region is the brighter one; contrasts are of the brighter one")
        return found


_FAULTS = {
    "broken": "cannot be used",
    "lost": "have lost a region",
    "unusable": "cannot be evaluated",
    "reference": "have no reference contrast",
    "repeated": "show the same picture as the one before",
}
#: So many stretches of frames are named.
_MOST_STRETCHES = 5


def saturation_note(regions: Sequence[str], shares: Sequence[float]) -> str:
    """Tell which regions are saturated too much; nothing if none is."""
    found = [
        f"region {name!r} is {100 * share:.3g} % saturated"
        for name, share in zip(regions, shares, strict=True)
        if share > TOO_SATURATED
    ]
    return "; ".join(found)


def as_json(values: Any) -> str:
    """Attribute of a dataset that holds more than a text or a number."""
    return json.dumps(values, ensure_ascii=False, sort_keys=True)
