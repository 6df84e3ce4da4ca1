"""A characterisation as sheets of a spreadsheet."""

from __future__ import annotations

from importlib.metadata import version
from math import isfinite
from typing import TYPE_CHECKING

from .characterise_tables import plain_words, quantity_rows
from .digits import decimals
from .workbook import Cell, Number, Sheet

if TYPE_CHECKING:
    from ..calibration.emva.result import Characterisation


def characterisation_sheets(result: Characterisation) -> list[Sheet]:
    """Return sheets of summary, series, darkness and provenance."""
    return [_summary(result), _series(result), _darks(result), _provenance(result)]


def _summary(result: Characterisation) -> Sheet:
    rows: list[tuple[Cell, ...]] = []
    for row in quantity_rows(result):
        known = isfinite(row.uncertainty) and row.uncertainty > 0
        n = decimals(row.uncertainty, 2) if known else decimals(row.value, 4)
        uncertainty = Number(row.uncertainty, n) if isfinite(row.uncertainty) else None
        rows.append((row.name, Number(row.value, n), uncertainty, row.unit or None, row.note or None))
    return Sheet("Summary", ("Quantity", "Value", "Standard uncertainty", "Unit", "Note"), rows)


def _series(result: Characterisation) -> Sheet:
    header = (
        "Patch",
        "Exposure in ms",
        "Photons",
        "Mean in DN",
        "Variance in DN²",
        "Mean of darkness in DN",
        "Variance of darkness in DN²",
        "Mean above darkness in DN",
        "Variance above darkness in DN²",
        "Its standard uncertainty in DN²",
        "Saturated in %",
        "Pixels",
        "Frames",
    )
    rows: list[tuple[Cell, ...]] = [
        (
            point.label or None,
            Number(1e3 * point.exposure_s, 4),
            None if point.photons is None else Number(point.photons, 0),
            *(
                Number(value, 4)
                for value in (
                    point.mean_dn,
                    point.variance_dn2,
                    point.dark_mean_dn,
                    point.dark_variance_dn2,
                    point.net_dn,
                    point.net_variance_dn2,
                    point.variance_uncertainty_dn2,
                )
            ),
            Number(100 * point.saturated_share, 3),
            Number(point.n_pixels, 0),
            Number(point.n_frames, 0),
        )
        for point in result.series
    ]
    return Sheet("Series", header, rows)


def _darks(result: Characterisation) -> Sheet:
    header = ("Exposure in ms", "Temperature in °C", "Mean in DN", "Variance in DN²", "Pixels", "Frames")
    rows: list[tuple[Cell, ...]] = [
        (
            Number(1e3 * point.exposure_s, 4),
            None if point.temperature_c is None else Number(point.temperature_c, 1),
            Number(point.mean_dn, 4),
            Number(point.variance_dn2, 4),
            Number(point.n_pixels, 0),
            Number(point.n_frames, 0),
        )
        for point in result.darks
    ]
    return Sheet("Darkness", header, rows)


def _provenance(result: Characterisation) -> Sheet:
    rows: list[tuple[Cell, ...]] = [
        ("Source", result.source),
        ("Camera", result.camera or "not known"),
        ("Simulated", "yes" if result.simulated else "no"),
        ("Definitions", result.definition),
        ("Bits", Number(result.bits, 0)),
        ("Height in pixels", Number(result.image_shape[0], 0)),
        ("Width in pixels", Number(result.image_shape[1], 0)),
        ("Gain in dB", None if result.gain_db is None else Number(result.gain_db, 2)),
        ("Temperature in °C", None if result.temperature_c is None else Number(result.temperature_c, 1)),
        ("labcdp", version("labcdp")),
        *(("In words", sentence) for sentence in plain_words(result)),
        *(("To mind", flag) for flag in result.flags),
    ]
    return Sheet("Provenance", ("What", "Value"), rows)
