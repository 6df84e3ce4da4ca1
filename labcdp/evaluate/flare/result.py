"""The result of flare, and its files."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ...core.clock import exposure_text
from ...core.disk.text import json_values
from ...core.errors import InputError
from ...core.luminance import Invalid
from ...core.quantity import Quantity
from ...core.result import Finding, InputFile, Result, info, unique, warning
from ...core.roi import Roi
from ...metrics.stray_light import Flare, flare
from ...regions import ImageSize, require_on_image
from ...report.files import dataset_bytes, result_files
from ...report.layout import Page, Section, facts_table, input_facts
from ..picture.converter import RELATIVE, Converter
from .figures import flare_cards, map_figure, profile_figure
from .light import SceneLight, scene_light, scene_paths
from .tables import flare_dataset, flare_tables

#: Side of a block in pixels over the longer side of the image, and its least.
_BLOCK_SHARE, _LEAST_BLOCK_PX = 64, 8
#: Share of the pixels from which a finding says that they are outside the calibrated range.
_OUTSIDE_SHARE = 0.01
#: Columns beside the map.
_SHORT = ("place", "x_px", "y_px", "stray_light", "intensity_ppm", "normalised_ppm", "over_ring")


@dataclass(frozen=True)
class FlareSettings:
    """Settings of the evaluation of flare.

    Parameters
    ----------
    source : tuple of Roi
        Regions of the source, which are left out.
    pictures, background, direct : tuple of Path
        Pictures with the source, without it, and of the source itself.
    converter : Converter
        Converter of values to light; relative by default.
    direct_converter : Converter or None
        That of the direct pictures; None for the same.
    illuminance_lx, attenuation : Quantity or None
        As of `labcdp.metrics.flare`.
    block_px : int or None
        Side of the blocks of the map; None for a 64th of the longer side of the image, at least 8.
    image_size : (int, int) or None
        Width and height of the image the regions were drawn on, which must be those of the pictures; None if unknown.
    inputs : tuple of InputFile
        Files other than the pictures.

    Raises
    ------
    InputError
        If there is no picture or no region, or a filter is given without a direct picture.

    Examples
    --------
    >>> from pathlib import Path
    >>> from labcdp import Roi
    >>> from labcdp.evaluate.flare.result import FlareSettings
    >>> FlareSettings((Roi.rectangle("lamp", 30, 20, 10, 10),), (Path("lamp.tif"),)).block_px is None
    True
    """

    source: tuple[Roi, ...]
    pictures: tuple[Path, ...]
    background: tuple[Path, ...] = ()
    direct: tuple[Path, ...] = ()
    converter: Converter = RELATIVE
    direct_converter: Converter | None = None
    illuminance_lx: Quantity | None = None
    attenuation: Quantity | None = None
    block_px: int | None = None
    image_size: ImageSize | None = None
    inputs: tuple[InputFile, ...] = ()

    def __post_init__(self) -> None:
        if not self.source:
            raise InputError("the source has no region: give one or more about it")
        if not self.pictures:
            raise InputError("there is no picture: give one or more")
        if self.attenuation is not None and not self.direct:
            raise InputError("a filter is given without a direct picture of the source: give both, or neither")


def evaluate_flare(settings: FlareSettings) -> tuple[Result, dict[str, bytes]]:
    """Evaluate the pictures.

    Returns
    -------
    (Result, dict of str to bytes)
        Its numbers, and by their names report.html, results.xlsx, results.json, results.nc and figures/*.png.

    Raises
    ------
    InputError
        If pictures cannot be read or do not fit together, or a region is outside them.
    """
    is_compared = bool(settings.background or settings.direct)
    light = scene_light(scene_paths(settings.pictures), settings.converter, is_compared)
    height, width = (light.map.step * size for size in light.map.shape)
    files = [file.path for file in settings.inputs if file.role == "source"]
    require_on_image(settings.source, settings.image_size, (width, height), *files)
    others = {
        name: scene_light(scene_paths(paths), converter or settings.converter, is_compared=True)
        for name, paths, converter in (
            ("background", settings.background, None), ("direct", settings.direct, settings.direct_converter),
        )
        if paths
    }  # fmt: skip
    block_px = settings.block_px or max(max(height, width) // _BLOCK_SHARE, _LEAST_BLOCK_PX)
    measured = flare(
        light.map, settings.source, unit=light.unit, illuminance_lx=settings.illuminance_lx,
        attenuation=settings.attenuation, block_px=block_px, **{name: other.map for name, other in others.items()},
    )  # fmt: skip
    result = _result(settings, measured, light, others)
    attributes = {
        "title": "flare of a camera",
        "file": str(settings.pictures[0]),
        "configuration": json.dumps(json_values(result.configuration), ensure_ascii=False),
        "labcdp_version": version("labcdp"),
    }
    return result, {
        **result_files(result, _page(settings, measured, result, light)),
        "results.nc": dataset_bytes(flare_dataset(measured, light.unit, attributes), "flare"),
    }


def _result(settings: FlareSettings, measured: Flare, light: SceneLight, others: dict[str, SceneLight]) -> Result:
    findings = [*light.findings, *(finding for other in others.values() for finding in other.findings)]
    inputs = [*light.inputs("picture"), *(file for role, other in others.items() for file in other.inputs(role))]
    return Result(
        kind="flare",
        title=settings.pictures[0].name,
        tables=flare_tables(measured, light.unit),
        findings=unique([*findings, *_findings(settings, measured, light)]),
        inputs=(*inputs, *settings.inputs),
        configuration={
            "source": [roi.name for roi in settings.source],
            "illuminance_lx": _stated(settings.illuminance_lx),
            "attenuation": _stated(settings.attenuation),
            "block_px": measured.block_px,
            "exposures_s": list(light.exposures_s),
            "conversion": settings.converter.description,
        },
        simulated=any(source.simulated for source in light.sources),
    )


def _stated(quantity: Quantity | None) -> dict[str, float] | None:
    return None if quantity is None else {"value": quantity.value, "U": quantity.U}


def _findings(settings: FlareSettings, measured: Flare, light: SceneLight) -> list[Finding]:
    findings = []
    if settings.illuminance_lx is None and not settings.direct:
        findings.append(info("flare-without-reference"))
    if len(light.sources) > 1 and settings.converter.options.override("exposure_s") is not None:
        exposure_s = float(settings.converter.options.override("exposure_s"))
        findings.append(warning("flare-one-exposure", exposure_s=exposure_s, count=len(light.sources)))
    if measured.saturated_share > 0:
        findings.append(warning("flare-saturated", share=measured.saturated_share))
    worst = measured.light.worst
    if not worst.value > worst.U:
        findings.append(warning("flare-in-noise"))
    outside = float(np.mean((light.map.invalid & Invalid.OUTSIDE_CALIBRATED) > 0))
    if outside > _OUTSIDE_SHARE:
        findings.append(warning("flare-outside-calibrated", share=outside))
    return findings


def _page(settings: FlareSettings, measured: Flare, result: Result, light: SceneLight) -> Page:
    title = settings.pictures[0].name
    exposures = ", ".join(exposure_text(exposure) for exposure in light.exposures_s)
    facts = [
        *input_facts(result), ("exposures", exposures), ("unit", light.unit),
        ("conversion", settings.converter.description),
    ]  # fmt: skip
    return Page.of(
        result,
        "Flare (stray light beside a source)",
        cards=flare_cards(measured, light.unit),
        lead=[
            map_figure(measured, light.map, settings.source, title, light.unit),
            replace(result.table("places").showing(*_SHORT), note=""),
        ],
        sections=[
            Section("Mean, worst place and ghosts", result.tables_named("flare", "ghosts")),
            Section("Radial profile", [profile_figure(measured, light.unit), result.table("profile")]),
            Section("Provenance", [facts_table(facts)], collapsed=True),
        ],
    )
