"""Tables of a chart: dynamic range, patches, and a sheet for each quantity of all patches against all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, Literal

import numpy as np

from ...core.table import Column, Table, uncertain, values_of, with_bound
from .measure import MeasuredChart

_PICTURE = Column("picture", "picture", "", "Name of the file.")
_ENDS = {
    "noise": "below the limit beyond",
    "saturation": "saturated beyond",
    "chart": "no patch beyond",
}
_RANGE_NOTE = (
    "Luminances between which SNR of a patch, CNR or CDP of two patches next to each other (at the luminance of the "
    "darker one) reach the limit. Without glare: less what is seen of black patches. Where the chart has no patch "
    "beyond, the range is at least this one."
)


def range_table(charts: Sequence[tuple[str, MeasuredChart]], several: bool) -> Table:
    """Return the dynamic ranges of charts in pictures, by the names of their files."""
    items = [(file, chart, chart_range) for file, chart in charts for chart_range in chart.ranges]
    units = {chart.unit for _, chart in charts}
    unit = units.pop() if len(units) == 1 else ""
    unit = "" if unit == "relative" else unit
    decibels = uncertain(
        Column("range_db", "range", "dB", "20 log10 of high over low end.", value=lambda i: i[2].range.decibels),
        lambda i: i[2].range.u_stops * 20 * np.log10(2),
    )
    stops = uncertain(
        Column("range_stops", "range", "stops", "log2 of high over low end.", value=lambda i: i[2].range.stops),
        lambda i: i[2].range.u_stops,
    )
    columns = (
        replace(_PICTURE, shown=several, value=lambda i: i[0]),
        Column("figure", "figure of merit", value="2.name"),
        Column("limit", "limit", "", "Least value of the figure.", digits=0, value=lambda i: i[2].range.limit),
        *_end_columns("low", unit),
        *_end_columns("high", unit),
        *with_bound(stops, lambda i: i[2].range.bound),
        *with_bound(decibels, lambda i: i[2].range.bound),
        Column("ratio", "ratio", "", "High over low end.", shown=False, value=lambda i: i[2].range.ratio),
        Column("ratio_from", "ratio, from", "", "Lower end of its 95 % interval.", shown=False,
               value=lambda i: i[2].range.ratio_interval.low),
        Column("ratio_to", "ratio, to", "", "Upper end of its 95 % interval.", shown=False,
               value=lambda i: i[2].range.ratio_interval.high),
        Column("dips", "dips at", unit, "Luminances inside the range at which the figure is below the limit.",
               shown=any(chart_range.range.dips for *_, chart_range in items),
               value=lambda i: ", ".join(f"{level:.3g}" for level in i[2].range.dips)),
    )  # fmt: skip
    ordered = columns if several else (*columns[1:], columns[0])
    return Table.of_items("dynamic_range", "Dynamic range", ordered, items, _RANGE_NOTE)


def _end_columns(end: Literal["low", "high"], unit: str) -> tuple[Column, ...]:
    """Return the columns of one end of a range: luminance, its interval, and why it is there."""
    return (
        Column(f"{end}", f"{end} end", unit, f"{end.capitalize()} end of the range.", value=f"2.range.{end}"),
        Column(f"{end}_from", f"{end} end, from", unit, "Lower end of its 95 % interval.", shown=False,
               value=f"2.range.{end}_interval.low"),
        Column(f"{end}_to", f"{end} end, to", unit, "Upper end of its 95 % interval.", shown=False,
               value=f"2.range.{end}_interval.high"),
        Column(f"{end}_reason", f"{end} end because", "", "Why the range ends there.",
               value=lambda item: _ENDS.get(getattr(item[2].range, f"{end}_end") or "", "")),
    )  # fmt: skip


def patch_table(charts: Sequence[tuple[str, MeasuredChart]], several: bool) -> Table:
    """Return the patches of charts, brightest first: stated and measured luminance, SNR."""
    items = []
    for file, chart in charts:
        stated = chart.chart.luminances()
        regions = sorted(chart.regions, key=lambda region: -region.mean)
        items += [(file, chart, region, stated.get(region.roi.name)) for region in regions]
    unit = {chart.chart.unit for _, chart in charts}.pop() if charts else ""
    unit = "" if unit == "relative" else unit
    columns = (
        replace(_PICTURE, shown=several, value=lambda i: i[0]),
        Column("patch", "patch", "", "Its name in the chart.", value=lambda i: i[2].roi.name),
        *uncertain(Column("stated", "stated", unit, "Stated luminance.", value=lambda i: i[3] and i[3].value),
                   lambda i: i[3] and (i[3].u if isfinite(i[3].u) else None)),
        *with_bound(uncertain(Column("measured", "measured", "", "Mean in the picture.", value=lambda i: i[2].mean),
                              lambda i: i[2].u), lambda i: i[2].bound),
        *uncertain(Column("snr", "SNR", "", "Mean over standard deviation of its pixels.",
                          value=lambda i: i[2].snr.value), lambda i: i[2].snr.u),
        Column("pixels", "pixels", "", "Pixels of the patch.", value=lambda i: i[2].n_pixels),
    )  # fmt: skip
    ordered = columns if several else (*columns[1:], columns[0])
    return Table.from_data("chart", "Patches of the chart", ordered, values_of(ordered, items), detail=True)


def matrix_tables(chart: MeasuredChart) -> Iterator[Table]:
    """Yield CDP, its interval, measured contrast, CNR, CSNR and d' of all patches against all, a table each."""
    names = [str(name) for name in chart.matrix["bright"].values]
    sheets = (
        ("cdp", "CDP", True), ("cdp_low", "CDP, lower end of the 95 % interval", True),
        ("cdp_high", "CDP, upper end of the 95 % interval", True), ("contrast", "target contrast", False),
        ("measured_contrast", "measured contrast", False), ("cnr", "CNR", False), ("csnr", "CSNR", False),
        ("d_prime", "d'", False),
    )  # fmt: skip
    for name, title, probability in sheets:
        values = chart.matrix[name]
        if "contrast" in values.dims:
            if name == "contrast":
                continue
            for number, contrast in enumerate(chart.matrix["contrast"].values.tolist()):
                yield matrix_table(f"{name} {100 * contrast:g}%", f"{title} at {100 * contrast:g} %", names,
                                   values.isel(contrast=number).values, probability)  # fmt: skip
        elif values.ndim == 2:
            yield matrix_table(f"{name} matrix", title, names, values.values, probability)


def matrix_table(name: str, title: str, names: Sequence[str], values: Any, probability: bool, unit: str = "") -> Table:
    """Return the values of all patches against all."""
    unit = "%" if "contrast" in name.split(" ")[0] else unit
    columns = (
        Column("patch", "patch"),
        *(Column(f"patch_{at}", label, unit, decimals=5 if probability else None) for at, label in enumerate(names, 1)),
    )
    data: dict[str, Sequence[Any]] = {"patch": list(names)}
    for at in range(len(names)):
        data[f"patch_{at + 1}"] = [value if isfinite(value) else None for value in values[:, at].tolist()]
    return Table(name, f"{title}, all patches against all", columns, data, matrix=probability, detail=True)
