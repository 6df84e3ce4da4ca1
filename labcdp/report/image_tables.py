"""Tables of pictures as text: for the pages and for the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite, isinf
from typing import TYPE_CHECKING

from ..contrast import Estimate
from .digits import Z_95, cdp_decimals, cdp_interval, decimals, fixed, printable, share_percent, with_half_width
from .tables import Table

if TYPE_CHECKING:
    from ..contrast import CalibratedCdp, DetectionResult
    from ..evaluate.image import ImageEvaluation, ImagePair
    from ..evaluate.image_neighbours import CalibratedNeighbourCdp
    from ..evaluate.pair import RegionResult

_DETECTION_HEADS = ("contrast asked (%)", "counts as detected (%)", "CDP (95 % interval)", "below", "above")


def unit_text(unit: str) -> str:
    """Write a unit as it is printed."""
    return unit.replace("^2", "²")


def region_table(evaluation: ImageEvaluation) -> Table:
    """Regions of a picture: mean with the half width of its 95 % interval, scatter and SNR."""
    unit = unit_text(evaluation.unit)
    return Table(
        columns=("region", "pixels", f"mean ({unit})", f"standard deviation ({unit})", "SNR (mean/std)", "not valid"),
        rows=tuple(_region_row(region) for region in evaluation.regions),
    )


def _region_row(region: RegionResult) -> tuple[str, ...]:
    reasons = ", ".join(f"{share_percent(share)} {reason}" for reason, share in region.invalid_shares.items())
    return (
        printable(region.roi.name),
        str(region.n_pixels),
        estimate_text(Estimate(region.mean, region.standard_uncertainty)),
        fixed(region.std, decimals(region.std, 3)),
        estimate_text(region.snr),
        reasons or "-",
    )


def pair_table(evaluation: ImageEvaluation) -> Table:
    """Contrasts of the pairs of a picture, a row for each contrast that was asked for."""
    return Table(
        columns=("bright / dark region", "measured contrast (%)", *_DETECTION_HEADS, "CSNR"),
        rows=tuple(
            (
                printable(pair.name),
                measured_contrast(pair),
                *detection_cells(joined(one)),
                estimate_text(pair.result.csnr),
            )
            for pair in evaluation.pairs
            for one in pair.result.results
        ),
    )


def neighbour_table(evaluation: ImageEvaluation) -> Table:
    """CDP from pixel to pixel, a row for each contrast."""
    assert evaluation.neighbours is not None
    found = evaluation.neighbours
    return Table(
        columns=("pixels", *_DETECTION_HEADS),
        rows=tuple((where(found.rectangle), *detection_cells(joined(one))) for one in found.results),
    )


def overview_table(evaluations: Sequence[ImageEvaluation]) -> Table:
    """Pictures one below the other, a row for each pair and contrast."""
    rows = []
    for evaluation in evaluations:
        file = printable(str(evaluation.path))
        for pair in evaluation.pairs:
            rows += [
                (file, printable(pair.name), measured_contrast(pair), *detection_cells(joined(one)))
                for one in pair.result.results
            ]
        if evaluation.neighbours is not None:
            rows += [
                (
                    file,
                    f"pixel to pixel, {where(evaluation.neighbours.rectangle)}",
                    "-",
                    *detection_cells(joined(one)),
                )
                for one in evaluation.neighbours.results
            ]
    return Table(("picture", "bright / dark region", "measured contrast (%)", *_DETECTION_HEADS), tuple(rows))


def where(rectangle: tuple[int, int, int, int] | None) -> str:
    """Say which pixels CDP from pixel to pixel is of."""
    if rectangle is None:
        return "whole picture"
    x0, y0, x1, y1 = rectangle
    return f"({x0}, {y0}) to ({x1}, {y1})"


def joined(one: CalibratedCdp | CalibratedNeighbourCdp) -> DetectionResult:
    """CDP with the interval by pixels and calibration together."""
    return replace(one.result, confidence_interval=one.confidence_interval)


def detection_cells(result: DetectionResult) -> tuple[str, ...]:
    """Write contrast, interval, CDP with its 95 % interval, and the shares below and above."""
    low, high = result.interval
    n = cdp_decimals(result)
    known = isfinite(result.confidence_interval[0])
    return (
        f"{100 * result.contrast:.6g}",
        f"{100 * low:.6g} to {100 * high:.6g}",
        f"{fixed(result.cdp, n)} ({cdp_interval(result)})" if known else fixed(result.cdp, n),
        fixed(result.below, n),
        fixed(result.above, n),
    )


def measured_contrast(pair: ImagePair) -> str:
    """Write the contrast of the means in percent, with the half width of its 95 % interval."""
    return estimate_text(pair.result.contrast, 100.0)


def estimate_text(estimate: Estimate, factor: float = 1.0) -> str:
    """Write a value, times a factor, with the half width of its 95 % interval; "∞" and "-" where it has none."""
    value, half_width = factor * estimate.value, factor * Z_95 * estimate.standard_error
    if not isfinite(value):
        return "∞" if isinf(value) and value > 0 else "-"
    return with_half_width(value, half_width) if isfinite(half_width) else fixed(value, decimals(value, 4))
