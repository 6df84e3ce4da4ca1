"""The result of a contrast map: shares of detected edges, and a row for each edge."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....core.disk.text import json_values
from ....core.quantity import Z_95
from ....core.result import InputFile, NamedValue, Result, info, quantity_table, unique
from ....core.table import Column, Table, uncertain
from ....metrics import DetectionInterval
from ....metrics.region import SATURATED_SHARE
from ..converter import PictureSource
from .edges import FALSE_ALARM, EdgeKind
from .map import ContrastMap

if TYPE_CHECKING:
    from xarray import Dataset

#: Name of each kind of edge in tables and files, and what it means.
KINDS = {
    EdgeKind.LOST: ("lost", "contrast of an object, and a CDP below the limit"),
    EdgeKind.SEEN: ("detected", "contrast of an object, and a CDP of at least the limit"),
    EdgeKind.UNEVEN: ("not uniform", "more than noise, but regions vary as much: texture, shading, or two surfaces"),
    EdgeKind.FAINT: ("faint", "contrast below that of an object"),
    EdgeKind.NOISE: ("noise", "not distinguishable from noise: no edge of an object"),
    EdgeKind.SATURATED: ("saturated", f"a region has more than {SATURATED_SHARE:.0%} of its pixels saturated"),
    EdgeKind.BLACK: ("black", "a region has no light above the black level"),
    EdgeKind.SMALL: ("too small", "too short, or a region has too few pixels"),
}
#: Edges that the table of the weakest ones has.
WEAKEST = 10
#: Longest table of edges, that of a sheet.
_MOST_ROWS = 2**20 - 1
#: Columns of the edges that NetCDF holds, and the names of those that are called otherwise there.
_VARIABLES = (
    *("bright_region", "dark_region", "border_px", "x_px", "y_px", "contrast", "u_contrast", "asked_contrast"),
    *("significant_contrast", "cdp", "u_cdp", "cdp_low", "cdp_high"),
)
_RENAMED = {"border_px": "border_length", "x_px": "border_x", "y_px": "border_y"}
#: Those of them that depend on the contrast to be detected, which are over this dimension if there are several.
_OF_CONTRAST = ("asked_contrast", "cdp", "u_cdp", "cdp_low", "cdp_high")
TO_DETECT = "contrast_to_detect"


def map_result(edge_map: ContrastMap, source: PictureSource, inputs: Sequence[InputFile] = ()) -> Result:
    """Return the result of a contrast map, with the weakest edges; see `edge_table` for all of them."""
    settings, epsilon = edge_map.settings, edge_map.settings.epsilon
    findings = [*source.findings, *edge_map.findings]
    if edge_map.blind_share > 0:
        findings.append(info("contrast-in-noise", contrast=settings.minimum_contrast, share=edge_map.blind_share))
    if edge_map.n_uncertain:
        n_edges = edge_map.count(EdgeKind.SEEN) + edge_map.count(EdgeKind.LOST)
        findings.append(info("edges-uncertain", count=edge_map.n_uncertain, n_edges=n_edges))
    n = max(WEAKEST // len(edge_map.each), 1)
    weakest = _edges_of(
        edge_map, source.unit, "weakest", "The weakest edges", [single.weakest(n) for single in edge_map.each]
    )
    # All of them are edges of objects.
    hidden = ("border_px", "significant_contrast", "saturated")
    columns = tuple(replace(column, shown=column.shown and column.name not in hidden) for column in weakest.columns)
    detection = () if edge_map.others else _values_at_contrast(edge_map)
    summary = quantity_table("summary", "Edges of the image", (*detection, *_values_at_any_contrast(edge_map)))
    return Result(
        kind="image-map",
        title=source.path.name,
        tables=(*_contrasts(edge_map), summary, replace(weakest, columns=columns)),
        findings=unique(findings),
        inputs=(InputFile("picture", source.path.name, source.sha256), *inputs),
        configuration={
            "conversion": source.conversion,
            "region_size_px": settings.size_px,
            "epsilon": [epsilon.below, epsilon.above] if isinstance(epsilon, DetectionInterval) else epsilon,
            "minimum_contrast": settings.minimum_contrast,
            "contrast": [single.contrast for single in edge_map.each] if edge_map.others else edge_map.contrast,
            "detected_cdp": settings.detected,
            "false_alarm": FALSE_ALARM,
        },
        simulated=source.simulated,
    )


def edge_table(edge_map: ContrastMap, source: PictureSource) -> Table:
    """Return the edges but for noise and too small ones, kind by kind, the certain ones and lowest CDP first."""
    orders = []
    for map_at_target in edge_map.each:
        shown = np.flatnonzero(~map_at_target.mask_of_kinds(EdgeKind.NOISE, EdgeKind.SMALL))
        rank = np.array([list(KINDS).index(EdgeKind(kind)) for kind in map_at_target.edges.kind[shown]])
        orders.append(
            shown[np.lexsort((map_at_target.edges.cdp[shown], ~map_at_target.is_certain[shown], rank))][
                : _MOST_ROWS // len(edge_map.each)
            ]
        )
    return _edges_of(edge_map, source.unit, "edges", "Edges", orders).as_detail()


def _values_at_contrast(edge_map: ContrastMap) -> list[NamedValue]:
    """List the values of the whole image at a contrast to be detected."""
    counted = "edges with at least the minimum contrast"
    return [
        NamedValue("detected edges", edge_map.detected_share, "%", f"share of the {counted} that are detected"),
        NamedValue("detected length", edge_map.detected_border_share, "%", "the same by the length of the edges"),
        NamedValue("judged borders", edge_map.judged_share, "%", "share of the borders in sight that are judged"),
        *(NamedValue(f"edges: {name}", edge_map.count(kind), "", meaning) for kind, (name, meaning) in KINDS.items()),
    ]


def _contrasts(edge_map: ContrastMap) -> Iterator[Table]:
    """Yield the values of the whole image at each of several contrasts, a row for each."""
    if edge_map.others:
        counts = [
            Column(f"n_{name.replace(' ', '_')}", name, "", f"Number of edges: {meaning}.", value=_counting(kind))
            for kind, (name, meaning) in KINDS.items()
        ]
        columns = (
            Column("contrast", "target contrast", "%", "Contrast of the objects in the scene."),
            Column("detected_share", "detected edges", "%", "Share of edges with at least the minimum contrast."),
            Column("detected_border_share", "detected length", "%", "The same by the length of the edges."),
            *counts,
        )
        yield Table.of_items("contrasts", "Edges at each contrast", columns, edge_map.each)


def _counting(kind: EdgeKind) -> Callable[[ContrastMap], int]:
    return lambda edge_map: edge_map.count(kind)


def _values_at_any_contrast(edge_map: ContrastMap) -> list[NamedValue]:
    """List the values of the whole image that do not depend on the target contrast."""
    return [
        NamedValue("borders between regions", int(edge_map.edges.kind.size), "", "all edges together"),
        NamedValue("borders in the noise", edge_map.blind_share, "%", "where the minimum contrast is not significant"),
        NamedValue("regions", int(edge_map.regions.mean.size), "", "superpixels of the image"),
        NamedValue(
            "threshold of significance", edge_map.threshold_sigmas, "", "in standard uncertainties of a contrast"
        ),
        NamedValue("noise inflation", edge_map.noise.inflation, "", "of the variance of a difference, by correlation"),
    ]


def _edges_of(edge_map: ContrastMap, unit: str, name: str, title: str, rows: Sequence[NDArray[np.intp]]) -> Table:
    """Return some rows of the edges at each contrast."""
    tables = [_edges(single, unit).select(chosen.tolist()) for single, chosen in zip(edge_map.each, rows, strict=True)]
    columns = tables[0].columns
    data = {column.name: [value for table in tables for value in table[column.name]] for column in columns}
    return Table(name, title, columns, data)


def _edges(edge_map: ContrastMap, unit: str) -> Table:
    """Return all edges at a contrast."""
    edges, regions, step = edge_map.edges, edge_map.regions, edge_map.luminance.step
    bright, dark, u_contrast = edges.bright, edges.dark, edges.contrast_standard_uncertainty
    has_target = edge_map.has_reference or edge_map.contrast is not None
    columns: tuple[tuple[Column, Any], ...] = (
        (Column("kind", "edge", "", "Whether the edge is detected."),
         [KINDS[EdgeKind(kind)][0] for kind in edges.kind]),
        (Column("x_px", "x", "px", "Middle of the border.", decimals=1), edges.middle_px[:, 0] * step),
        (Column("y_px", "y", "px", "Middle of the border.", decimals=1), edges.middle_px[:, 1] * step),
        (Column("border_px", "border", "px", "Length of the border."), edges.border_px * step),
        (Column("bright_mean", "bright side", unit, "Mean of the brighter region."), regions.mean[bright]),
        (Column("dark_mean", "dark side", unit, "Mean of the darker region."), regions.mean[dark]),
        *zip(uncertain(Column("contrast", "contrast", "%", "Weber contrast of the means.")),
             (edges.contrast, Z_95 * u_contrast, u_contrast), strict=True),
        (Column("asked_contrast", "target contrast", "%", "Contrast to be detected.", 3, shown=has_target),
         edges.asked_contrast),
        (Column("cdp", "CDP", "", "Probability that a pair of pixels shows the target contrast.",
                low="cdp_low", high="cdp_high"), edges.cdp),
        (Column("cdp_low", "CDP, low", "", "Lower end of the 95 % interval.", shown=False), edges.cdp_low),
        (Column("cdp_high", "CDP, high", "", "Upper end of the 95 % interval.", shown=False), edges.cdp_high),
        (Column("u_cdp", "u of CDP", "", "Standard uncertainty.", 2, shown=False), edges.cdp_standard_error),
        (Column("significant_contrast", "significant from", "%", "Least contrast that would be significant.", 3),
         edges.significant_contrast),
        (Column("saturated", "saturated", "%", "Largest share of saturated pixels of both regions.", 2),
         np.maximum(regions.saturated_share[bright], regions.saturated_share[dark])),
        (Column("bright_region", "bright region", "", "Number of the region.", shown=False), bright),
        (Column("dark_region", "dark region", "", "Number of the region.", shown=False), dark),
    )  # fmt: skip
    data = {column.name: values for column, values in columns}
    return Table("edges", "Edges", tuple(column for column, _ in columns), data)


def contrast_map_dataset(edge_map: ContrastMap, source: PictureSource, result: Result) -> Dataset:
    """All of a contrast map as a dataset: the label of each pixel, a row for each region, and one for each edge."""
    import xarray as xr

    regions, step = edge_map.regions, edge_map.luminance.step
    light = "1" if source.unit == "relative" else "cd m-2"
    region_values = {
        "mean": (regions.mean, light),
        "std": (regions.std, light),
        "noise": (regions.noise, light),
        "measured_pixels": (regions.n_pixels, "1"),
        "saturated_share": (regions.saturated_share, "1"),
        "invalid_share": (regions.invalid_share, "1"),
        "centre_x": (regions.centre_px[:, 0] * step, "pixel"),
        "centre_y": (regions.centre_px[:, 1] * step, "pixel"),
    }
    flags = {
        "flag_values": np.array([int(kind) for kind in KINDS], dtype=np.int8),
        "flag_meanings": " ".join(name.replace(" ", "_") for name, _ in KINDS.values()),
    }
    tables, several = [_edges(single, source.unit) for single in edge_map.each], bool(edge_map.others)

    def over(arrays: list[Any]) -> tuple[Any, Any]:
        """Return dimensions and values of what depends on the contrast to be detected."""
        return ((TO_DETECT, "edge"), np.stack(arrays)) if several else ("edge", arrays[0])

    data = {
        "label": (("y", "x"), regions.labels),
        **{f"region_{name}": ("region", values, {"units": unit}) for name, (values, unit) in region_values.items()},
        "kind": (*over([single.edges.kind for single in edge_map.each]), flags),
    }
    for name in _VARIABLES:
        values = [table[name] for table in tables]
        # Numbers of regions have no unit.
        unit = {} if name.endswith("region") else {"units": "pixel" if name.endswith("_px") else "1"}
        data[_RENAMED.get(name, name)] = (*(over(values) if name in _OF_CONTRAST else ("edge", values[0])), unit)
    seen, lost = ([single.count(kind) for single in edge_map.each] for kind in (EdgeKind.SEEN, EdgeKind.LOST))
    return xr.Dataset(
        data,
        {TO_DETECT: (TO_DETECT, [single.contrast for single in edge_map.each], {"units": "1"})} if several else {},
        attrs={
            "title": f"Contrast map of {source.path.name}",
            "file": source.path.name,
            "sha256": source.sha256,
            "image_pixels_per_label": step,
            "detected_edges": seen if several else seen[0],
            "lost_edges": lost if several else lost[0],
            "configuration": json.dumps(json_values(result.configuration), ensure_ascii=False),
        },
    )
