"""The result of a contrast map: what is detected, and a row for each edge."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....core.result import Finding, InputFile, Quantity, Result, info, quantity_table, unique
from ....core.table import Z_95, Column, Table
from ....metrics import DetectionInterval
from .edges import FALSE_ALARM, SATURATED_SHARE, EdgeKind
from .map import ContrastMap

if TYPE_CHECKING:
    from xarray import Dataset

#: Name of each kind of edge in tables and files, and what it means.
KINDS = {
    EdgeKind.LOST: ("lost", "contrast of an object, and a CDP below the limit"),
    EdgeKind.SEEN: ("detected", "contrast of an object, and a CDP of at least the limit"),
    EdgeKind.UNEVEN: ("not uniform", "more than noise, but the regions vary as much: texture, or several surfaces"),
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
#: Variables of the edges in NetCDF, and the columns of the table that hold them.
_VARIABLES = (
    ("bright_region", "bright_region"), ("dark_region", "dark_region"), ("border_length", "border_px"),
    ("border_x", "x_px"), ("border_y", "y_px"), ("contrast", "contrast"), ("u_contrast", "u_contrast"),
    ("asked_contrast", "asked_contrast"), ("significant_contrast", "significant_contrast"), ("cdp", "cdp"),
    ("u_cdp", "u_cdp"), ("cdp_low", "cdp_low"), ("cdp_high", "cdp_high"),
)  # fmt: skip
#: Those of them that depend on the contrast to be detected, which are over this dimension if there are several.
_OF_CONTRAST = ("asked_contrast", "cdp", "u_cdp", "cdp_low", "cdp_high")
TO_DETECT = "contrast_to_detect"


@dataclass(frozen=True)
class MapSource:
    """What a contrast map was made from.

    Parameters
    ----------
    file : str
        Name of the image.
    sha256 : str
        Its hash.
    unit : str
        Of the luminance: ``cd/m²`` or ``relative``.
    conversion : str
        How DN became luminance.
    simulated : bool
        Whether the camera was simulated.
    findings : tuple of Finding
        Of file and conversion.
    inputs : tuple of InputFile
        Files other than the image.
    """

    file: str
    sha256: str
    unit: str
    conversion: str
    simulated: bool
    findings: tuple[Finding, ...] = ()
    inputs: tuple[InputFile, ...] = ()


def map_result(found: ContrastMap, source: MapSource) -> Result:
    """Return the result of a contrast map, with the weakest edges; see `edge_table` for all of them."""
    asked, epsilon = found.settings, found.settings.epsilon
    findings = [*source.findings, *found.findings]
    if found.blind_share > 0:
        findings.append(info("contrast-in-noise", contrast=asked.minimum_contrast, share=found.blind_share))
    n = max(WEAKEST // len(found.each), 1)
    weakest = _edges_of(found, source, "weakest", "The weakest edges", [one.weakest(n) for one in found.each])
    # All of them are edges of objects.
    hidden = ("border_px", "significant_contrast", "saturated")
    columns = tuple(replace(one, shown=one.shown and one.name not in hidden) for one in weakest.columns)
    of_contrast = () if found.others else _of_contrast(found)
    summary = quantity_table("summary", "Edges of the image", (*of_contrast, *_of_image(found)))
    return Result(
        kind="image-map",
        title=source.file,
        tables=(*_contrasts(found), summary, replace(weakest, columns=columns)),
        findings=unique(findings),
        inputs=(InputFile("picture", source.file, source.sha256), *source.inputs),
        configuration={
            "conversion": source.conversion,
            "region_size_px": asked.size_px,
            "epsilon": [epsilon.below, epsilon.above] if isinstance(epsilon, DetectionInterval) else epsilon,
            "minimum_contrast": asked.minimum_contrast,
            "contrast": [one.contrast for one in found.each] if found.others else found.contrast,
            "detected_cdp": asked.detected,
            "false_alarm": FALSE_ALARM,
        },
        simulated=source.simulated,
    )


def edge_table(found: ContrastMap, source: MapSource) -> Table:
    """Return the edges but for noise and too small ones, kind by kind, those with the lowest CDP first."""
    orders = []
    for one in found.each:
        shown = np.flatnonzero(~one.of_kind(EdgeKind.NOISE, EdgeKind.SMALL))
        rank = np.array([list(KINDS).index(EdgeKind(kind)) for kind in one.edges.kind[shown]])
        orders.append(shown[np.lexsort((one.edges.cdp[shown], rank))][: _MOST_ROWS // len(found.each)])
    return _edges_of(found, source, "edges", "Edges", orders).as_detail()


def _of_contrast(found: ContrastMap) -> list[Quantity]:
    """List what is said of the whole image at a contrast to be detected."""
    asked = "edges with at least the minimum contrast"
    return [
        Quantity("detected edges", found.detected_share, "%", f"share of the {asked} that are detected"),
        Quantity("detected length", found.detected_border_share, "%", "the same by the length of the edges"),
        *(Quantity(f"edges: {name}", found.count(kind), "", meaning) for kind, (name, meaning) in KINDS.items()),
    ]


def _contrasts(found: ContrastMap) -> Iterator[Table]:
    """Yield what is said of the whole image at each of several contrasts, a row for each."""
    if found.others:
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
        yield Table.of_items("contrasts", "Edges at each contrast", columns, found.each)


def _counting(kind: EdgeKind) -> Callable[[ContrastMap], int]:
    return lambda one: one.count(kind)


def _of_image(found: ContrastMap) -> list[Quantity]:
    """List what is said of the whole image at any contrast."""
    return [
        Quantity("borders between regions", int(found.edges.kind.size), "", "all edges together"),
        Quantity("borders in the noise", found.blind_share, "%", "where the minimum contrast is not significant"),
        Quantity("regions", int(found.regions.mean.size), "", "superpixels of the image"),
        Quantity("threshold of significance", found.threshold_sigmas, "", "in standard uncertainties of a contrast"),
        Quantity("noise inflation", found.noise.inflation, "", "of the variance of a difference, by correlation"),
    ]


def _edges_of(
    found: ContrastMap, source: MapSource, name: str, title: str, chosen: Sequence[NDArray[np.intp]]
) -> Table:
    """Return some rows of the edges at each contrast."""
    first, *others = (_edges(one, source, name, title, rows) for one, rows in zip(found.each, chosen, strict=True))
    if not others:
        return first
    data: dict[str, Any] = {
        key: np.concatenate([values, *(one[key] for one in others)]) for key, values in first.data.items()
    }
    return replace(first, data=data)


def _edges(
    found: ContrastMap, source: MapSource, name: str, title: str, chosen: NDArray[np.intp] | Sequence[int]
) -> Table:
    """Return the edges of some rows."""
    edges, regions, step, unit = found.edges, found.regions, found.luminance.step, source.unit
    pick = np.asarray(chosen, dtype=np.intp)
    bright, dark = edges.bright[pick], edges.dark[pick]
    asked = found.has_reference or found.contrast is not None
    u_contrast = edges.contrast_standard_uncertainty[pick]
    columns: tuple[tuple[Column, Any], ...] = (
        (Column("kind", "edge", "", "Whether the edge is detected."),
         [KINDS[EdgeKind(kind)][0] for kind in edges.kind[pick]]),
        (Column("x_px", "x", "px", "Middle of the border.", decimals=1), edges.middle_px[pick, 0] * step),
        (Column("y_px", "y", "px", "Middle of the border.", decimals=1), edges.middle_px[pick, 1] * step),
        (Column("border_px", "border", "px", "Length of the border."), edges.border_px[pick] * step),
        (Column("bright_mean", "bright side", unit, "Mean of the brighter region."), regions.mean[bright]),
        (Column("dark_mean", "dark side", unit, "Mean of the darker region."), regions.mean[dark]),
        (Column("contrast", "contrast", "%", "Weber contrast of the means.", expanded="expanded_contrast"),
         edges.contrast[pick]),
        (Column("expanded_contrast", "U (95 %) of contrast", "%", "Expanded uncertainty (95 %).", 2, shown=False),
         Z_95 * u_contrast),
        (Column("u_contrast", "u of contrast", "%", "Standard uncertainty.", 2, shown=False), u_contrast),
        (Column("asked_contrast", "target contrast", "%", "Contrast to be detected.", 3, shown=asked),
         edges.asked_contrast[pick]),
        (Column("cdp", "CDP", "", "Probability that a pair of pixels shows the target contrast.",
                low="cdp_low", high="cdp_high"), edges.cdp[pick]),
        (Column("cdp_low", "CDP, low", "", "Lower end of the 95 % interval.", shown=False), edges.cdp_low[pick]),
        (Column("cdp_high", "CDP, high", "", "Upper end of the 95 % interval.", shown=False), edges.cdp_high[pick]),
        (Column("u_cdp", "u of CDP", "", "Standard uncertainty.", 2, shown=False), edges.cdp_standard_error[pick]),
        (Column("significant_contrast", "significant from", "%", "Least contrast that would be significant.", 3),
         edges.significant_contrast[pick]),
        (Column("saturated", "saturated", "%", "Largest share of saturated pixels of both regions.", 2),
         np.maximum(regions.saturated_share[bright], regions.saturated_share[dark])),
        (Column("bright_region", "bright region", "", "Number of the region.", shown=False), bright),
        (Column("dark_region", "dark region", "", "Number of the region.", shown=False), dark),
    )  # fmt: skip
    return Table(name, title, tuple(column for column, _ in columns), {one.name: values for one, values in columns})


def contrast_map_dataset(found: ContrastMap, source: MapSource, result: Result) -> Dataset:
    """All of a contrast map as a dataset: the label of each pixel, a row for each region, and one for each edge."""
    import xarray as xr

    edges, regions, step = found.edges, found.regions, found.luminance.step
    light = "1" if source.unit == "relative" else "cd m-2"
    of_region = {
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
    every = np.arange(edges.kind.size)
    tables = [_edges(one, source, "edges", "Edges", every) for one in found.each]
    table, several = tables[0], bool(found.others)
    of_contrast = {name: np.stack([one[name] for one in tables]) for name in _OF_CONTRAST if several}
    dims = (TO_DETECT, "edge") if several else "edge"
    kinds = [one.edges.kind for one in found.each]
    seen, lost = ([one.count(kind) for one in found.each] for kind in (EdgeKind.SEEN, EdgeKind.LOST))
    # Numbers of regions have no unit.
    units = {one.name: {"px": {"units": "pixel"}}.get(one.unit, {"units": "1"}) for one in table.columns}
    units |= {"bright_region": {}, "dark_region": {}}
    return xr.Dataset(
        {
            "label": (("y", "x"), regions.labels),
            **{f"region_{name}": ("region", values, {"units": unit}) for name, (values, unit) in of_region.items()},
            "kind": (dims, np.stack(kinds) if several else kinds[0], flags),
            **{name: ("edge", table[column], units[column]) for name, column in _VARIABLES if name not in of_contrast},
            **{name: (dims, values, units[name]) for name, values in of_contrast.items()},
        },
        {TO_DETECT: (TO_DETECT, [one.contrast for one in found.each], {"units": "1"})} if several else {},
        attrs={
            "title": f"Contrast map of {source.file}",
            "file": source.file,
            "sha256": source.sha256,
            "image_pixels_per_label": step,
            "detected_edges": seen if several else seen[0],
            "lost_edges": lost if several else lost[0],
            "configuration": json.dumps(dict(result.configuration), ensure_ascii=False),
        },
    )
