"""The results of a characterisation as files: page, spreadsheet, numbers and pictures."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..json_text import results_json
from .characterise_plots import (
    dark_figure,
    is_series,
    linearity_figure,
    photon_transfer_figure,
    sensitivity_figure,
    snr_figure,
)
from .characterise_sheets import characterisation_sheets
from .characterise_spatial_plots import (
    HIGH_PASS_SIDE,
    accumulated_figure,
    histogram_figure,
    profile_figure,
    spectrogram_figure,
)
from .characterise_tables import characterisation_table, note_facts, plain_words
from .digits import printable
from .document import Document, Section
from .facts import Fact
from .figures import ReportFigure
from .folder import write_files
from .page import document_page
from .workbook import workbook

if TYPE_CHECKING:
    from ..calibration.emva.result import Characterisation


def write_characterisation(result: Characterisation, folder: str | PathLike[str]) -> list[Path]:
    """Write a characterisation: for machines, for people, for spreadsheets, and its plots.

    Parameters
    ----------
    result : Characterisation
        What to write.
    folder : path
        Made if it does not exist; files of an earlier run are replaced.

    Returns
    -------
    list of Path
        characterisation.json, characterisation.html, characterisation.xlsx and figures/*.png.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    signal, spatial = _signal_figures(result), _spatial_figures(result)
    title = Path(result.source).parent.name or result.source if is_series(result) else result.source
    page = document_page(_document(result, title, signal, spatial))
    files = {
        "characterisation.json": results_json(characterisation_values(result)).encode(),
        "characterisation.html": page.encode(),
        "characterisation.xlsx": workbook(characterisation_sheets(result), title, datetime.now(UTC)),
        **{f"figures/{figure.file_name}": figure.png for figure in (*signal, *spatial)},
    }
    return write_files(Path(folder), files, r"characterise-.*\.png")


def characterisation_values(result: Characterisation) -> dict[str, Any]:
    """Return all numbers of a characterisation, for JSON."""
    return {**result.to_dict(), "versions": {name: version(name) for name in ("labcdp", "numpy", "scipy")}}


def _signal_figures(result: Characterisation) -> list[ReportFigure]:
    over = "photons" if is_series(result) else "exposure"
    drawn = [
        (
            "photon-transfer",
            photon_transfer_figure(result),
            "Photon transfer: temporal variance over mean, both above darkness. The slope of the line, fitted up to "
            "70 % of saturation, is the overall system gain K.",
        ),
        (
            "sensitivity",
            sensitivity_figure(result),
            f"Sensitivity: mean above darkness over {over}."
            + (" The slope, fitted up to 70 % of saturation, is the responsivity R." if is_series(result) else ""),
        ),
        (
            "linearity",
            linearity_figure(result),
            "Linearity: deviation from the line that minimises the relative deviations from 5 to 95 % of saturation.",
        ),
        (
            "snr",
            snr_figure(result),
            "Signal-to-noise ratio: measured, by the linear model, with the fixed pattern of all pixels, and of a "
            "sensor without noise of its own.",
        ),
        (
            "dark-current",
            dark_figure(result),
            "Darkness over the exposure. The slope of the mean over K, and that of the variance over K², are the dark "
            "current.",
        ),
    ]
    return [_figure(name, data, caption) for name, data, caption in drawn if data is not None]


def _spatial_figures(result: Characterisation) -> list[ReportFigure]:
    if result.spatial is None:
        return []
    box = f"{HIGH_PASS_SIDE} x {HIGH_PASS_SIDE} pixels"
    return [
        _figure(
            "histogram",
            histogram_figure(result),
            f"Logarithmic histograms of the pixels' deviations, the mean of {box} around each taken off. Pixels far "
            "from the normal curve, whose width comes from the middle half of the pixels, are defects.",
        ),
        _figure(
            "accumulated",
            accumulated_figure(result),
            f"Accumulated logarithmic histograms: share of the pixels beyond a deviation, the mean of {box} taken off.",
        ),
        _figure(
            "spectrogram",
            spectrogram_figure(result),
            "Spectrograms of the rows (horizontal) and columns (vertical): white noise is flat, periodic patterns are "
            "peaks, slow changes lie at the left.",
        ),
        _figure(
            "profile",
            profile_figure(result),
            "Profiles: mean, middle, lowest and highest row (horizontal) and column (vertical).",
        ),
    ]


def _figure(name: str, data: bytes, caption: str) -> ReportFigure:
    return ReportFigure(f"characterise-{name}.png", data, caption, caption)


def _document(
    result: Characterisation, title: str, signal: list[ReportFigure], spatial: list[ReportFigure]
) -> Document:
    size = f"{result.image_shape[1]} x {result.image_shape[0]} pixels, {result.bits} bits"
    facts = [
        Fact("Source", printable(result.source)),
        Fact("Camera", printable(result.camera) or "not told by the data set"),
        Fact("Images", size if result.gain_db is None else f"{size}, gain {result.gain_db:g} dB"),
        Fact("Temperature", "not known" if result.temperature_c is None else f"{result.temperature_c:.1f} °C"),
        Fact("Definitions", result.definition),
        Fact("Made by", f"labcdp {version('labcdp')}"),
    ]
    uncertainty = (
        "Uncertainties are standard uncertainties (one standard deviation). They come from the statistics of the fits: "
        "the temporal noise of the points, widened where the points scatter more than it explains."
    )
    sections = [
        Section("In plain words", plain_words(result)),
        Section("Values", (uncertainty,), (("Quantities after EMVA 1288", characterisation_table(result)),)),
        Section("Signal and noise", figures=signal),
        *([Section("Non-uniformity", figures=spatial)] if spatial else []),
        Section("How the values were found", facts=note_facts(result)),
        Section("Provenance", facts=facts),
    ]
    banner = f"Simulated camera: {printable(result.camera)}" if result.simulated else ""
    return Document("labcdp: characterisation after EMVA 1288", title, banner, list(result.flags), sections)
