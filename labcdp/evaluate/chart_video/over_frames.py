"""A chart over the frames of a video: what each pair of patches shows on average and at worst, and the ranges."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk.journal import Row
from ...core.table import Column, attributes_of
from ..video.dataset import FINDINGS, LIGHT, NOTE, TIME, findings_text, note_text, restored
from .run import CDP_NAMES, unpacked
from .settings import ChartVideoSettings

if TYPE_CHECKING:
    from xarray import Dataset

_Array = NDArray[np.float64]
#: Over frame and patch.
PATCH_COLUMNS = (
    Column("mean", "mean", LIGHT, "Mean luminance of the patch; missing where it is not to be seen."),
    Column("u_mean", "u of mean", LIGHT, "Standard uncertainty of the mean.", 2),
    Column("snr", "SNR", "", "Mean over standard deviation of its pixels; missing where it is saturated."),
    Column("u_snr", "u of SNR", "", "Standard uncertainty of the SNR.", 2),
    Column("saturated", "saturated", "%", "Share of saturated pixels.", 2),
)
#: Over frame.
FRAME_COLUMNS = (
    Column("quality", "tracking quality", "", "Share of the followed patches that are where a flat chart has them.", 3),
    Column("lost", "lost", "", "Whether the chart was lost: 1 or 0.", decimals=0),
    Column("centre_x", "centre x", "pixel", "Centre of its patches, to the right.", decimals=2),
    Column("centre_y", "centre y", "pixel", "Centre of its patches, down.", decimals=2),
)
#: Over frame and range.
RANGE_COLUMNS = (
    Column("range_low", "low end", "", "Low end of the dynamic range, in the unit of the chart."),
    Column("range_low_from", "low end, from", "", "Lower end of its 95 % interval."),
    Column("range_low_to", "low end, to", "", "Upper end of its 95 % interval."),
    Column("range_high", "high end", "", "High end of the dynamic range."),
    Column("range_high_from", "high end, from", "", "Lower end of its 95 % interval."),
    Column("range_high_to", "high end, to", "", "Upper end of its 95 % interval."),
    Column("range_stops", "range", "stops", "log2 of high over low end."),
    Column("u_range_stops", "u of range", "stops", "Standard uncertainty of the range.", 2),
    Column("range_is_bound", "bound", "", "Whether the chart ends before the camera does: 1 or 0.", decimals=0),
)
#: Over bright, dark and contrast: of all frames.
PAIR_COLUMNS = (
    Column("mean_cdp", "mean CDP", "", "Mean of the CDP of the frames.", decimals=5),
    Column("std_cdp", "standard deviation of the CDP", "", "From frame to frame.", decimals=5),
    Column("lowest_cdp", "lowest CDP", "", "Lowest CDP of a frame.", decimals=5),
    Column("lowest_cdp_low", "lowest CDP, lower end", "", "Lower end of its 95 % interval.", decimals=5),
    Column("lowest_cdp_high", "lowest CDP, upper end", "", "Upper end of its 95 % interval.", decimals=5),
    Column("lowest_frame", "frame of the lowest CDP", "", "The first frame that has it.", decimals=0),
    Column("detected_share", "share of the frames that detect", "%", "Share of the frames with a CDP that reach the "
           "limit.", decimals=1),
    Column("n_frames", "frames", "", "Frames in which the pair has a CDP.", decimals=0),
)  # fmt: skip
#: Positions of values in the list of a range in a row of the journal, by the names of `RANGE_COLUMNS`.
_IN_ROW = {
    "range_low": 2, "range_low_from": 3, "range_low_to": 4, "range_high": 6, "range_high_from": 7, "range_high_to": 8,
    "range_stops": 10, "u_range_stops": 11,
}  # fmt: skip


class _Pairs:
    """CDP of all pairs over the frames, kept as sums and least values: memory is that of a few frames."""

    def __init__(self, shape: tuple[int, int], limit: float) -> None:
        self._shape, self._limit = shape, limit
        self._n, self._detected = np.zeros(shape), np.zeros(shape)
        self._mean, self._squares = np.zeros(shape), np.zeros(shape)
        self._lowest = {name: np.full(shape, nan) for name in (*CDP_NAMES, "frame")}

    def add(self, row: Row) -> None:
        """Add a frame."""
        values = {name: unpacked(row[name], self._shape) for name in CDP_NAMES}
        cdp = values["cdp"]
        known = np.isfinite(cdp)
        self._n += known
        # Welford's update: sums of squares would lose digits of small changes.
        change = np.where(known, cdp - self._mean, 0.0)
        self._mean += change / np.maximum(self._n, 1)
        self._squares += np.where(known, change * (cdp - self._mean), 0.0)
        self._detected += known & (cdp >= self._limit)
        lower = known & ~(self._lowest["cdp"] <= cdp)
        for name, kept in self._lowest.items():
            kept[lower] = row["frame"] if name == "frame" else values[name][lower]

    def columns(self) -> dict[str, _Array]:
        """Return the values over contrasts and pairs by the names of `PAIR_COLUMNS`."""
        known, several = self._n > 0, self._n > 1
        return {
            "mean_cdp": np.where(known, self._mean, nan),
            "std_cdp": np.where(several, np.sqrt(self._squares / np.maximum(self._n - 1, 1)), nan),
            "lowest_cdp": self._lowest["cdp"],
            "lowest_cdp_low": self._lowest["cdp_low"],
            "lowest_cdp_high": self._lowest["cdp_high"],
            "lowest_frame": self._lowest["frame"],
            "detected_share": np.where(known, self._detected / np.maximum(self._n, 1), nan),
            "n_frames": self._n,
        }


def chart_dataset(
    rows: Iterable[Row], n_frames: int, settings: ChartVideoSettings, pair_contrasts: _Array | None, unit: str
) -> Dataset:
    """Return what the frames of a video show of a chart.

    Parameters
    ----------
    rows : iterable of dict
        A row of the journal for each frame.
    n_frames : int
        Their number.
    settings : ChartVideoSettings
        Settings of the evaluation.
    pair_contrasts : ndarray of float, shape (n, n), or None
        Contrasts of the pairs to be detected; None for those of the settings.
    unit : str
        Unit of the means.

    Returns
    -------
    xarray.Dataset
        Mean and SNR of each patch over ``frame`` and ``patch``; CDP of patches next to each other over ``frame``,
        ``pair`` (by the darker one) and ``contrast``; the dynamic ranges over ``frame`` and ``range``; and of each pair
        of patches, over ``bright``, ``dark`` and ``contrast``, what the frames show together. Without the dimension
        ``contrast`` where each pair has a contrast of its own.
    """
    import xarray as xr

    chart = settings.patches
    names, n = chart.names, len(chart.names)
    targets = [nan] if settings.contrasts is None else list(settings.contrasts)
    shape = len(targets), n * (n - 1) // 2
    neighbours = [(names.index(bright), names.index(dark)) for bright, dark in chart.neighbouring_pairs]
    at = np.array([_position(*pair, n) for pair in neighbours], dtype=np.intp)
    columns: dict[str, NDArray[Any]] = {column.name: np.full((n_frames, n), nan) for column in PATCH_COLUMNS}
    columns |= {column.name: np.full(n_frames, nan) for column in (*FRAME_COLUMNS, TIME)}
    columns |= {f"neighbour_{name}": np.full((n_frames, at.size, len(targets)), nan) for name in CDP_NAMES}
    columns |= {"glare": np.full(n_frames, nan), "u_glare": np.full(n_frames, nan)}
    numbers, findings, pairs = np.zeros(n_frames, dtype=np.int64), [], _Pairs(shape, settings.cdp_limit)
    ranges: dict[tuple[str, float], dict[str, _Array]] = {}
    for frame, row in enumerate(islice(rows, n_frames)):
        numbers[frame] = row["frame"]
        findings.append(restored(row["findings"]))
        for column in (*PATCH_COLUMNS, *FRAME_COLUMNS, TIME):
            columns[column.name][frame] = row[column.name]
        if row["cdp"] is None:
            continue
        pairs.add(row)
        for name in CDP_NAMES:
            columns[f"neighbour_{name}"][frame] = unpacked(row[name], shape)[:, at].T
        if row["glare"] is not None:
            columns["glare"][frame], columns["u_glare"][frame] = row["glare"]
        for values in row["ranges"]:
            kept = ranges.setdefault((values[0], values[1]), {c.name: np.full(n_frames, nan) for c in RANGE_COLUMNS})
            for name, place in _IN_ROW.items():
                kept[name][frame] = values[place]
            kept["range_is_bound"][frame] = values[12] == ">"
    per_pair = ("bright", "dark", "contrast") if pair_contrasts is None else ("bright", "dark")
    per_step = ("frame", "pair", "contrast") if pair_contrasts is None else ("frame", "pair")
    data: dict[str, Any] = {}

    def add(column: Column, dims: tuple[str, ...], values: NDArray[Any]) -> None:
        with_unit = replace(column, unit=unit) if column.unit == LIGHT else column
        data[column.name] = (dims, values, attributes_of(with_unit, values))

    for column in PATCH_COLUMNS:
        add(column, ("frame", "patch"), columns[column.name])
    for column in FRAME_COLUMNS:
        values = columns[column.name][:, None]
        add(column, ("frame", "region"), values.astype(bool) if column.name == "lost" else values)
    for column, values in zip(PAIR_COLUMNS, pairs.columns().values(), strict=True):
        whole = np.full((n, n, len(targets)), 0.0 if column.name == "n_frames" else nan)
        upper = np.triu_indices(n, 1)
        whole[upper] = whole[upper[::-1]] = values.T
        add(column, per_pair, whole if pair_contrasts is None else whole[..., 0])
    for name, end in zip(CDP_NAMES, ("", ", lower end", ", upper end"), strict=True):
        column = Column(f"neighbour_{name}", f"CDP of patches next to each other{end}", decimals=5)
        values = columns[column.name]
        add(column, per_step, values if pair_contrasts is None else values[..., 0])
    for column in RANGE_COLUMNS:
        values = np.array([kept[column.name] for kept in ranges.values()]).reshape(len(ranges), n_frames).T
        add(column, ("frame", "range"), values)
    if np.isfinite(columns["glare"]).any():
        add(Column("glare", "veiling glare", "", "As seen of black patches, in the unit of the chart."), ("frame",),
            columns["glare"])  # fmt: skip
        add(Column("u_glare", "u of veiling glare", "", "Standard uncertainty."), ("frame",), columns["u_glare"])
    for column, text in ((NOTE, note_text), (FINDINGS, findings_text)):
        add(column, ("frame",), np.array([text(of_frame) for of_frame in findings], dtype=object))
    add(TIME, ("frame",), columns[TIME.name])
    coordinates: dict[str, Any] = {
        "frame": numbers,
        "patch": np.array(names, dtype=object),
        "region": np.array([chart.name], dtype=object),
        "bright": np.array(names, dtype=object),
        "dark": np.array(names, dtype=object),
        "pair": np.array([f"{bright} / {dark}" for bright, dark in chart.neighbouring_pairs], dtype=object),
        "range": np.array([f"{name} ≥ {limit:g}" for name, limit in ranges], dtype=object),
        "contrast": targets if pair_contrasts is None else (("bright", "dark"), pair_contrasts),
    }
    attributes = {"mode": "chart", "unit": unit, "chart_unit": chart.unit if chart.is_stated else _shown(unit)}
    about_frames = np.empty(n_frames, dtype=object)
    about_frames[:] = findings
    stated = chart.luminances()
    for name, of in (("stated", "value"), ("u_stated", "u")):
        values = np.array([getattr(stated[patch], of) if patch in stated else nan for patch in names])
        coordinates[name] = ("patch", values)
    dataset = xr.Dataset(data, coordinates, attributes).set_coords(TIME.name)
    return dataset.assign_attrs(frame_findings=about_frames)


def _shown(unit: str) -> str:
    return "cd/m²" if unit == "cd/m^2" else "relative"


def _position(first: int, second: int, n: int) -> int:
    """Position of a pair in the upper triangle of a matrix of n rows, row by row."""
    low, high = sorted((first, second))
    return low * (2 * n - low - 1) // 2 + high - low - 1


def ordered_patches(dataset: Dataset) -> Sequence[int]:
    """Return the patches from the brightest to the darkest one, by the stated values, else by their means."""
    levels = dataset["stated"].values
    if not np.isfinite(levels).any():
        levels = patch_means(dataset)
    order: list[int] = np.argsort(-np.nan_to_num(levels), kind="stable").tolist()
    return order


def patch_means(dataset: Dataset) -> _Array:
    """Return the mean of each patch over the frames; nan where it has none."""
    values = dataset["mean"].values
    known = np.isfinite(values)
    total = np.where(known, values, 0.0).sum(axis=0)
    means: _Array = np.divide(total, known.sum(axis=0), out=np.full(values.shape[1], nan), where=known.any(axis=0))
    return means
