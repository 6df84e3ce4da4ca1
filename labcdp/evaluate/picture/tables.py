"""The tables of pictures: CDP, regions, files, and a column a picture as in the 2018 thesis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Any

from ...core.table import Column, Table
from ...metrics import Cdp, DetectionInterval
from ...metrics.pair import Pair
from ...metrics.region import REASONS, RegionLight
from ..columns import CDP, CONTRAST, CSNR, SHARES, TARGET, invalid_share, region_columns
from ..requirement import SeenContrast
from ..verdict import LIMIT, VERDICT, Verdict, cdp_verdict
from .image import AnyContrast, ImageEvaluation
from .settings import ImageSettings


@dataclass(frozen=True)
class ReportedPicture:
    """A picture among those of a command.

    Parameters
    ----------
    number : int
        Its number, in the order they were given.
    file : str
        Its file, as it was given.
    folder : str
        Folder of its page next to the overview; empty for a single picture.
    evaluation : ImageEvaluation or None
        Its contrasts; None if it failed.
    failure : str
        Why it failed.
    """

    number: int
    file: str
    folder: str
    evaluation: ImageEvaluation | None
    failure: str = ""


@dataclass(frozen=True)
class _Row:
    """A row: a picture, and two regions or its neighbouring pixels with one of the target contrasts, if any."""

    picture: ReportedPicture
    contrast: AnyContrast
    cdp: Cdp[float] | None
    cdp_limit: float

    @property
    def verdict(self) -> Verdict | None:
        if self.cdp is None or not isfinite(self.cdp.cdp):
            return None
        return cdp_verdict(self.cdp.cdp, self.cdp.interval, self.cdp_limit)

    @property
    def regions(self) -> Pair | None:
        return self.contrast if isinstance(self.contrast, Pair) else None

    @property
    def targets_measured_contrast(self) -> bool:
        contrasts = self.contrast.cdp.contrast
        return len(contrasts) == 1 and bool(contrasts[0] == self.contrast.contrast.value)

    def tolerance(self, side: str) -> float | None:
        epsilon = None if self.cdp is None else self.cdp.epsilon
        found: float | None = getattr(epsilon, side) if isinstance(epsilon, DetectionInterval) else epsilon
        return found


def _within(path: str, *columns: Column) -> tuple[Column, ...]:
    return tuple(column.within(path) for column in columns)


_PICTURE = Column("picture", "picture", meaning="Name of the file.", value="picture.file")
_NUMBER = Column("number", "number", "", "Number of the picture, in the order given.", shown=False,
                 value="picture.number")  # fmt: skip
_CDP_COLUMNS = (
    Column("pair", "bright / dark region", "", "The two regions, or which neighbouring pixels.", value="contrast.name"),
    Column("bright", "bright region", shown=False, value="regions.bright_region.roi.name"),
    Column("dark", "dark region", shown=False, value="regions.dark_region.roi.name"),
    # That of neighbours has no uncertainty.
    CONTRAST[0].within("contrast"),
    *_within("regions", *CONTRAST[1:]),
    Column("u_measured_contrast_pixels", "u of measured contrast, pixels", "%", "Its part due to the pixels.", 2,
           shown=False, value="regions.contrast_pixels"),
    Column("u_measured_contrast_vignetting", "u of measured contrast, vignetting", "%",
           "Its part due to unmeasured vignetting.", 2, shown=False, value="regions.contrast_vignetting"),
    TARGET.within("cdp"),
    Column("contrast_origin", "origin", "", "Where the target contrast comes from: given or measured.",
           value=lambda row: None if row.cdp is None else "measured" if row.targets_measured_contrast else "given"),
    Column("detected_from", "detected from", "%", "Lowest contrast of a pair of pixels that counts as detected.",
           value="cdp.detected_range.0"),
    Column("detected_to", "detected to", "%", "Highest contrast of a pair of pixels that counts as detected.",
           value="cdp.detected_range.1"),
    *_within("cdp", *CDP),
    Column("u_cdp_pixels", "u of CDP, pixels", "", "Its part due to the pixels.", 2, shown=False,
           value="cdp.u_pixels"),
    Column("u_cdp_calibration", "u of CDP, calibration", "", "Its part due to the calibration.", 2, shown=False,
           value="cdp.u_calibration"),
    LIMIT,
    VERDICT,
    *_within("cdp", *SHARES),
    *_within("regions", *CSNR),
    Column("tolerance_below", "tolerance below", "%", "Of the target contrast; empty for an open end.", shown=False,
           value=lambda row: row.tolerance("below")),
    Column("tolerance_above", "tolerance above", "%", "Of the target contrast; empty for an open end.", shown=False,
           value=lambda row: row.tolerance("above")),
    Column("definition", "definition", "", "Definition of the contrast.", shown=False, value="cdp.definition"),
    Column("bright_pixels", "pixels, bright", "", "Pixels of the bright region.", shown=False, value="cdp.n_bright"),
    Column("dark_pixels", "pixels, dark", "", "Pixels of the dark region.", shown=False, value="cdp.n_dark"),
    Column("pairs", "pairs", "", "Pairs of neighbouring pixels.", shown=False,
           value=lambda row: row.cdp.pairs if row.cdp is not None and row.regions is None else None),
    Column("correlation_inflation", "inflation", "", "Factor on u due to correlated noise.", shown=False,
           value=lambda row: row.cdp.correlation_inflation if row.cdp is not None and row.regions else None),
)  # fmt: skip
_CDP_NOTE = (
    "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance of "
    "the target contrast; below and above are the shares to either side. CSNR is mean over standard deviation "
    "of the contrasts of all pairs. Uncertainties include the scatter of the pixels, including correlated noise, "
    "and the calibration, or without one the vignetting of the lens."
)


def cdp_table(pictures: Sequence[ReportedPicture], several: bool, limit: float) -> Table:
    """Return CDP, contrasts and verdicts by a limit, a row for each picture, pair and target contrast."""
    rows = [
        _Row(picture, contrast, cdp, limit)
        for picture in pictures
        if picture.evaluation is not None
        for contrast in picture.evaluation.contrasts
        # Regions without a target contrast have a row for their contrast all the same.
        for cdp in list(contrast.cdp) or ((None,) if isinstance(contrast, Pair) else ())
    ]
    measured = any(row.cdp is not None and row.targets_measured_contrast for row in rows)
    hidden = set() if measured else {"contrast_origin"}
    if all(row.regions is None for row in rows):
        hidden.add("csnr")
    # Contrasts that were given are shown as they were written.
    as_written = () if measured else ("contrast", "detected_from", "detected_to")
    columns = [
        replace(one, shown=one.shown and one.name not in hidden, digits=0 if one.name in as_written else one.digits)
        for one in _CDP_COLUMNS
    ]
    return Table.of_items("cdp", "Contrast detection probability", _of_pictures(columns, several), rows, _CDP_NOTE)


def _of_pictures(columns: Sequence[Column], several: bool) -> tuple[Column, ...]:
    """Return the columns with picture and number: before them of several pictures, else behind."""
    return (_PICTURE, _NUMBER, *columns) if several else (*columns, replace(_PICTURE, shown=False), _NUMBER)


def seen_contrasts(pictures: Sequence[ReportedPicture], several: bool) -> Iterator[SeenContrast]:
    """Yield what a requirement judges: each pair in each picture, at its first target contrast."""
    # Which region is the brighter one may change from picture to picture.
    names: dict[Any, str] = {}
    for picture in pictures:
        for one in () if picture.evaluation is None else picture.evaluation.contrasts:
            regions = one if isinstance(one, Pair) else None
            same = one.name if regions is None else frozenset((regions.a.roi.name, regions.b.roi.name))
            in_cd_m2 = picture.evaluation is not None and picture.evaluation.source.unit != "relative"
            cdp, interval = (one.cdp[0].cdp, one.cdp[0].interval) if len(one.cdp) else (nan, (nan, nan))
            yield SeenContrast(
                names.setdefault(same, one.name),
                picture.file if several else "",
                regions.dark_region.mean if regions is not None and in_cd_m2 else None,
                one.contrast.value,
                regions is not None and bool(regions.bound),
                cdp,
                interval,
            )


@dataclass(frozen=True)
class _RegionRow:
    picture: ReportedPicture
    region: RegionLight


def region_table(pictures: Sequence[ReportedPicture], several: bool) -> Table:
    """Return the regions of each picture, by their mean."""
    evaluated = [(one, one.evaluation) for one in pictures if one.evaluation is not None]
    rows = [
        _RegionRow(one, region)
        for one, evaluation in evaluated
        for region in sorted(evaluation.regions, key=lambda region: region.mean)
    ]
    units = {evaluation.source.unit for _, evaluation in evaluated}
    # Of files that hold luminance and others, each row has a unit of its own.
    unit, unit_of = (units.pop(), "") if len(units) == 1 else ("", "unit")
    reasons = {name for row in rows for name in row.region.invalid_shares}
    columns = (
        *_within("region", *region_columns(unit, unit_of)),
        *_within("region", *(invalid_share(reason, reason in reasons) for reason in REASONS.values())),
        Column("unit", "unit", "", "Of mean and standard deviation.", shown=bool(unit_of),
               value="picture.evaluation.source.unit"),
    )  # fmt: skip
    return Table.of_items("regions", "Regions", _of_pictures(columns, several), rows, detail=several)


def picture_table(pictures: Sequence[ReportedPicture], several: bool) -> Table:
    """Return the files, with what is known of them, and why those that failed have no result."""
    columns = (
        replace(_NUMBER, shown=True, value="number"),
        replace(_PICTURE, value="file"),
        Column("width_px", "width", "px", value="evaluation.source.shape.1"),
        Column("height_px", "height", "px", value="evaluation.source.shape.0"),
        Column("exposure_s", "exposure", "s", "Exposure time, where known.", time=True,
               value="evaluation.source.exposure_s"),
        Column("encoding", "encoding", "", "How the values are encoded, by the file or as assumed; of no effect with a "
               "calibration, which has its own response.", value="evaluation.source.encoding"),
        Column("camera", "camera", "", "Camera, where the file states it.", value="evaluation.source.camera"),
        Column("unit", "unit", "", "Unit of the luminance.", value="evaluation.source.unit"),
        Column("folder", "folder", "", "Folder of its page.", shown=False, value=lambda one: one.folder or None),
        Column("sha256", "SHA-256", "", "Hash of the file.", shown=False, value="evaluation.source.sha256"),
        Column("failure", "failure", "", "Why it has no result.", shown=any(one.evaluation is None for one in pictures),
               value=lambda one: one.failure if one.evaluation is None else None),
    )  # fmt: skip
    return Table.of_items("pictures", "Pictures" if several else "Picture", columns, pictures, detail=True)


def matrices(
    pictures: Sequence[ReportedPicture], settings: ImageSettings, contrasts: Sequence[float]
) -> Iterator[Table]:
    """Lay out CDP over contrasts with a column a picture, as the program of the 2018 thesis does, for each pair."""
    names = [(f"{bright} {dark}", f"{bright} / {dark}") for bright, dark in settings.chosen_pairs]
    names += [("nearest-neighbour", "nearest-neighbour")] if settings.neighbours else []
    found = [() if one.evaluation is None else one.evaluation.contrasts for one in pictures]
    first = Column("contrast", "target contrast", "%", "Contrast whose CDP is computed.")
    columns = [Column(f"picture_{one.number}", f"{one.number} {one.file}", decimals=5) for one in pictures]
    for number, (name, title) in enumerate(names):
        data: dict[str, Sequence[Any]] = {"contrast": list(contrasts)}
        for column, pairs in zip(columns, found, strict=True):
            data[column.name] = pairs[number].cdp.cdp.tolist() if pairs else [None] * len(contrasts)
        yield Table(f"cdp {name}", f"CDP, {title}", (first, *columns), data, matrix=True, detail=True)
