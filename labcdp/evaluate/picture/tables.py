"""The tables of pictures: CDP, regions, files, and a column a picture as in the 2018 thesis."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from ...core.table import Column, Table, Value, uncertain
from ...metrics import CalibratedCdp, CdpResult, ContrastDistribution, DetectionInterval, Estimate, NeighbourCdp
from ...metrics.region import REASONS, RegionResult
from .image import ImageEvaluation, ImageRequest
from .neighbours import Rectangle

#: CDP of two regions, or of neighbouring pixels.
AnyCdp: TypeAlias = CalibratedCdp[CdpResult] | CalibratedCdp[NeighbourCdp]


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
class ReportedContrast:
    """Two regions of a picture, or its neighbouring pixels.

    Parameters
    ----------
    name, bright, dark : str or None
        What is shown, and the names of the two regions.
    measured, csnr : Estimate
        Measured contrast and CSNR.
    measured_pixels : float or None
        Part of the uncertainty of the measured contrast by the pixels.
    results : sequence of CalibratedCdp
        CDP of each target contrast.
    distribution : ContrastDistribution or None
        Of all contrasts.
    """

    name: str
    bright: str | None
    dark: str | None
    measured: Estimate
    measured_pixels: float | None
    csnr: Estimate | None
    results: Sequence[AnyCdp]
    distribution: ContrastDistribution | None

    @property
    def of_measured(self) -> bool:
        """Whether the target contrast is the measured one."""
        return [one.result.contrast for one in self.results] == [self.measured.value]


def reported_contrasts(evaluation: ImageEvaluation) -> list[ReportedContrast]:
    """Return the pairs of a picture, then its neighbouring pixels."""
    found = [
        ReportedContrast(
            pair.name, pair.result.bright_region.roi.name, pair.result.dark_region.roi.name, pair.result.contrast,
            pair.result.contrast_pixels, pair.result.csnr, pair.result.results, pair.distribution,
        )
        for pair in evaluation.pairs
    ]  # fmt: skip
    near = evaluation.neighbours
    if near is not None:
        measured = Estimate(near.contrast, float("nan"))
        name = neighbour_name(near.rectangle)
        found.append(ReportedContrast(name, None, None, measured, None, None, near.results, near.distribution))
    return found


def neighbour_name(rectangle: Rectangle | None) -> str:
    """Return which pixels a nearest-neighbour CDP is of."""
    if rectangle is None:
        return "nearest-neighbour, whole picture"
    x0, y0, x1, y1 = rectangle
    return f"nearest-neighbour, ({x0}, {y0}) to ({x1}, {y1})"


@dataclass(frozen=True)
class _Row:
    """A row: a picture, and a pair with one of its target contrasts, if any."""

    picture: ReportedPicture
    pair: ReportedContrast
    one: AnyCdp | None

    def tolerance(self, side: str) -> float | None:
        epsilon = None if self.one is None else self.one.result.epsilon
        found: float | None = getattr(epsilon, side) if isinstance(epsilon, DetectionInterval) else epsilon
        return found


def _cdp(column: Column, value: Callable[[AnyCdp], Value] | None = None) -> Column:
    """Return a column of a CDP: of the field of its name, or a function of it; empty where there is none."""
    take = value or (lambda one: getattr(one.result, column.name, None))
    return replace(column, value=lambda row: None if row.one is None else take(row.one))


def _u_measured(row: _Row) -> float | None:
    # Of neighbouring pixels it is not known.
    return None if row.pair.bright is None else row.pair.measured.standard_error


_PICTURE = Column("picture", "picture", meaning="Name of the file.", value="picture.file")
_NUMBER = Column("number", "number", "", "Number of the picture, in the order given.", shown=False,
                 value="picture.number")  # fmt: skip
_CDP_COLUMNS = (
    Column("pair", "bright / dark region", "", "The two regions, or which neighbouring pixels.", value="pair.name"),
    Column("bright", "bright region", shown=False, value="pair.bright"),
    Column("dark", "dark region", shown=False, value="pair.dark"),
    *uncertain(Column("measured_contrast", "measured contrast", "%", "Weber contrast of the means.",
                      value="pair.measured.value"), u=_u_measured),
    Column("u_measured_contrast_pixels", "u of measured contrast, pixels", "%", "Its part by the pixels.", 2,
           shown=False, value="pair.measured_pixels"),
    _cdp(Column("contrast", "target contrast", "%", "Contrast whose CDP is computed.")),
    Column("contrast_origin", "origin", "", "Where the target contrast comes from: given, or measured.",
           value=lambda row: None if row.one is None else "measured" if row.pair.of_measured else "given"),
    _cdp(Column("detected_from", "detected from", "%", "Lowest contrast of a pair of pixels that counts as detected."),
         lambda one: one.result.interval[0]),
    _cdp(Column("detected_to", "detected to", "%", "Highest contrast of a pair of pixels that counts as detected."),
         lambda one: one.result.interval[1]),
    _cdp(Column("cdp", "CDP", "", "Share of the pairs of pixels that are detected.", low="cdp_low", high="cdp_high")),
    _cdp(Column("cdp_low", "CDP, low", "", "Lower end of the 95 % interval, by pixels and calibration.", decimals=5,
                shown=False), lambda one: one.confidence_interval[0]),
    _cdp(Column("cdp_high", "CDP, high", "", "Upper end of the 95 % interval.", decimals=5, shown=False),
         lambda one: one.confidence_interval[1]),
    _cdp(Column("u_cdp", "u of CDP", "", "Standard uncertainty, by pixels and calibration.", 2, shown=False),
         lambda one: one.standard_uncertainty),
    _cdp(Column("u_cdp_pixels", "u of CDP, pixels", "", "Its part by the pixels.", 2, shown=False),
         lambda one: one.result.standard_error),
    _cdp(Column("u_cdp_calibration", "u of CDP, calibration", "", "Its part by the calibration.", 2, shown=False),
         lambda one: one.calibration_standard_uncertainty),
    _cdp(Column("below", "below", "", "Share of the pairs with a lower contrast.", decimals=4)),
    _cdp(Column("above", "above", "", "Share of the pairs with a higher contrast.", decimals=4)),
    _cdp(Column("undefined", "undefined", "", "Share of the pairs without light; they are below.", shown=False)),
    *uncertain(Column("csnr", "CSNR", "", "Mean over standard deviation of the contrasts of all pairs of pixels.", 3,
                      value=lambda row: row.pair.csnr and row.pair.csnr.value),
               u=lambda row: row.pair.csnr and row.pair.csnr.standard_error),
    Column("tolerance_below", "tolerance below", "%", "Of the target contrast; empty for an open end.", shown=False,
           value=lambda row: row.tolerance("below")),
    Column("tolerance_above", "tolerance above", "%", "Of the target contrast; empty for an open end.", shown=False,
           value=lambda row: row.tolerance("above")),
    _cdp(Column("definition", "definition", "", "Definition of the contrast.", shown=False)),
    _cdp(Column("bright_pixels", "pixels, bright", "", "Pixels of the bright region.", shown=False),
         lambda one: getattr(one.result, "bright_size", None)),
    _cdp(Column("dark_pixels", "pixels, dark", "", "Pixels of the dark region.", shown=False),
         lambda one: getattr(one.result, "dark_size", None)),
    _cdp(Column("pairs", "pairs", "", "Pairs of neighbouring pixels.", shown=False)),
    _cdp(Column("correlation_inflation", "inflation", "", "Factor on u by noise that is correlated.", shown=False)),
)  # fmt: skip
_CDP_NOTE = (
    "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance of "
    "the target contrast; below and above are the shares to either side. CSNR is mean over standard deviation "
    "of the contrasts of all pairs. Uncertainties include the scatter of the pixels, also where that is "
    "correlated, and the calibration."
)


def cdp_table(pictures: Sequence[ReportedPicture], several: bool) -> Table:
    """Return CDP and contrasts, a row for each picture, pair and target contrast."""
    rows = [
        _Row(picture, pair, one)
        for picture in pictures
        if picture.evaluation is not None
        for pair in reported_contrasts(picture.evaluation)
        for one in _asked(pair)
    ]
    of_measured = any(row.one is not None and row.pair.of_measured for row in rows)
    hidden = set() if of_measured else {"contrast_origin"}
    if all(row.pair.csnr is None for row in rows):
        hidden.add("csnr")
    # Contrasts that were given are shown as they were written.
    as_written = () if of_measured else ("contrast", "detected_from", "detected_to")
    columns = [
        replace(one, shown=one.shown and one.name not in hidden, digits=0 if one.name in as_written else one.digits)
        for one in _CDP_COLUMNS
    ]
    return Table.of_items("cdp", "Contrast detection probability", _of_pictures(columns, several), rows, _CDP_NOTE)


def _asked(pair: ReportedContrast) -> Sequence[AnyCdp | None]:
    """Return the CDP of each target contrast; regions without any have a row for their contrast all the same."""
    return pair.results if pair.results or pair.bright is None else (None,)


def _of_pictures(columns: Sequence[Column], several: bool) -> tuple[Column, ...]:
    """Return the columns with picture and number: before them of several pictures, else behind."""
    return (_PICTURE, _NUMBER, *columns) if several else (*columns, replace(_PICTURE, shown=False), _NUMBER)


@dataclass(frozen=True)
class _RegionRow:
    picture: ReportedPicture
    evaluation: ImageEvaluation
    region: RegionResult


def _share_of(reason: str) -> Callable[[_RegionRow], float]:
    return lambda row: float(row.region.invalid_shares.get(reason, 0.0))


def region_table(pictures: Sequence[ReportedPicture], several: bool) -> Table:
    """Return the regions of each picture, by their mean."""
    rows = [
        _RegionRow(one, one.evaluation, region)
        for one in pictures
        if one.evaluation is not None
        for region in sorted(one.evaluation.regions, key=lambda region: region.mean)
    ]
    units = {row.evaluation.unit for row in rows}
    # Of files that hold luminance and others, each row has a unit of its own.
    unit, unit_of = (units.pop(), "") if len(units) == 1 else ("", "unit")
    reasons = {name for row in rows for name in row.region.invalid_shares}
    columns = (
        Column("region", "region", value="region.roi.name"),
        Column("pixels", "pixels", meaning="Number of its pixels, all of which count.", value="region.n_pixels"),
        *uncertain(Column("mean", "mean", unit, "Mean luminance.", unit_of=unit_of, value="region.mean"),
                   u="region.standard_uncertainty"),
        Column("std", "standard deviation", unit, "Of the pixels, with n - 1.", 3, unit_of=unit_of, value="region.std"),
        *uncertain(Column("snr", "spatial SNR", "", "Mean over standard deviation of the pixels.", 3,
                          value="region.snr.value"), u="region.snr.standard_error"),
        *(Column(name, name.replace("_", " "), "%", "Share of the pixels that are not valid for this reason.", 2,
                 shown=name in reasons, value=_share_of(name))
          for name in REASONS.values()),
        Column("unit", "unit", "", "Of mean and standard deviation.", shown=bool(unit_of), value="evaluation.unit"),
    )  # fmt: skip
    return Table.of_items("regions", "Regions", _of_pictures(columns, several), rows, detail=several)


def picture_table(pictures: Sequence[ReportedPicture], several: bool) -> Table:
    """Return the files, with what is known of them, and why those that failed have no result."""

    def known(column: Column, take: Callable[[ImageEvaluation], Any] | None = None) -> Column:
        found = take or (lambda evaluation: getattr(evaluation, column.name))
        return replace(column, value=lambda one: None if one.evaluation is None else found(one.evaluation))

    columns = (
        replace(_NUMBER, shown=True, value="number"),
        replace(_PICTURE, value="file"),
        known(Column("width_px", "width", "px"), lambda found: found.shape[1]),
        known(Column("height_px", "height", "px"), lambda found: found.shape[0]),
        known(Column("exposure_s", "exposure", "s", "Exposure time, where it is known.", time=True)),
        known(Column("encoding", "encoding", "", "How the values are taken to be encoded.")),
        known(Column("camera", "camera", "", "Camera, where the file states it.")),
        known(Column("unit", "unit", "", "Unit of the luminance.")),
        Column("folder", "folder", "", "Folder of its page.", shown=False, value=lambda one: one.folder or None),
        known(Column("sha256", "SHA-256", "", "Hash of the file.", shown=False)),
        Column("failure", "failure", "", "Why it has no result.", shown=any(one.evaluation is None for one in pictures),
               value=lambda one: one.failure if one.evaluation is None else None),
    )  # fmt: skip
    return Table.of_items("pictures", "Pictures" if several else "Picture", columns, pictures, detail=True)


def matrices(pictures: Sequence[ReportedPicture], request: ImageRequest, contrasts: Sequence[float]) -> Iterator[Table]:
    """Lay out CDP over contrasts with a column a picture, as the program of the 2018 thesis does, for each pair."""
    names = [(f"{bright} {dark}", f"{bright} / {dark}") for bright, dark in request.chosen_pairs]
    names += [("nearest-neighbour", "nearest-neighbour")] if request.neighbours else []
    found = [None if one.evaluation is None else reported_contrasts(one.evaluation) for one in pictures]
    first = Column("contrast", "target contrast", "%", "Contrast whose CDP is computed.")
    columns = [Column(f"picture_{one.number}", f"{one.number} {one.file}", decimals=5) for one in pictures]
    for number, (name, title) in enumerate(names):
        data: dict[str, Sequence[Any]] = {"contrast": list(contrasts)}
        for column, pairs in zip(columns, found, strict=True):
            missing = [None] * len(contrasts)
            data[column.name] = missing if pairs is None else [one.result.cdp for one in pairs[number].results]
        yield Table(f"cdp {name}", f"CDP, {title}", (first, *columns), data, matrix=True, detail=True)
