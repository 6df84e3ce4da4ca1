"""A contrast map as an interactive page that needs nothing else, not even a network."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from math import ceil

import numpy as np

from ....core.result import Result, info
from ....core.table import Table
from ....metrics import DetectionInterval, Epsilon
from ....report.files import dataset_bytes, envelope_json
from ....report.html import render_page
from ....report.layout import Block, Card, Page, Section, facts_table, input_facts
from ....report.sheets import result_workbook
from ....report.text import percent, share_percent
from ..converter import PictureSource
from .edges import FALSE_ALARM, EdgeKind
from .figure import Drawn, edge_script, overlay, overlay_figure
from .map import ContrastMap
from .result import contrast_map_dataset, edge_table

#: Maps that are drawn of several contrasts, and most cards of these.
_MOST_MAPS = 6

_OWN_CONTRAST = (
    "The target contrast of each edge is that in this image. The map shows where noise and texture hide such "
    "contrasts; it cannot show contrast lost before, for example to glare, fog or blur. A reference image of the "
    "scene, or the contrast of its objects, reveals that too."
)
_ASKED = "The target contrast of each edge is {asked}. Contrast lost to a veil or blur counts as lost."
_HELP = (
    "Warm colours: the camera loses the edge. Point at a dot for the values of its edge. A click in the legend shows "
    "or hides dots; the wheel zooms, dragging moves."
)

#: Why a border is neither detected nor lost although its contrast is large enough.
_LEFT_OUT = {
    EdgeKind.UNEVEN: "of regions that are not uniform",
    EdgeKind.SATURATED: "of saturated regions",
    EdgeKind.NOISE: "not distinguishable from noise",
    EdgeKind.SMALL: "too short",
}


def contrast_map_files(edge_map: ContrastMap, source: PictureSource, result: Result) -> dict[str, bytes]:
    """Return the files of a contrast map with all that it shows by their names.

    Returns
    -------
    dict of str to bytes
        report.html, contrast-map.png, of further contrasts contrast-map-2.png and so on, results.xlsx with a row for
        each edge, results.nc and results.json.
    """
    drawn = {single: overlay(single) for single in edge_map.each[:: ceil(len(edge_map.each) / _MOST_MAPS)]}
    edges = replace(result, tables=(*result.tables[:-1], edge_table(edge_map, source)))
    pictures = {
        f"contrast-map{f'-{number}' if number > 1 else ''}.png": overlay_figure(
            map_at_target,
            picture,
            f"{source.path.name}, {percent(map_at_target.contrast)}"
            if edge_map.others and map_at_target.contrast
            else source.path.name,
            source.simulated,
        )
        for number, (map_at_target, picture) in enumerate(drawn.items(), start=1)
    }
    return {
        "report.html": map_page(edge_map, drawn, source, result).encode(),
        **pictures,
        "results.xlsx": result_workbook(edges, datetime.now(UTC)),
        "results.nc": dataset_bytes(contrast_map_dataset(edge_map, source, result), "contrast map"),
        "results.json": envelope_json(result).encode(),
    }


def map_page(edge_map: ContrastMap, drawn: Drawn, source: PictureSource, result: Result) -> str:
    """Return a contrast map as a page: the overlay, and under the pointer luminances, contrast and CDP of an edge.

    Parameters
    ----------
    edge_map : ContrastMap
        The map.
    drawn : dict of ContrastMap to ndarray of uint8, shape (height, width, 3)
        Overlays, of the map at each contrast that is drawn.
    source : PictureSource
        Picture it was made from.
    result : Result
        Its numbers.

    Returns
    -------
    str
        HTML 5, with the drawing program (BokehJS, 1.3 MB) inside; its security policy forbids to load anything.
    """
    own_contrast = edge_map.contrast is None and not edge_map.has_reference
    meaning = _OWN_CONTRAST if own_contrast else _ASKED.format(asked=_asked_text(edge_map).rstrip(","))
    weakest: list[Block] = [result.table("weakest")] if len(result.table("weakest")) else []
    left_out = info("map-sections-not-drawn", n_drawn=len(drawn), n_sections=len(edge_map.each))
    findings = (*result.findings, *([left_out] if len(drawn) < len(edge_map.each) else []))
    return render_page(
        Page.of(
            replace(result, findings=findings),
            "Contrast detection probability (CDP) at the edges of an image",
            cards=_cards_of_contrasts(edge_map) if edge_map.others else _cards(edge_map),
            lead=[edge_script(drawn, source)],
            sections=[
                Section("", [meaning, _HELP, *weakest]),
                Section("All edges", result.tables[:-1]),
                Section("Settings and provenance", [_facts(edge_map, source, result)], collapsed=True),
            ],
        )
    )


def _cards_of_contrasts(edge_map: ContrastMap) -> list[Card]:
    """Return a card for each of a few contrasts, or of the one with most detected edges."""
    few = len(edge_map.each) <= _MOST_MAPS
    best = max(edge_map.each, key=lambda single: single.count(EdgeKind.SEEN))
    cards = []
    for map_at_target in edge_map.each if few else [best]:
        seen, lost = map_at_target.count(EdgeKind.SEEN), map_at_target.count(EdgeKind.LOST)
        share = share_percent(map_at_target.detected_share) if seen + lost else "none"
        of = f"{seen} of {seen + lost} edges of objects"
        name = f"Detected edges at {percent(map_at_target.contrast or 0)}"
        lines = (f"{lost} lost", *(() if few else (f"most of {len(edge_map.each)} contrasts",)))
        cards.append(Card(name, share, of, lines, state="plain" if lost else "good"))
    return cards


def _cards(edge_map: ContrastMap) -> list[Card]:
    settings, least = edge_map.settings, percent(edge_map.settings.minimum_contrast)
    seen, lost = edge_map.count(EdgeKind.SEEN), edge_map.count(EdgeKind.LOST)
    if seen + lost == 0:
        none = Card("Detected edges", "none", f"No edge has a measurable contrast of at least {least}.")
        return [none, *_left_out(edge_map)]
    if edge_map.too_few_judged:
        share = share_percent(edge_map.detected_share)
        few = f"{seen + lost} of {edge_map.n_in_sight} borders in sight are judged"
        lines = (f"{share} of these are detected, {lost} lost", "use smaller regions, or a sharper picture")
        return [Card("Detected edges", "too few judged", few, lines), *_left_out(edge_map)]
    length_text = f"{share_percent(1 - edge_map.detected_border_share)} of their length"
    # Where the contrast of the scene is given, borders that hardly show one are asked for it, too.
    pale = int(
        np.count_nonzero(edge_map.mask_of_kinds(EdgeKind.LOST) & (edge_map.edges.contrast < settings.minimum_contrast))
    )
    scene = f"at least {least}" if edge_map.contrast is None else f"{percent(edge_map.contrast)} in the scene"
    lost_text = (f"{pale} measure below {least}: hidden, as behind a veil",) if pale else ()
    return [
        Card(
            "Detected edges", share_percent(edge_map.detected_share), f"{seen} of {seen + lost} edges of objects",
            (f"contrast of {scene}", f"CDP of at least {settings.detected:g}"), state="plain" if lost else "good",
        ),
        Card(
            "Lost edges", str(lost), length_text, (f"CDP below {settings.detected:g}", *lost_text),
            state="bad" if lost else "good",
        ),
        *_left_out(edge_map),
    ]  # fmt: skip


def _left_out(edge_map: ContrastMap) -> Iterator[Card]:
    """Yield the card of the borders whose contrast is large enough and that are neither detected nor lost, and why."""
    high = edge_map.edges.contrast >= edge_map.settings.minimum_contrast
    counts = {why: int(np.count_nonzero(high & edge_map.mask_of_kinds(kind))) for kind, why in _LEFT_OUT.items()}
    n = sum(counts.values())
    if n:
        lines = tuple(f"{count} {why}" for why, count in counts.items() if count)
        every = n + int(np.count_nonzero(high & edge_map.mask_of_kinds(EdgeKind.SEEN, EdgeKind.LOST)))
        least = percent(edge_map.settings.minimum_contrast)
        yield Card("Left out", f"{n} of {every}", f"borders of {least} or more", lines)


def _facts(edge_map: ContrastMap, source: PictureSource, result: Result) -> Table:
    settings, (height, width) = edge_map.settings, edge_map.shape_px
    chance = f"{percent(FALSE_ALARM)} probability of one false edge in the whole image"
    return facts_table(
        [
            ("image", f"{source.path.name}, {width} x {height} pixels"),
            ("luminance", source.conversion),
            (
                "regions",
                f"{edge_map.regions.mean.size} superpixels of about {settings.size_px} x {settings.size_px} pixels",
            ),
            ("contrast that counts as detected", f"{_asked_text(edge_map)} {_tolerance(settings.epsilon)}"),
            ("minimum contrast of an object", percent(settings.minimum_contrast)),
            ("significant contrast", f"{edge_map.threshold_sigmas:.2f} standard uncertainties: {chance}"),
            ("SHA-256 of the image", source.sha256),
            *input_facts(result)[1:],
        ]
    )


def _asked_text(edge_map: ContrastMap) -> str:
    """Say which contrast edges are asked for."""
    if edge_map.has_reference:
        return "that of the edge in the reference image"
    if edge_map.contrast is None:
        return "that of the edge in this image"
    texts = [percent(single.contrast or 0) for single in edge_map.each]
    targets = ", ".join(texts) if len(texts) <= _MOST_MAPS else f"{len(texts)} from {texts[0]} to {texts[-1]}"
    return f"{targets}, as given for the scene,"


def _tolerance(epsilon: Epsilon) -> str:
    """Write a tolerance as it stands behind a contrast."""
    if not isinstance(epsilon, DetectionInterval):
        return f"± {percent(epsilon)} of it"
    below = "and all below" if epsilon.below is None else f"- {percent(epsilon.below)}"
    above = "and all above" if epsilon.above is None else f"+ {percent(epsilon.above)}"
    return f"{below}, {above} of it"
