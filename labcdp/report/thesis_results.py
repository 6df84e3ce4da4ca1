"""The reproduction of the 2018 thesis as tables, page, spreadsheet, numbers and picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..json_text import results_json
from .digits import fixed, percent
from .document import Document, Section
from .drawing import BLUE, SMALL_SIZE, VERMILLION, label, new_figure, png
from .facts import Fact
from .figures import ReportFigure
from .folder import write_files
from .page import document_page
from .tables import Table
from .workbook import Cell, Number, Sheet, workbook

if TYPE_CHECKING:
    from ..evaluate import ReproducedRow, ThesisReproduction

_SOURCE = "L. Ebbert, Implementierung von CDP, HS Düsseldorf, 2018"

_COLUMNS = (
    "setting",
    "thesis",
    "ours, with the thesis' physics",
    "z",
    "all pairs filled",
    "correct physics",
    "region to region, exact",
)

_HEAD = (
    "Setting",
    "Contrast in %",
    "Dark squares in cd/m²",
    "Temperature in °C",
    "Exposure in ms",
    "Pixel pitch in µm",
    "Thesis",
    "Ours with the thesis' physics, mean",
    "Standard deviation",
    "z",
    "All pairs filled, mean",
    "Correct physics, mean",
    "Standard deviation with correct physics",
    "Correct physics, region to region, exact",
    "Explanation",
)

#: Beyond so many standard deviations a value is not reproduced.
_AGREES_Z = 2.0


def thesis_table(result: ThesisReproduction) -> Table:
    """Table 5.3 beside our values."""
    return Table(_COLUMNS, tuple(_row(row) for row in result.table))


def figure_table(result: ThesisReproduction) -> Table:
    """Figure 3.10's value beside ours."""
    return Table(_COLUMNS, tuple(_row(row) for row in result.figure))


def thesis_values(result: ThesisReproduction) -> dict[str, Any]:
    """Return all numbers of the reproduction, for JSON."""
    return {
        "source": _SOURCE,
        "seeds": result.seeds,
        "table_5_3": [asdict(row) for row in result.table],
        "figure_3_10": [asdict(row) for row in result.figure],
        "intensity_sweep": {name: values.tolist() for name, values in vars(result.sweep).items()},
        "versions": {name: version(name) for name in ("labcdp", "numpy", "scipy")},
    }


def write_thesis(result: ThesisReproduction, folder: str | PathLike[str]) -> list[Path]:
    """Write the reproduction: for machines, for people, for spreadsheets, and the sweep as a picture.

    Parameters
    ----------
    result : ThesisReproduction
        What to write.
    folder : path
        Made if it does not exist; files of an earlier run are replaced.

    Returns
    -------
    list of Path
        results.json, report.html, results.xlsx and figures/intensity-sweep.png.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    figure = ReportFigure(
        "intensity-sweep.png",
        _sweep_figure(result),
        "CDP and SNR over the luminance of the dark squares: contrast 100 %, 100 °C, 5 ms, 2 µm, glare 20 %. Above the "
        "full well nothing is detected although the thesis' SNR is infinite there, which is why it asks for CDP.",
        "Two curves each of CDP and of SNR over luminance, with the thesis' physics and with the correct one.",
    )
    files = {
        "results.json": results_json(thesis_values(result)).encode(),
        "report.html": document_page(_document(result, figure)).encode(),
        "results.xlsx": workbook(_sheets(result), f"Reproduction of {_SOURCE}", datetime.now(UTC)),
        f"figures/{figure.file_name}": figure.png,
    }
    return write_files(Path(folder), files)


def _row(row: ReproducedRow) -> tuple[str, ...]:
    setting = row.published
    label = (
        f"{setting.label}: {percent(setting.contrast)}, {setting.luminance_cd_m2:g} cd/m², "
        f"{setting.temperature_c:g} °C, {1e3 * setting.exposure_s:g} ms, {1e6 * setting.pixel_pitch_m:g} µm"
    )
    without_noise = row.standard_deviation == 0
    return (
        label,
        fixed(setting.published_cdp, 8 if without_noise else 5),
        fixed(row.mean, 8) if without_noise else _with_deviation(row.mean, row.standard_deviation),
        fixed(row.z, 2, sign=True),
        fixed(row.all_pairs_mean, 5),
        _with_deviation(row.corrected_mean, row.corrected_standard_deviation),
        fixed(row.corrected_exact, 5),
    )


def _with_deviation(mean: float, deviation: float) -> str:
    return f"{fixed(mean, 5)} ± {fixed(deviation, 5)}"


def _document(result: ThesisReproduction, figure: ReportFigure) -> Document:
    close = sum(abs(row.z) <= _AGREES_Z for row in result.table)
    explained = [
        f"Row {row.published.label}: {row.published.explanation}." for row in result.table if row.published.explanation
    ]
    sections = [
        Section(
            "Table 5.3",
            (
                f"{close} of {len(result.table)} published values lie within {_AGREES_Z:g} standard deviations of ours "
                f"over {result.seeds} seeds.",
                "All values are pixel to pixel, each pixel against its right and its lower neighbour, except the last "
                "column; ± is the standard deviation over the seeds, z the distance of the published value from our "
                "mean in such deviations. Ours: the thesis' chain with its own noise, photon constant and windscreen, "
                "and with the 418 of 252 119 contrasts that its program never fills counted as not detected. All pairs "
                "filled: the same without those. Correct physics: light of D65 with its shot noise, a fixed pattern "
                "that is fixed, rounding, and glare taken off as it was added; each seed is another device. The last "
                "column predicts region to region without random numbers; it is lower where rows and columns have a "
                "pattern, which neighbouring pixels share and pixels of two regions do not.",
                *explained,
            ),
            (("Table 5.3 of the thesis, and ours", thesis_table(result)),),
        ),
        Section(
            "Figure 3.10",
            (
                "The thesis gives one value, 0.66630, for a scene of 10 and 20 cd/m² and no exposure time; its program "
                "has 5 ms in one place and 15 ms in another.",
            ),
            (("The value of figure 3.10, and ours", figure_table(result)),),
        ),
        Section("The sweep of intensities", (), (), [figure]),
        Section("Provenance", facts=[Fact("Source", _SOURCE), Fact("Made by", f"labcdp {version('labcdp')}")]),
    ]
    return Document("labcdp: reproduction of published values", "The 2018 thesis, reproduced", "", (), sections)


def _sheets(result: ThesisReproduction) -> list[Sheet]:
    sweep = result.sweep
    return [
        Sheet("Table 5.3", _HEAD, [_cells(row) for row in result.table]),
        Sheet("Figure 3.10", _HEAD, [_cells(row) for row in result.figure]),
        Sheet(
            "Intensity sweep",
            (
                "Luminance in cd/m²",
                "CDP",
                "SNR in dB (10 lg)",
                "CDP, correct physics",
                "SNR in dB (10 lg), correct physics",
            ),
            [
                (Number(row[0], 6), *(Number(value, 5) for value in row[1:]))
                for row in zip(
                    *(_floats(values) for values in (sweep.luminance_cd_m2, sweep.cdp, sweep.snr_db)),
                    *(_floats(values) for values in (sweep.corrected_cdp, sweep.corrected_snr_db)),
                    strict=True,
                )
            ],
        ),
        Sheet(
            "Provenance",
            ("What", "Value"),
            [("Source", _SOURCE), ("Seeds", Number(result.seeds, 0)), ("labcdp", version("labcdp"))],
        ),
    ]


def _floats(values: np.ndarray[Any, np.dtype[np.float64]]) -> Sequence[float]:
    return [float(value) for value in values]


def _cells(row: ReproducedRow) -> tuple[Cell, ...]:
    setting = row.published
    return (
        setting.label,
        Number(100 * setting.contrast, 0),
        Number(setting.luminance_cd_m2, 0),
        Number(setting.temperature_c, 0),
        Number(1e3 * setting.exposure_s, 0),
        Number(1e6 * setting.pixel_pitch_m, 0),
        Number(setting.published_cdp, 8),
        Number(row.mean, 6),
        Number(row.standard_deviation, 6),
        Number(row.z, 2),
        Number(row.all_pairs_mean, 6),
        Number(row.corrected_mean, 6),
        Number(row.corrected_standard_deviation, 6),
        Number(row.corrected_exact, 6),
        setting.explanation,
    )


def _sweep_figure(result: ThesisReproduction) -> bytes:
    sweep = result.sweep
    figure = new_figure(8.0, 6.4, simulated=False)
    above, below = figure.subplots(2, 1, sharex=True)
    for panel, thesis, physical in (
        (above, sweep.cdp, sweep.corrected_cdp),
        (below, sweep.snr_db, sweep.corrected_snr_db),
    ):
        panel.plot(sweep.luminance_cd_m2, _drawable(thesis), color=VERMILLION, linewidth=1.5, label="thesis' physics")
        panel.plot(
            sweep.luminance_cd_m2, _drawable(physical), color=BLUE, linewidth=1.5, label="correct physics, exact"
        )
        panel.set_xscale("log")
        panel.grid(color="0.9")
        panel.legend(fontsize=SMALL_SIZE)
    above.set_ylim(-0.03, 1.05)
    label(above, "", "CDP", "CDP and SNR over the intensity of the scene")
    label(below, "luminance of the dark squares in cd/m²", "SNR in dB (10 lg), bright squares", "")
    return png(figure)


def _drawable(values: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.where(np.isfinite(values), values, np.nan)
