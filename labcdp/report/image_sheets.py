"""Pictures as a spreadsheet: a column a picture as in the 2018 thesis, and a row a picture, pair and contrast."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from math import isfinite
from typing import TYPE_CHECKING

from ..errors import InputError
from .image_page import ReportedPicture
from .image_tables import where
from .workbook import Cell, Number, Sheet

if TYPE_CHECKING:
    from ..contrast import CalibratedCdp
    from ..evaluate.image import ImagePair, ImageRequest
    from ..evaluate.image_neighbours import CalibratedNeighbourCdp
    from ..evaluate.pair import RegionResult

#: Columns that a sheet can have, of which one is for the contrasts.
_MOST_PICTURES = 2**14 - 1
#: Characters that the name of a sheet cannot have, and its length.
_NOT_IN_TITLES, _LONGEST_TITLE = re.compile(r"[\[\]:*?/\\'\x00-\x1f]"), 31


def image_sheets(pictures: Sequence[ReportedPicture], request: ImageRequest, conversion: str) -> list[Sheet]:
    """Return the sheets: CDP with a column a picture for each pair, all numbers row by row, failures and provenance.

    Parameters
    ----------
    pictures : sequence of ReportedPicture
        In the order they were given; those that failed have an empty column.
    request : ImageRequest
        What was asked.
    conversion : str
        How values became luminance.

    Raises
    ------
    InputError
        If there are more pictures than a sheet has columns.
    """
    if len(pictures) > _MOST_PICTURES:
        raise InputError(
            f"{len(pictures)} pictures are more than the {_MOST_PICTURES} columns of a sheet: give fewer at a time"
        )
    failed = [picture for picture in pictures if picture.evaluation is None]
    failures: list[tuple[Cell, ...]] = [(Number(one.number, 0), one.file, one.failure) for one in failed]
    return [
        *_cdp_sheets(pictures, request),
        Sheet("Results", _HEADS, list(_rows(pictures, request.epsilon))),
        Sheet("Pictures", _PICTURE_HEADS, _picture_rows(pictures)),
        *([Sheet("Failures", ("Picture number", "File", "Why"), failures)] if failures else []),
        Sheet("Provenance", ("What", "Value"), [("Conversion", conversion), ("labcdp", version("labcdp"))]),
    ]


def _cdp_sheets(pictures: Sequence[ReportedPicture], request: ImageRequest) -> Iterator[Sheet]:
    """Lay out CDP over contrasts as the program of the 2018 thesis does, and the file names below."""
    titles: set[str] = set()
    pairs, evaluations = request.chosen_pairs, [picture.evaluation for picture in pictures]
    for number, pair in enumerate(pairs):
        title = "CDP" if len(pairs) == 1 else _title(f"CDP {pair[0]} {pair[1]}", titles)
        columns = [
            None
            if one.evaluation is None
            else [found.result.cdp for found in one.evaluation.pairs[number].result.results]
            for one in pictures
        ]
        yield _cdp_sheet(title, pictures, columns, request.contrasts)
    if request.neighbours:
        columns = [
            None if one is None or one.neighbours is None else [found.result.cdp for found in one.neighbours.results]
            for one in evaluations
        ]
        yield _cdp_sheet("CDP pixel to pixel", pictures, columns, request.contrasts)


def _cdp_sheet(
    title: str,
    pictures: Sequence[ReportedPicture],
    columns: Sequence[Sequence[float] | None],
    contrasts: Sequence[float],
) -> Sheet:
    rows: list[tuple[Cell, ...]] = [
        (_percent(contrast), *(None if column is None else Number(column[at], 5) for column in columns))
        for at, contrast in enumerate(contrasts)
    ]
    rows.append(("File", *(picture.file for picture in pictures)))
    return Sheet(title, ("Contrasts in %", *(f"Picture number {one.number}" for one in pictures)), rows, matrix=True)


def _title(text: str, taken: set[str]) -> str:
    """Make the name of a sheet: of allowed characters, short enough, and not taken."""
    plain = _NOT_IN_TITLES.sub(" ", text).strip()
    title, number = plain[:_LONGEST_TITLE], 1
    while title.lower() in taken:
        number += 1
        title = f"{plain[: _LONGEST_TITLE - 5]} ({number})"
    taken.add(title.lower())
    return title


def _percent(fraction: float, n_decimals: int = 2) -> Number:
    """Contrast in percent, without the last digits that a product of floats adds."""
    return Number(round(100 * fraction, 10) if isfinite(fraction) else fraction, n_decimals)


_DETECTION_HEADS = (
    "Contrast asked for in %",
    "Tolerance in %",
    "Detected from in %",
    "Detected to in %",
    "CDP",
    "CDP, standard uncertainty",
    "CDP, of which by the pixels",
    "CDP, of which by the calibration",
    "CDP, 95 % from",
    "CDP, 95 % to",
    "Share below",
    "Share above",
    "Share undefined",
)
_PAIR_HEADS = (
    "Measured contrast in %",
    "Measured contrast, standard uncertainty in %",
    "CSNR",
    "CSNR, standard uncertainty",
)


_REGION_HEADS = (
    "region",
    "pixels",
    "mean",
    "mean, standard uncertainty",
    "standard deviation",
    "SNR",
    "SNR, standard uncertainty",
    "saturated in %",
    "not valid otherwise, largest in %",
)
_HEADS = (
    "Picture number",
    "File",
    "Pixels",
    *_DETECTION_HEADS,
    *_PAIR_HEADS,
    "Unit",
    *(f"{which}: {what}" for which in ("Bright", "Dark") for what in _REGION_HEADS),
)


def _rows(pictures: Sequence[ReportedPicture], epsilon: float) -> Iterator[tuple[Cell, ...]]:
    for picture in pictures:
        evaluation = picture.evaluation
        if evaluation is None:
            continue
        start = (Number(picture.number, 0), picture.file)
        for pair in evaluation.pairs:
            for one in pair.result.results:
                yield (
                    *start,
                    "region to region",
                    *_detection(one, epsilon),
                    *_of_pair(pair),
                    evaluation.unit,
                    *_of_region(pair.result.bright_region),
                    *_of_region(pair.result.dark_region),
                )
        if evaluation.neighbours is not None:
            for near in evaluation.neighbours.results:
                yield (
                    *start,
                    f"pixel to pixel, {where(evaluation.neighbours.rectangle)}",
                    *_detection(near, epsilon),
                    *(None,) * len(_PAIR_HEADS),
                    evaluation.unit,
                    *(None,) * (2 * len(_REGION_HEADS)),
                )


def _detection(one: CalibratedCdp | CalibratedNeighbourCdp, epsilon: float) -> tuple[Cell, ...]:
    result = one.result
    return (
        _percent(result.contrast),
        _percent(epsilon),
        _percent(result.interval[0]),
        _percent(result.interval[1]),
        Number(result.cdp, 5),
        Number(one.standard_uncertainty, 5),
        Number(result.standard_error, 5),
        Number(one.calibration_standard_uncertainty, 5),
        Number(one.confidence_interval[0], 5),
        Number(one.confidence_interval[1], 5),
        Number(result.below, 5),
        Number(result.above, 5),
        Number(result.undefined, 5),
    )


def _of_pair(pair: ImagePair) -> tuple[Cell, ...]:
    result = pair.result
    return (
        _percent(result.contrast.value),
        _percent(result.contrast.standard_error),
        Number(result.csnr.value, 3),
        Number(result.csnr.standard_error, 3),
    )


def _of_region(region: RegionResult) -> tuple[Cell, ...]:
    shares = dict(region.invalid_shares)
    saturated = shares.pop("saturated", 0.0)
    return (
        region.roi.name,
        Number(region.n_pixels, 0),
        Number(region.mean, 5),
        Number(region.standard_uncertainty, 5),
        Number(region.std, 5),
        Number(region.snr.value, 3),
        Number(region.snr.standard_error, 3),
        _percent(saturated),
        _percent(max(shares.values(), default=0.0)),
    )


_PICTURE_HEADS = (
    "Picture number",
    "File",
    "Exposure in s",
    "Camera",
    "Width in pixels",
    "Height in pixels",
    "Warnings",
    "What was done with the values",
    "SHA-256",
)


def _picture_rows(pictures: Sequence[ReportedPicture]) -> list[tuple[Cell, ...]]:
    return [
        (
            Number(one.number, 0),
            one.file,
            None if one.evaluation.exposure_s is None else Number(one.evaluation.exposure_s, 6),
            one.evaluation.camera,
            Number(one.evaluation.shape[1], 0),
            Number(one.evaluation.shape[0], 0),
            "; ".join(one.evaluation.warnings),
            "; ".join(one.evaluation.notes),
            one.evaluation.sha256,
        )
        for one in pictures
        if one.evaluation is not None
    ]
