"""The result of a contrast map: what is detected, and a row for each edge."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....core.result import Finding, InputFile, Quantity, Result, info, quantity_table, unique
from ....core.table import Column, Table, uncertain, uncertain_values
from ....metrics import DetectionInterval
from .edges import FALSE_ALARM, SATURATED_SHARE, EdgeKind
from .map import ContrastMap

if TYPE_CHECKING:
    from xarray import Dataset

#: Name of each kind of edge in tables and files, and what it means.
KINDS = {
    EdgeKind.LOST: ("lost", "contrast of an object, and a CDP below the limit"),
    EdgeKind.SEEN: ("detected", "contrast of an object, and a CDP of at least the limit"),
    EdgeKind.UNEVEN: ("not uniform", "too few pixels show the contrast as a region is not uniform, not for noise"),
    EdgeKind.FAINT: ("faint", "contrast below that of an object"),
    EdgeKind.NOISE: ("noise", "not significant: no edge of an object"),
    EdgeKind.SATURATED: ("saturated", f"a region has more than {SATURATED_SHARE:.0%} of its pixels saturated"),
    EdgeKind.BLACK: ("black", "a region has no light above the black level"),
    EdgeKind.SMALL: ("too small", "too short, or a region has too few pixels"),
}
#: Edges that the table of the weakest ones has.
WEAKEST = 10
#: Longest table of edges, that of a sheet.
_MOST_ROWS = 2**20 - 1


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
    findings = [*source.findings, *found.findings]
    if found.blind_share > 0:
        findings.append(info("contrast-in-noise", contrast=found.settings.minimum_contrast, share=found.blind_share))
    return Result(
        kind="image-map",
        title=source.file,
        tables=(
            quantity_table("summary", "Edges of the image", _quantities(found)),
            _edges(found, source, "weakest", "The weakest edges", found.weakest(WEAKEST)),
        ),
        findings=unique(findings),
        inputs=(InputFile("picture", source.file, source.sha256), *source.inputs),
        configuration=_configuration(found, source),
        simulated=source.simulated,
    )


def edge_table(found: ContrastMap, source: MapSource) -> Table:
    """Return the edges but for noise and too small ones, kind by kind, those with the lowest CDP first."""
    edges = found.edges
    shown = np.flatnonzero(~found.of_kind(EdgeKind.NOISE, EdgeKind.SMALL))
    rank = np.array([list(KINDS).index(EdgeKind(kind)) for kind in edges.kind[shown]])
    order = shown[np.lexsort((edges.cdp[shown], rank))][:_MOST_ROWS]
    return _edges(found, source, "edges", "Edges", order)


def _configuration(found: ContrastMap, source: MapSource) -> Mapping[str, Any]:
    asked = found.settings
    epsilon = asked.epsilon
    return {
        "conversion": source.conversion,
        "region_size_px": asked.size_px,
        "epsilon": [epsilon.below, epsilon.above] if isinstance(epsilon, DetectionInterval) else epsilon,
        "minimum_contrast": asked.minimum_contrast,
        "contrast": asked.contrast,
        "detected_cdp": asked.detected,
        "false_alarm": FALSE_ALARM,
    }


def _quantities(found: ContrastMap) -> list[Quantity]:
    """List what is said of the whole image."""
    asked = "edges with at least the minimum contrast"
    return [
        Quantity("detected edges", found.detected_share, "%", f"share of the {asked} that are detected"),
        Quantity("detected length", found.detected_border_share, "%", "the same by the length of the edges"),
        *(Quantity(f"edges: {name}", found.count(kind), "", meaning) for kind, (name, meaning) in KINDS.items()),
        Quantity("borders between regions", int(found.edges.kind.size), "", "all edges together"),
        Quantity("borders in the noise", found.blind_share, "%", "where the minimum contrast is not significant"),
        Quantity("regions", int(found.regions.mean.size), "", "superpixels of the image"),
        Quantity("threshold of significance", found.threshold_sigmas, "", "in standard uncertainties of a contrast"),
        Quantity("noise inflation", found.noise.inflation, "", "of the variance of a difference, by correlation"),
    ]


def _edges(
    found: ContrastMap, source: MapSource, name: str, title: str, chosen: NDArray[np.intp] | Sequence[int]
) -> Table:
    edges, regions, step = found.edges, found.regions, found.luminance.step
    pick = np.asarray(chosen, dtype=np.intp)
    bright, dark = edges.bright[pick], edges.dark[pick]
    contrasts = [
        uncertain_values("contrast", value, u)
        for value, u in zip(edges.contrast[pick], edges.contrast_standard_uncertainty[pick], strict=True)
    ]
    data = {
        "kind": [KINDS[EdgeKind(kind)][0] for kind in edges.kind[pick]],
        "x_px": edges.middle_px[pick, 0] * step,
        "y_px": edges.middle_px[pick, 1] * step,
        "border_px": edges.border_px[pick] * step,
        "bright_mean": regions.mean[bright],
        "dark_mean": regions.mean[dark],
        "asked_contrast": edges.asked_contrast[pick],
        **{key: [one[key] for one in contrasts] for key in ("contrast", "expanded_contrast", "u_contrast")},
        "cdp": edges.cdp[pick],
        "cdp_low": edges.cdp_low[pick],
        "cdp_high": edges.cdp_high[pick],
        "u_cdp": edges.cdp_standard_error[pick],
        "significant_contrast": edges.significant_contrast[pick],
        "saturated": np.maximum(regions.saturated_share[bright], regions.saturated_share[dark]),
        "bright_region": bright,
        "dark_region": dark,
    }
    asked = found.has_reference or found.settings.contrast is not None
    return Table(name, title, _edge_columns(source.unit, name == "weakest", asked), data, detail=name == "edges")


def _edge_columns(unit: str, short: bool, asked: bool) -> tuple[Column, ...]:
    columns = (
        Column("kind", "edge", "", "Whether the edge is detected."),
        Column("x_px", "x", "px", "Middle of the border.", decimals=1),
        Column("y_px", "y", "px", "Middle of the border.", decimals=1),
        Column("border_px", "border", "px", "Length of the border."),
        Column("bright_mean", "bright side", unit, "Mean of the brighter region."),
        Column("dark_mean", "dark side", unit, "Mean of the darker region."),
        *uncertain(Column("contrast", "contrast", "%", "Weber contrast of the means.")),
        Column("asked_contrast", "asked contrast", "%", "Contrast that is to be detected.", 3, shown=asked),
        Column("cdp", "CDP", "", "Probability that a pair of pixels shows the contrast asked for.",
               low="cdp_low", high="cdp_high"),
        Column("cdp_low", "CDP, low", "", "Lower end of the 95 % interval.", shown=False),
        Column("cdp_high", "CDP, high", "", "Upper end of the 95 % interval.", shown=False),
        Column("u_cdp", "u of CDP", "", "Standard uncertainty.", 2, shown=False),
        Column("significant_contrast", "significant from", "%", "Least contrast that would be significant.", 3,
               shown=not short),
        Column("saturated", "saturated", "%", "Largest share of saturated pixels of both regions.", 2,
               shown=not short),
        Column("bright_region", "bright region", "", "Number of the region.", shown=False),
        Column("dark_region", "dark region", "", "Number of the region.", shown=False),
    )  # fmt: skip
    # All of the weakest edges are edges of objects.
    return tuple(replace(one, shown=one.shown and not (short and one.name == "border_px")) for one in columns)


def contrast_map_dataset(found: ContrastMap, source: MapSource, result: Result) -> Dataset:
    """All of a contrast map as a dataset: the label of each pixel, a row for each region, and one for each edge."""
    import xarray as xr

    edges, regions, step = found.edges, found.regions, found.luminance.step
    light = {"units": "1" if source.unit == "relative" else "cd m-2"}
    one, pixels = {"units": "1"}, {"units": "pixel"}
    flags = {
        "flag_values": np.array([int(kind) for kind in KINDS], dtype=np.int8),
        "flag_meanings": " ".join(name.replace(" ", "_") for name, _ in KINDS.values()),
    }
    return xr.Dataset(
        {
            "label": (("y", "x"), regions.labels),
            "region_mean": ("region", regions.mean, light),
            "region_std": ("region", regions.std, light),
            "region_noise": ("region", regions.noise, light),
            "region_measured_pixels": ("region", regions.n_pixels, one),
            "region_saturated_share": ("region", regions.saturated_share, one),
            "region_invalid_share": ("region", regions.invalid_share, one),
            "region_centre_x": ("region", regions.centre_px[:, 0] * step, pixels),
            "region_centre_y": ("region", regions.centre_px[:, 1] * step, pixels),
            "bright_region": ("edge", edges.bright),
            "dark_region": ("edge", edges.dark),
            "border_length": ("edge", edges.border_px * step, pixels),
            "border_x": ("edge", edges.middle_px[:, 0] * step, pixels),
            "border_y": ("edge", edges.middle_px[:, 1] * step, pixels),
            "kind": ("edge", edges.kind, flags),
            "contrast": ("edge", edges.contrast, one),
            "u_contrast": ("edge", edges.contrast_standard_uncertainty, one),
            "asked_contrast": ("edge", edges.asked_contrast, one),
            "significant_contrast": ("edge", edges.significant_contrast, one),
            "cdp": ("edge", edges.cdp, one),
            "u_cdp": ("edge", edges.cdp_standard_error, one),
            "cdp_low": ("edge", edges.cdp_low, one),
            "cdp_high": ("edge", edges.cdp_high, one),
        },
        attrs={
            "title": f"Contrast map of {source.file}",
            "file": source.file,
            "sha256": source.sha256,
            "image_pixels_per_label": step,
            "detected_edges": found.count(EdgeKind.SEEN),
            "lost_edges": found.count(EdgeKind.LOST),
            "configuration": json.dumps(dict(result.configuration), ensure_ascii=False),
        },
    )
