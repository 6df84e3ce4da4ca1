"""The results of a simulated chain as sheets of a spreadsheet."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version
from typing import TYPE_CHECKING

from ..toml_text import toml_text
from .workbook import Cell, Number, Sheet

if TYPE_CHECKING:
    from ..evaluate import SimulationEvaluation


def simulation_sheets(evaluation: SimulationEvaluation) -> list[Sheet]:
    """Return sheets of detection, signal, chain file and provenance."""
    signal: list[tuple[Cell, ...]] = [
        (
            stage.name,
            row.region,
            stage.unit,
            Number(row.mean, 4),
            Number(row.standard_deviation, 4),
            Number(row.snr.value, 3),
            Number(row.snr.standard_error, 3),
            Number(row.snr_10log10_db.value, 3),
            Number(row.snr_20log10_db.value, 3),
            Number(row.true_cd_m2, 4),
            Number(row.luminance_cd_m2, 4),
            Number(row.luminance_standard_deviation_cd_m2, 4),
            Number(row.luminance_snr.value, 3),
            Number(100 * row.saturated_share, 3),
        )
        for stage in evaluation.stages
        for row in stage.regions
    ]
    signal_head = (
        "Stage",
        "Region",
        "Unit",
        "Mean",
        "Standard deviation",
        "SNR (mean/std)",
        "Standard error of SNR",
        "10 lg SNR in dB",
        "20 lg SNR in dB",
        "Scene in cd/m²",
        "Seen in cd/m²",
        "Standard deviation in cd/m²",
        "SNR of cd/m²",
        "Saturated in %",
    )
    return [
        Sheet("Detection", _DETECTION_HEAD, list(_detection_rows(evaluation))),
        Sheet("Signal", signal_head, signal),
        Sheet("Chain", ("Chain file",), [(line,) for line in toml_text(evaluation.chain.document).splitlines()]),
        Sheet(
            "Provenance",
            ("What", "Value"),
            [
                ("Chain", evaluation.chain.name),
                ("Seed", Number(evaluation.seed, 0)),
                ("labcdp", version("labcdp")),
                *(("Warning", warning) for warning in evaluation.warnings),
            ],
        ),
    ]


_DETECTION_HEAD = (
    "Stage",
    "Bright",
    "Dark",
    "Contrast of the scene in %",
    "Seen in %",
    "CDP",
    "Standard error",
    "95 % from",
    "95 % to",
    "Below",
    "Above",
    "CDP pixel to pixel",
    "Standard error pixel to pixel",
    "CSNR",
    "CNR",
    "d'",
)


def _detection_rows(evaluation: SimulationEvaluation) -> Iterator[tuple[Cell, ...]]:
    for stage in evaluation.stages:
        for pair in stage.pairs:
            cdp, pixel = pair.cdp, pair.neighbours
            yield (
                stage.name,
                pair.bright,
                pair.dark,
                Number(100 * pair.true_contrast, 2),
                Number(100 * pair.measured_contrast, 2),
                *(
                    (None,) * 6
                    if cdp is None
                    else (
                        Number(cdp.cdp, 5),
                        Number(cdp.standard_error, 5),
                        Number(cdp.confidence_interval[0], 5),
                        Number(cdp.confidence_interval[1], 5),
                        Number(cdp.below, 5),
                        Number(cdp.above, 5),
                    )
                ),
                *((None, None) if pixel is None else (Number(pixel.cdp, 5), Number(pixel.standard_error, 5))),
                Number(pair.csnr.value, 3),
                Number(pair.cnr.value, 3),
                Number(pair.d_prime.value, 3),
            )
