"""The tables of a simulated chain as text."""

from __future__ import annotations

from math import isfinite, isinf, isnan
from typing import TYPE_CHECKING

from ..contrast import DetectionResult, Estimate
from .digits import UNKNOWN, cdp_decimals, cdp_interval, decimals, fixed, percent, share_percent
from .tables import Table

if TYPE_CHECKING:
    from ..evaluate import SimulationEvaluation

#: What stands where there is nothing to tell.
NONE = "-"

#: A ratio above it is not noise but the rounding of float32.
_ROUNDING_ONLY = 1e6


def signal_table(evaluation: SimulationEvaluation) -> Table:
    """Signal, noise and luminance of each region behind each stage."""
    rows = [
        (
            f"{stage.name}: {row.region}",
            stage.unit.replace("^2", "²"),
            number(row.mean),
            number(row.standard_deviation),
            ratio(row.snr),
            decibels(row.snr_10log10_db),
            decibels(row.snr_20log10_db),
            number(row.true_cd_m2),
            number(row.luminance_cd_m2),
            ratio(row.luminance_snr),
            share_percent(row.saturated_share) if row.saturated_share else NONE,
        )
        for stage in evaluation.stages
        for row in stage.regions
    ]
    columns = (
        "stage: region",
        "unit",
        "mean",
        "std",
        "SNR",
        "10 lg SNR (dB)",
        "20 lg SNR (dB)",
        "scene (cd/m²)",
        "seen (cd/m²)",
        "SNR of cd/m²",
        "saturated",
    )
    return Table(columns, tuple(rows))


def detection_table(evaluation: SimulationEvaluation) -> Table:
    """Contrast and its detection probability for each pair of regions behind each stage."""
    neighbours = any(pair.neighbours for stage in evaluation.stages for pair in stage.pairs)
    rows = []
    for stage in evaluation.stages:
        for pair in stage.pairs:
            several = len(stage.pairs) > 1
            name = f"{stage.name}: {pair.bright} / {pair.dark}" if several else stage.name
            row = [name, percent(pair.true_contrast), contrast(pair.measured_contrast), *_detection(pair.cdp)]
            if neighbours:
                row += [_cdp(pair.neighbours)]
            rows.append((*row, ratio(pair.csnr), ratio(pair.cnr), ratio(pair.d_prime)))
    columns = ["stage", "contrast of the scene", "seen", "CDP", "95 %", "below", "above"]
    if neighbours:
        columns.append("CDP pixel to pixel")
    return Table((*columns, "CSNR", "CNR", "d'"), tuple(rows))


def number(value: float) -> str:
    """Write a value with four significant digits, very large and small ones with a power of ten."""
    return f"{value:.4g}" if isfinite(value) else UNKNOWN


def ratio(estimate: Estimate) -> str:
    """Write a ratio with the digits its standard error supports."""
    value, error = estimate.value, estimate.standard_error
    if isinf(value):
        return "∞"
    if value > _ROUNDING_ONLY:
        return f"> {_ROUNDING_ONLY:.0e}".replace("e+0", "e")
    if isnan(value):
        return NONE
    n = decimals(error, 2) if error > 0 else decimals(value, 4)
    return fixed(value, max(0, min(n, decimals(value, 4)))) if abs(value) < 1e5 else f"{value:.3g}"


def decibels(estimate: Estimate) -> str:
    """Write decibels."""
    if isinf(estimate.value):
        return "∞" if estimate.value > 0 else "-∞"
    return NONE if isnan(estimate.value) else fixed(estimate.value, 2)


def contrast(fraction: float) -> str:
    """Write a contrast as percent with four digits."""
    return f"{100 * fraction:.4g} %" if isfinite(fraction) else NONE


def _detection(result: DetectionResult | None) -> tuple[str, str, str, str]:
    if result is None:
        return NONE, NONE, NONE, NONE
    return _cdp(result), cdp_interval(result), share_percent(result.below), share_percent(result.above)


def _cdp(result: DetectionResult | None) -> str:
    return NONE if result is None else fixed(result.cdp, cdp_decimals(result))
