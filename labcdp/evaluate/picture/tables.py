"""The tables of pictures: CDP, regions, files, and a column a picture as in the 2018 thesis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isfinite, nan
from typing import Any

from ...core.table import Column, Table, values_of
from ...metrics import Cdp, DetectionInterval
from ...metrics.pair import Pair
from ...metrics.region import REASONS
from ..columns import CDP, CONTRAST, CSNR, SHARES, TARGET, invalid_share, region_columns
from ..judgement import SeenContrast
from ..verdict import LIMIT, VERDICT, cdp_verdict
from .image import AnyContrast, MeasuredPicture
from .settings import ImageSettings

_PICTURE = (
    Column("picture", "picture", meaning="Name of the file.", value="file"),
    Column("number", "number", "", "Number of the picture, in the order given.", shown=False),
)
#: Columns that take their values from a `Pair` or a `NeighbourPair`, whose contrast has no uncertainty.
_NAME = Column("pair", "bright / dark region", "", "The two regions, or which neighbouring pixels.", value="name")
_MEASURED = CONTRAST[0]
#: Columns that take their values from a `Pair`.
_REGIONS = (
    Column("bright", "bright region", shown=False, value="bright_region.roi.name"),
    Column("dark", "dark region", shown=False, value="dark_region.roi.name"),
)
_UNCERTAINTY = (
    *CONTRAST[1:],
    Column("u_measured_contrast_pixels", "u of measured contrast, pixels", "%", "Its part due to the pixels.", 2,
           shown=False, value="contrast_pixels"),
    Column("u_measured_contrast_vignetting", "u of measured contrast, vignetting", "%",
           "Its part due to unmeasured vignetting.", 2, shown=False, value="contrast_vignetting"),
)  # fmt: skip
#: Columns that take their values from a `Cdp`.
_DETECTED = (
    Column("detected_from", "detected from", "%", "Lowest contrast of a pair of pixels that counts as detected.",
           value="detected_range.0"),
    Column("detected_to", "detected to", "%", "Highest contrast of a pair of pixels that counts as detected.",
           value="detected_range.1"),
    *CDP,
    Column("u_cdp_pixels", "u of CDP, pixels", "", "Its part due to the pixels.", 2, shown=False, value="u_pixels"),
    Column("u_cdp_calibration", "u of CDP, calibration", "", "Its part due to the calibration.", 2, shown=False,
           value="u_calibration"),
)  # fmt: skip
_TOLERANCE = (
    Column("tolerance_below", "tolerance below", "%", "Of the target contrast; empty for an open end.", shown=False,
           value=lambda cdp: _tolerance(cdp, "below")),
    Column("tolerance_above", "tolerance above", "%", "Of the target contrast; empty for an open end.", shown=False,
           value=lambda cdp: _tolerance(cdp, "above")),
    Column("definition", "definition", "", "Definition of the contrast.", shown=False),
    Column("bright_pixels", "pixels, bright", "", "Pixels of the bright region.", shown=False, value="n_bright"),
    Column("dark_pixels", "pixels, dark", "", "Pixels of the dark region.", shown=False, value="n_dark"),
)  # fmt: skip
_PAIRS = Column("pairs", "pairs", "", "Pairs of neighbouring pixels.", shown=False)
_INFLATION = Column("correlation_inflation", "inflation", "", "Factor on u due to correlated noise.", shown=False)
_ORIGIN = Column(
    "contrast_origin",
    "origin",
    "",
    "Where the target contrast comes from: given, measured, or the stated values of a chart.",
)
_CDP_COLUMNS = (
    _NAME, *_REGIONS, _MEASURED, *_UNCERTAINTY, TARGET, _ORIGIN, *_DETECTED, LIMIT, VERDICT, *SHARES, *CSNR,
    *_TOLERANCE, _PAIRS, _INFLATION,
)  # fmt: skip
_CDP_NOTE = (
    "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance of "
    "the target contrast; below and above are the shares to either side. CSNR is mean over standard deviation "
    "of the contrasts of all pairs. Uncertainties include the scatter of the pixels, including correlated noise, "
    "and the calibration, or without one the vignetting of the lens."
)


def cdp_table(pictures: Sequence[MeasuredPicture], several: bool, limit: float) -> Table:
    """Return CDP, contrasts and verdicts by a limit, a row for each picture, pair and target contrast."""
    in_row: list[MeasuredPicture] = []
    contrasts: list[AnyContrast] = []
    cdps: list[Cdp[float] | None] = []
    for picture in pictures:
        for contrast in picture.contrasts:
            # Regions without a target contrast have a row for their contrast all the same.
            without: list[Cdp[float] | None] = [None] if isinstance(contrast, Pair) else []
            for cdp in [*contrast.cdp] or without:
                in_row.append(picture)
                contrasts.append(contrast)
                cdps.append(cdp)
    pairs = [contrast if isinstance(contrast, Pair) else None for contrast in contrasts]
    origins = [
        None if cdp is None else "measured" if contrast.targets_measured_contrast else _given(picture)
        for picture, contrast, cdp in zip(in_row, contrasts, cdps, strict=True)
    ]
    data = {
        **values_of(_PICTURE, in_row),
        **values_of((_NAME, _MEASURED), contrasts),
        **values_of((*_REGIONS, *_UNCERTAINTY, *CSNR), pairs),
        **values_of((TARGET, *_DETECTED, *SHARES, *_TOLERANCE), cdps),
        # A pair of regions has its pixels, neighbours have their pairs.
        **values_of((_PAIRS,), [None if pair else cdp for pair, cdp in zip(pairs, cdps, strict=True)]),
        **values_of((_INFLATION,), [cdp if pair else None for pair, cdp in zip(pairs, cdps, strict=True)]),
        _ORIGIN.name: origins,
        LIMIT.name: [limit] * len(cdps),
        VERDICT.name: [
            "saturated"
            if pair is not None and pair.bound
            else cdp_verdict(cdp.cdp, cdp.interval, limit)
            if cdp is not None and isfinite(cdp.cdp)
            else None
            for pair, cdp in zip(pairs, cdps, strict=True)
        ],
    }
    measured = not {"measured", "chart"}.isdisjoint(origins)
    hidden = set() if measured else {_ORIGIN.name}
    if not any(pairs):
        hidden.add("csnr")
    # Contrasts that were given are shown as they were written.
    as_written = () if measured else ("contrast", "detected_from", "detected_to")
    columns = [
        replace(
            column,
            shown=column.shown and column.name not in hidden,
            digits=0 if column.name in as_written else column.digits,
        )
        for column in _CDP_COLUMNS
    ]
    return Table.from_data("cdp", "Contrast detection probability", _with_picture(columns, several), data, _CDP_NOTE)


def _given(picture: MeasuredPicture) -> str:
    return "chart" if picture.chart is not None and picture.chart.targets_stated else "given"


def _tolerance(cdp: Cdp[float] | None, side: str) -> float | None:
    epsilon = None if cdp is None else cdp.epsilon
    tolerance: float | None = getattr(epsilon, side) if isinstance(epsilon, DetectionInterval) else epsilon
    return tolerance


def _with_picture(columns: Sequence[Column], several: bool) -> tuple[Column, ...]:
    """Return the columns with picture and number: before them of several pictures, else behind and hidden."""
    return (*_PICTURE, *columns) if several else (*columns, *(replace(column, shown=False) for column in _PICTURE))


def seen_contrasts(pictures: Sequence[MeasuredPicture], several: bool) -> Iterator[SeenContrast]:
    """Yield what a requirement judges: each pair in each picture, at its first target contrast."""
    # Which region is the brighter one may change from picture to picture.
    names: dict[Any, str] = {}
    for picture in pictures:
        for contrast in picture.contrasts:
            pair = contrast if isinstance(contrast, Pair) else None
            same = contrast.name if pair is None else frozenset((pair.a.roi.name, pair.b.roi.name))
            cdp = contrast.cdp[0] if len(contrast.cdp) else None
            yield SeenContrast(
                names.setdefault(same, contrast.name),
                picture.file if several else "",
                pair.dark_region.mean if pair is not None and picture.unit != "relative" else None,
                contrast.contrast.value,
                pair is not None and bool(pair.bound),
                nan if cdp is None else cdp.cdp,
                (nan, nan) if cdp is None else cdp.interval,
            )


def region_table(pictures: Sequence[MeasuredPicture], several: bool) -> Table:
    """Return the regions of each picture, by their mean."""
    rows = [
        (picture, region) for picture in pictures for region in sorted(picture.regions, key=lambda region: region.mean)
    ]
    in_row, regions = [picture for picture, _ in rows], [region for _, region in rows]
    units = {picture.unit for picture in pictures if picture.source is not None}
    # Of files that hold luminance and others, each row has a unit of its own.
    unit, unit_of = (units.pop(), "") if len(units) == 1 else ("", "unit")
    reasons = {name for region in regions for name in region.invalid_shares}
    columns = (
        *region_columns(unit, unit_of),
        *(invalid_share(reason, reason in reasons) for reason in REASONS.values()),
    )
    with_unit = Column("unit", "unit", "", "Of mean and standard deviation.", shown=bool(unit_of))
    data = values_of((*_PICTURE, with_unit), in_row) | values_of(columns, regions)
    shown = _with_picture((*columns, with_unit), several)
    return Table.from_data("regions", "Regions", shown, data, detail=several)


def picture_table(pictures: Sequence[MeasuredPicture], several: bool) -> Table:
    """Return the files, with what is known of them, and why those that failed have no result."""
    columns = (
        replace(_PICTURE[1], shown=True),
        _PICTURE[0],
        Column("width_px", "width", "px", value="source.shape.1"),
        Column("height_px", "height", "px", value="source.shape.0"),
        Column("exposure_s", "exposure", "s", "Exposure time, where known.", time=True,
               value="source.exposure_s"),
        Column("encoding", "encoding", "", "How the values are encoded, by the file or as assumed; of no effect with a "
               "calibration, which has its own response.", value="source.encoding"),
        Column("camera", "camera", "", "Camera, where the file states it.", value="source.camera"),
        Column("unit", "unit", "", "Unit of the luminance.", value="source.unit"),
        Column("folder", "folder", "", "Folder of its page.", shown=False,
               value=lambda picture: picture.folder or None),
        Column("sha256", "SHA-256", "", "Hash of the file.", shown=False, value="source.sha256"),
        Column("failure", "failure", "", "Why it has no result.",
               shown=any(picture.source is None for picture in pictures),
               value=lambda picture: picture.failure if picture.source is None else None),
    )  # fmt: skip
    return Table.of_items("pictures", "Pictures" if several else "Picture", columns, pictures, detail=True)


def matrices(
    pictures: Sequence[MeasuredPicture], settings: ImageSettings, contrasts: Sequence[float]
) -> Iterator[Table]:
    """Lay out CDP over contrasts with a column a picture, as the program of the 2018 thesis does, for each pair."""
    names = [(f"{bright} {dark}", f"{bright} / {dark}") for bright, dark in settings.chosen_pairs]
    names += [("nearest-neighbour", "nearest-neighbour")] if settings.neighbours else []
    first = Column("contrast", "target contrast", "%", "Contrast whose CDP is computed.")
    columns = [
        Column(f"picture_{picture.number}", f"{picture.number} {picture.file}", decimals=5) for picture in pictures
    ]
    for number, (name, title) in enumerate(names):
        data: dict[str, Sequence[Any]] = {"contrast": list(contrasts)}
        for column, picture in zip(columns, pictures, strict=True):
            pairs = picture.contrasts
            data[column.name] = pairs[number].cdp.cdp.tolist() if pairs else [None] * len(contrasts)
        yield Table(f"cdp {name}", f"CDP, {title}", (first, *columns), data, matrix=True, detail=True)
