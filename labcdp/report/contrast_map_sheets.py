"""A contrast map as a spreadsheet: one row for each edge."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np

from ..evaluate.contrast_map_edges import EdgeKind
from .contrast_map_wording import KIND_NAMES, MapSource, result_text, settings_facts
from .digits import decimals
from .workbook import Cell, Number, Sheet, workbook

if TYPE_CHECKING:
    from ..evaluate.contrast_map import ContrastMap

#: Rows of a sheet, one less for the head (ECMA-376 leaves it open; Excel and LibreOffice have these).
_MOST_ROWS = 2**20 - 1

#: Decimals of contrasts in percent, and of probabilities.
_PERCENT_DECIMALS, _CDP_DECIMALS = 1, 4


def contrast_map_workbook(found: ContrastMap, source: MapSource, time: datetime) -> bytes:
    """Write a contrast map as an Office Open XML workbook; equal arguments give equal bytes.

    Parameters
    ----------
    found : ContrastMap
        The map.
    source : MapSource
        Where it comes from.
    time : datetime
        Time of the content, with time zone, for the file's properties.

    Returns
    -------
    bytes
        Content of an .xlsx file: a row for each edge that is told from noise, kind by kind, those
        with the lowest CDP first; and how
        the map was made.
    """
    facts = [("Result", text) for text in result_text(found)]
    facts += [("Warning", text) for text in (*source.warnings, *found.warnings)]
    facts += [(fact.name, fact.value) for fact in settings_facts(found, source)]
    sheets = [_edges(found, source), Sheet("About", ("What", "Value"), facts)]
    return workbook(sheets, f"Contrast map of {source.file}", time)


def _edges(found: ContrastMap, source: MapSource) -> Sheet:
    edges, regions, step = found.edges, found.regions, found.luminance.step
    shown = np.flatnonzero(~found.of_kind(EdgeKind.NOISE, EdgeKind.SMALL))
    rank = np.array([list(KIND_NAMES).index(EdgeKind(kind)) for kind in edges.kind[shown]])
    shown = shown[np.lexsort((edges.cdp[shown], rank))][:_MOST_ROWS]
    unit = source.unit
    header = (
        "edge is",
        "x in pixels",
        "y in pixels",
        "border in pixels",
        f"bright mean in {unit}",
        f"dark mean in {unit}",
        "contrast",
        "standard uncertainty of the contrast",
        "CDP",
        "CDP, 95 % from",
        "CDP, 95 % to",
        "saturated share",
        "bright region",
        "dark region",
    )
    rows: list[tuple[Cell, ...]] = []
    for edge in shown.tolist():
        bright, dark = int(edges.bright[edge]), int(edges.dark[edge])
        saturated = max(regions.saturated_share[bright], regions.saturated_share[dark])
        rows.append(
            (
                KIND_NAMES[EdgeKind(edges.kind[edge])],
                Number(edges.middle_px[edge, 0] * step, 1),
                Number(edges.middle_px[edge, 1] * step, 1),
                Number(edges.border_px[edge] * step, 0),
                _luminance(float(regions.mean[bright])),
                _luminance(float(regions.mean[dark])),
                Number(edges.contrast[edge], _PERCENT_DECIMALS, percent=True),
                Number(edges.contrast_standard_uncertainty[edge], _PERCENT_DECIMALS, percent=True),
                Number(edges.cdp[edge], _CDP_DECIMALS),
                Number(edges.cdp_low[edge], _CDP_DECIMALS),
                Number(edges.cdp_high[edge], _CDP_DECIMALS),
                Number(saturated, _PERCENT_DECIMALS, percent=True),
                Number(bright, 0),
                Number(dark, 0),
            )
        )
    return Sheet("Edges", header, rows)


def _luminance(value: float) -> Number:
    return Number(value, min(max(decimals(value, 4), 0), 6))
