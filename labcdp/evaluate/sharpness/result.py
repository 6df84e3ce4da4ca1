"""The result of the sharpness of a picture, and its files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.disk.text import json_values
from ...core.errors import InputError
from ...core.luminance import LuminanceMap
from ...core.result import Finding, InputFile, Result, error, info, unique
from ...core.roi import Roi
from ...files.picture import Picture
from ...files.read import read_picture
from ...regions import ImageSize, require_on_image
from ...report.files import dataset_bytes, result_files
from ...report.layout import Block, Page, Section, Verbatim, facts_table, input_facts
from ..picture.converter import LENS, RELATIVE, Converter, PictureSource
from .figures import picture_figures, sharpness_cards, sharpness_figures
from .measure import MeasuredSharpness, joined, measure_sharpness, pixels_of_values
from .tables import sharpness_dataset, sharpness_tables

if TYPE_CHECKING:
    from ...chain import Chain

#: Columns beside the picture.
_SHORT = ("edge", "direction", "field", "mtf50", "overshoot")


@dataclass(frozen=True)
class SharpnessSettings:
    """Settings of the evaluation of the sharpness of a picture.

    Parameters
    ----------
    rois : tuple of Roi
        Regions about one edge each.
    converter : Converter
        Converter of values to luminance; relative by default.
    chain : Chain or None
        Chain whose lens gets the measured MTF.
    image_size : (int, int) or None
        Width and height of the image the regions were drawn on, which must be those of the picture; None if unknown.
    inputs : tuple of InputFile
        Files other than the picture.

    Raises
    ------
    InputError
        If there is no region, or the chain has not one lens and one sensor.

    Examples
    --------
    >>> from labcdp import Roi
    >>> from labcdp.evaluate.sharpness.result import SharpnessSettings
    >>> SharpnessSettings((Roi.rectangle("middle", 0, 0, 60, 80),)).converter.unit
    'relative'
    """

    rois: tuple[Roi, ...]
    converter: Converter = RELATIVE
    chain: Chain | None = None
    image_size: ImageSize | None = None
    inputs: tuple[InputFile, ...] = ()

    def __post_init__(self) -> None:
        if not self.rois:
            raise InputError("no regions: give one about each edge")
        if self.chain is not None:
            chain_pitch_m(self.chain)


def chain_pitch_m(chain: Chain) -> float:
    """Return the pixel pitch of a chain whose lens can be replaced; raises InputError for another one.

    Examples
    --------
    >>> from labcdp.chain import Chain
    >>> from labcdp.evaluate.sharpness.result import chain_pitch_m
    >>> chain_pitch_m(Chain.load("manta-g505"))
    3.45e-06
    """
    from ...chain import Optics

    if not isinstance(dict(chain.before).get("optics"), Optics):
        raise InputError(f"chain {chain.name} has no table [optics] with a lens: give one that has")
    pitches = {sensor.pixel_pitch_m for _, sensor in chain.sensors}
    if len(pitches) != 1 or None in pitches:
        raise InputError(f"chain {chain.name} has no sensor with one pixel pitch: give one that has")
    return float(pitches.pop())


def chain_with_mtf(chain: Chain, mtf: Sequence[tuple[float, float]]) -> Chain:
    """Return a chain whose lens has a measured MTF, in place of all that blurs in it.

    Examples
    --------
    >>> from labcdp.chain import Chain
    >>> from labcdp.evaluate.sharpness.result import chain_with_mtf
    >>> sharp = chain_with_mtf(Chain.load("manta-g505"), [(0, 1.0), (100, 0.5), (300, 0.0)])
    >>> sharp.document["optics"]["mtf"]
    [[0.0, 1.0], [100.0, 0.5], [300.0, 0.0]]
    """
    return chain.with_(
        optics__mtf=[list(pair) for pair in mtf],
        optics__blur_sigma_m=None,
        optics__defocus_disc_m=None,
        optics__diffraction_nm=None,
    )


def evaluate_sharpness(settings: SharpnessSettings, paths: Sequence[Path]) -> tuple[Result, dict[str, bytes]]:
    """Evaluate a picture, or several with the same edges.

    Returns
    -------
    (Result, dict of str to bytes)
        Their numbers, and by their names report.html, results.xlsx, results.json, results.nc, figures/*.png and, of a
        chain, chain.toml.

    Raises
    ------
    InputError
        If the picture cannot be read, a region is outside it, or no edge can be measured.
    """
    names = [path.name for path in paths]
    several, seen = len(paths) > 1, list[_SeenPicture]()
    for number, path in enumerate(paths, start=1):
        name = path.name if names.count(path.name) == 1 else f"{path.name}, number {number}"
        seen.append(_measured_picture(settings, path, name if several else ""))
    measured = joined([picture.measured for picture in seen if picture.measured is not None])
    failed = [finding for picture in seen for finding in picture.failed]
    measured = replace(measured, findings=unique([*failed, *measured.findings]))
    result = _result(settings, measured, [picture.source for picture in seen])
    page = _page(measured, result, seen)
    attributes = {
        "title": "sharpness of a picture" if not several else f"sharpness in {len(paths)} pictures",
        "file": ", ".join(map(str, paths)),
        "configuration": json.dumps(json_values(result.configuration), ensure_ascii=False),
        "labcdp_version": version("labcdp"),
    }
    made = {
        **result_files(result, page),
        "results.nc": dataset_bytes(sharpness_dataset(measured.edges, attributes), "sharpness"),
    }
    if settings.chain is not None:
        made["chain.toml"] = chain_with_mtf(settings.chain, measured.mtf).to_toml().encode()
    return result, made


@dataclass(frozen=True, eq=False)
class _SeenPicture:
    """A picture with its edges; None and why if none can be measured, though they can in others."""

    name: str
    source: PictureSource
    luminance: LuminanceMap
    measured: MeasuredSharpness | None
    failed: tuple[Finding, ...] = ()


def _measured_picture(settings: SharpnessSettings, path: Path, name: str) -> _SeenPicture:
    picture = read_picture(path, settings.converter.options)
    height, width = picture.shape
    files = [file.path for file in settings.inputs if file.role == "regions"]
    require_on_image(settings.rois, settings.image_size, (width, height), *files)
    luminance = settings.converter.luminance(picture)
    pitch_m = pixel_pitch_m(settings.converter, picture) if settings.chain is None else chain_pitch_m(settings.chain)
    source, pixels = settings.converter.source(picture), pixels_of_values(picture, settings.converter)
    try:
        measured = measure_sharpness(luminance, settings.rois, pitch_m, pixels, name)
    except InputError as problem:
        if not name:
            raise
        failed = error("sfr-picture-failed", path.name, reason=str(problem))
        return _SeenPicture(name, source, luminance, None, (failed,))
    return _SeenPicture(name, source, luminance, measured)


def pixel_pitch_m(converter: Converter, picture: Picture) -> float | None:
    """Return the pixel pitch that is given, or that the picture or a camera specification states."""
    options = converter.with_lens(picture.lens).options
    return options.pixel_pitch_m or picture.statements.pixel_pitch_on(picture.shape)


def _result(settings: SharpnessSettings, measured: MeasuredSharpness, sources: Sequence[PictureSource]) -> Result:
    of_files = [finding for source in sources for finding in source.findings]
    # A pixel pitch alone corrects no vignetting, but is what the MTF of the lens needs.
    findings = [finding for finding in of_files if finding.values.get("given") != LENS["pixel_pitch_m"]]
    findings += measured.findings
    source = sources[0]
    if settings.chain is None and measured.pixel_pitch_m is None:
        findings.append(info("sfr-no-pitch"))
    return Result(
        kind="sfr",
        title=source.path.name if len(sources) == 1 else f"{len(sources)} pictures",
        tables=sharpness_tables(measured),
        findings=unique(findings),
        inputs=(*(InputFile("picture", str(one.path), one.sha256) for one in sources), *settings.inputs),
        configuration={
            "regions": [roi.name for roi in settings.rois],
            "chain": None if settings.chain is None else settings.chain.name,
            "pixel_pitch_m": measured.pixel_pitch_m,
            "conversion": source.conversion,
            "encoding": source.encoding,
        },
        simulated=any(source.simulated for source in sources),
    )


def _page(measured: MeasuredSharpness, result: Result, seen: Sequence[_SeenPicture]) -> Page:
    source = seen[0].source
    pictures = [(one.name, one.source.path.name, one.luminance) for one in seen if one.measured is not None]
    first, *more = picture_figures(measured, pictures)
    others = list(sharpness_figures(measured))
    edges = result.table("edges")
    mtf: list[Section] = []
    if measured.mtf:
        pairs = ", ".join(f"[{frequency:g}, {modulation:g}]" for frequency, modulation in measured.mtf)
        blocks: list[Block] = [
            "Without the pixels, which the sensor of a chain adds again. In a chain file:",
            Verbatim(f"[optics]\nmtf = [{pairs}]"),
        ]
        mtf = [Section("MTF of the lens", blocks)]
    facts = [
        *input_facts(result), ("encoding", source.encoding), ("camera", source.camera or ""), ("unit", source.unit),
        ("conversion", source.conversion),
    ]  # fmt: skip
    return Page.of(
        result,
        f"Sharpness (spatial frequency response) of {'pictures' if len(seen) > 1 else 'a picture'}",
        cards=sharpness_cards(measured),
        lead=[first, replace(edges.showing(*_SHORT, *(("picture",) if measured.over_pictures else ())), note="")],
        sections=[
            Section("Responses", others),
            Section("Edges and means", [result.table("sharpness"), *result.tables_named("pictures"), edges]),
            *([Section("Further pictures", more, collapsed=True)] if more else []),
            *mtf,
            Section("Provenance", [facts_table(facts)], collapsed=True),
        ],
    )
