"""The tables of pictures: CDP, regions, files, and a column a picture as in the 2018 thesis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from ...core.table import Column, Table, uncertain, uncertain_values
from ...metrics import CalibratedCdp, CdpResult, DetectionInterval, DetectionResult, NeighbourCdp
from ...metrics.pair import RegionResult
from ...metrics.region import REASONS
from .image import ImageEvaluation, ImagePair, ImageRequest
from .neighbours import NeighbourEvaluation, Rectangle

#: CDP of two regions, or of neighbouring pixels.
AnyCdp: TypeAlias = CalibratedCdp[CdpResult] | CalibratedCdp[NeighbourCdp]

_PICTURE = Column("picture", "picture", meaning="Name of the file.")
_NUMBER = Column("number", "number", meaning="Number of the picture, in the order given.", shown=False)
_CDP_COLUMNS = (
    Column("pair", "bright / dark region", meaning="The two regions, or which neighbouring pixels."),
    Column("bright", "bright region", shown=False),
    Column("dark", "dark region", shown=False),
    *uncertain(Column("measured_contrast", "measured contrast", "%", "Weber contrast of the means.")),
    Column(
        "u_measured_contrast_pixels", "u of measured contrast, pixels", "%", "Its part by the pixels.", 2, shown=False
    ),
    Column("contrast", "target contrast", "%", "Contrast whose CDP is computed."),
    Column("contrast_origin", "origin", "", "Where the target contrast comes from: given, or measured."),
    Column("detected_from", "detected from", "%", "Lowest contrast of a pair of pixels that counts as detected."),
    Column("detected_to", "detected to", "%", "Highest contrast of a pair of pixels that counts as detected."),
    Column("cdp", "CDP", "", "Share of the pairs of pixels that are detected.", low="cdp_low", high="cdp_high"),
    Column(
        "cdp_low", "CDP, low", "", "Lower end of the 95 % interval, by pixels and calibration.", decimals=5, shown=False
    ),
    Column("cdp_high", "CDP, high", "", "Upper end of the 95 % interval.", decimals=5, shown=False),
    Column("u_cdp", "u of CDP", "", "Standard uncertainty, by pixels and calibration.", 2, shown=False),
    Column("u_cdp_pixels", "u of CDP, pixels", "", "Its part by the pixels.", 2, shown=False),
    Column("u_cdp_calibration", "u of CDP, calibration", "", "Its part by the calibration.", 2, shown=False),
    Column("below", "below", "", "Share of the pairs with a lower contrast.", decimals=4),
    Column("above", "above", "", "Share of the pairs with a higher contrast.", decimals=4),
    Column("undefined", "undefined", "", "Share of the pairs without light; they are below.", shown=False),
    *uncertain(Column("csnr", "CSNR", "", "Mean over standard deviation of the contrasts of all pairs of pixels.", 3)),
    Column("tolerance_below", "tolerance below", "%", "Of the target contrast; empty for an open end.", shown=False),
    Column("tolerance_above", "tolerance above", "%", "Of the target contrast; empty for an open end.", shown=False),
    Column("definition", "definition", "", "Definition of the contrast.", shown=False),
    Column("bright_pixels", "pixels, bright", "", "Pixels of the bright region.", shown=False),
    Column("dark_pixels", "pixels, dark", "", "Pixels of the dark region.", shown=False),
    Column("pairs", "pairs", "", "Pairs of neighbouring pixels.", shown=False),
    Column("correlation_inflation", "inflation", "", "Factor on u by noise that is correlated.", shown=False),
)


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


def combined(one: AnyCdp) -> DetectionResult:
    """CDP with the interval by pixels and calibration together."""
    return replace(one.result, confidence_interval=one.confidence_interval)


def neighbour_name(rectangle: Rectangle | None) -> str:
    """Return which pixels a nearest-neighbour CDP is of."""
    if rectangle is None:
        return "nearest-neighbour, whole picture"
    x0, y0, x1, y1 = rectangle
    return f"nearest-neighbour, ({x0}, {y0}) to ({x1}, {y1})"


def cdp_table(pictures: Sequence[ReportedPicture], several: bool) -> Table:
    """Return CDP and contrasts, a row for each picture, pair and target contrast."""
    rows = [
        {"picture": one.file, "number": one.number, **row}
        for one in pictures
        for row in _cdp_rows(one.evaluation)
        if one.evaluation is not None
    ]
    of_measured = any(row.get("contrast_origin") == "measured" for row in rows)
    hidden = set() if of_measured else {"contrast_origin"}
    if all(row.get("csnr") is None for row in rows):
        hidden.add("csnr")
    # Contrasts that were given are shown as they were written.
    digits = {} if of_measured else dict.fromkeys(("contrast", "detected_from", "detected_to"), 0)
    columns = [
        replace(one, shown=one.shown and one.name not in hidden, digits=digits.get(one.name, one.digits))
        for one in _CDP_COLUMNS
    ]
    note = (
        "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance of "
        "the target contrast; below and above are the shares to either side. CSNR is mean over standard deviation "
        "of the contrasts of all pairs. Uncertainties include the scatter of the pixels, also where that is "
        "correlated, and the calibration."
    )
    return Table.of_rows("cdp", "Contrast detection probability", _of_pictures(columns, several), rows, note)


def _of_pictures(columns: Sequence[Column], several: bool) -> tuple[Column, ...]:
    """Return the columns with picture and number: before them of several pictures, else behind."""
    return (_PICTURE, _NUMBER, *columns) if several else (*columns, replace(_PICTURE, shown=False), _NUMBER)


def _cdp_rows(evaluation: ImageEvaluation | None) -> Iterator[dict[str, Any]]:
    if evaluation is None:
        return
    for pair in evaluation.pairs:
        if not pair.result.results:
            yield _pair_values(pair)
        for one in pair.result.results:
            yield {**_pair_values(pair), **_cdp_values(one, pair.result.of_measured_contrast)}
    if evaluation.neighbours is not None:
        for near in evaluation.neighbours.results:
            yield {**_neighbour_values(evaluation.neighbours), **_cdp_values(near, _of_measured(evaluation.neighbours))}


def _of_measured(near: NeighbourEvaluation) -> bool:
    return [one.result.contrast for one in near.results] == [near.contrast]


def _pair_values(pair: ImagePair) -> dict[str, Any]:
    contrast, csnr = pair.result.contrast, pair.result.csnr
    return {
        "pair": pair.name,
        "bright": pair.result.bright_region.roi.name,
        "dark": pair.result.dark_region.roi.name,
        **uncertain_values("measured_contrast", contrast.value, contrast.standard_error),
        "u_measured_contrast_pixels": pair.result.contrast_pixels,
        **uncertain_values("csnr", csnr.value, csnr.standard_error),
    }


def _neighbour_values(near: NeighbourEvaluation) -> dict[str, Any]:
    return {"pair": neighbour_name(near.rectangle), "measured_contrast": near.contrast}


def _cdp_values(one: AnyCdp, of_measured: bool) -> dict[str, Any]:
    result = one.result
    epsilon = result.epsilon
    below, above = (epsilon.below, epsilon.above) if isinstance(epsilon, DetectionInterval) else (epsilon, epsilon)
    return {
        "contrast": result.contrast,
        "contrast_origin": "measured" if of_measured else "given",
        "detected_from": result.interval[0],
        "detected_to": result.interval[1],
        "cdp": result.cdp,
        "cdp_low": one.confidence_interval[0],
        "cdp_high": one.confidence_interval[1],
        "u_cdp": one.standard_uncertainty,
        "u_cdp_pixels": result.standard_error,
        "u_cdp_calibration": one.calibration_standard_uncertainty,
        "below": result.below,
        "above": result.above,
        "undefined": result.undefined,
        "tolerance_below": below,
        "tolerance_above": above,
        "definition": result.definition,
        "bright_pixels": getattr(result, "bright_size", None),
        "dark_pixels": getattr(result, "dark_size", None),
        "pairs": getattr(result, "pairs", None),
        "correlation_inflation": getattr(result, "correlation_inflation", None),
    }


def region_table(pictures: Sequence[ReportedPicture], several: bool) -> Table:
    """Return the regions of each picture, by their mean."""
    rows = []
    for one in pictures:
        assert one.evaluation is not None
        for region in sorted(one.evaluation.regions, key=lambda region: region.mean):
            values = {**_region_values(region), "unit": one.evaluation.unit}
            rows.append({"picture": one.file, "number": one.number, **values})
    units = {row["unit"] for row in rows}
    # Of files that hold luminance and others, each row has a unit of its own.
    unit, unit_of = (units.pop(), "") if len(units) == 1 else ("", "unit")
    reasons = {name for row in rows for name in REASONS.values() if row[name]}
    columns = (
        Column("region", "region"),
        Column("pixels", "pixels", meaning="Number of its pixels, all of which count."),
        *uncertain(Column("mean", "mean", unit, "Mean luminance.", unit_of=unit_of)),
        Column("std", "standard deviation", unit, "Of the pixels, with n - 1.", 3, unit_of=unit_of),
        *uncertain(Column("snr", "spatial SNR", "", "Mean over standard deviation of the pixels.", 3)),
        *(
            Column(name, name.replace("_", " "), "%", "Share of the pixels that are not valid for this reason.", 2,
                   shown=name in reasons)
            for name in REASONS.values()
        ),
        Column("unit", "unit", "", "Of mean and standard deviation.", shown=bool(unit_of)),
    )  # fmt: skip
    return Table.of_rows("regions", "Regions", _of_pictures(columns, several), rows, detail=several)


def _region_values(region: RegionResult) -> dict[str, Any]:
    return {
        "region": region.roi.name,
        "pixels": region.n_pixels,
        **uncertain_values("mean", region.mean, region.standard_uncertainty),
        "std": region.std,
        **uncertain_values("snr", region.snr.value, region.snr.standard_error),
        **{name: region.invalid_shares.get(name, 0.0) for name in REASONS.values()},
    }


def picture_table(pictures: Sequence[ReportedPicture], several: bool) -> Table:
    """Return the files, with what is known of them, and why those that failed have no result."""
    rows = []
    for one in pictures:
        found = one.evaluation
        row: dict[str, Any] = {"picture": one.file, "number": one.number, "folder": one.folder or None}
        if found is None:
            row["failure"] = one.failure
        else:
            height, width = found.shape
            row |= {"width_px": width, "height_px": height, "exposure_s": found.exposure_s, "camera": found.camera}
            row |= {"unit": found.unit, "sha256": found.sha256}
        rows.append(row)
    columns = (
        replace(_NUMBER, shown=True),
        _PICTURE,
        Column("width_px", "width", "px"),
        Column("height_px", "height", "px"),
        Column("exposure_s", "exposure", "s", "Exposure time, where it is known.", time=True),
        Column("camera", "camera", "", "Camera, where the file states it."),
        Column("unit", "unit", "", "Unit of the luminance."),
        Column("folder", "folder", "", "Folder of its page.", shown=False),
        Column("sha256", "SHA-256", "", "Hash of the file.", shown=False),
        Column("failure", "failure", "", "Why it has no result.", shown=any("failure" in row for row in rows)),
    )
    return Table.of_rows("pictures", "Pictures" if several else "Picture", columns, rows, detail=True)


def matrices(pictures: Sequence[ReportedPicture], request: ImageRequest, contrasts: Sequence[float]) -> Iterator[Table]:
    """Lay out CDP over contrasts with a column a picture, as the program of the 2018 thesis does, for each pair."""
    for number, (bright, dark) in enumerate(request.chosen_pairs):
        cdps = [None if one.evaluation is None else one.evaluation.pairs[number].result.results for one in pictures]
        yield _matrix(f"cdp {bright} {dark}", f"CDP, {bright} / {dark}", pictures, cdps, contrasts)
    if request.neighbours:
        near = [None if one.evaluation is None else one.evaluation.neighbours for one in pictures]
        cdps_near = [None if one is None else one.results for one in near]
        yield _matrix("cdp nearest-neighbour", "CDP, nearest-neighbour", pictures, cdps_near, contrasts)


def _matrix(
    name: str,
    title: str,
    pictures: Sequence[ReportedPicture],
    cdps: Sequence[Sequence[AnyCdp] | None],
    contrasts: Sequence[float],
) -> Table:
    first = Column("contrast", "target contrast", "%", "Contrast whose CDP is computed.")
    columns = [Column(f"picture_{one.number}", f"{one.number} {one.file}", decimals=5) for one in pictures]
    data: dict[str, Sequence[Any]] = {"contrast": list(contrasts)}
    for column, found in zip(columns, cdps, strict=True):
        data[column.name] = [None] * len(contrasts) if found is None else [one.result.cdp for one in found]
    return Table(name, title, (first, *columns), data, matrix=True, detail=True)
