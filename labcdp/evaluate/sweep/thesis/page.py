"""The files of the reproduction of the 2018 thesis: page, spreadsheet, numbers and picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ....core.result import Result
from ....core.table import Table
from ....output import Destination, write_files
from ....report.figure import ReportFigure
from ....report.figures.drawing import BLUE, VERMILLION, finish, new_figure, png
from ....report.files import result_files
from ....report.layout import Card, Facts, Page, Section
from .result import AGREES_Z, SOURCE

#: Columns of the first table of the page; the details have all.
_SHORT = ("row", "contrast", "luminance_cd_m2", "published_cdp", "mean", "standard_deviation", "z", "corrected_mean")


def write_thesis(result: Result, folder: Destination) -> list[Path]:
    """Write the reproduction of the 2018 thesis into a folder as `write_files` takes it.

    Everything is made before the first file is written; InputError is raised if one cannot be written.

    Returns
    -------
    list of Path
        results.json, report.html, results.xlsx and figures/intensity-sweep.png.
    """
    figure = ReportFigure(
        "intensity-sweep.png",
        _sweep_figure(result.table("intensity_sweep")),
        "CDP and SNR over the luminance of the dark squares: contrast 100 %, 100 °C, 5 ms, 2 µm, glare 20 %. Above the "
        "full well nothing is detected although the thesis' SNR is infinite there, which is why it asks for CDP.",
        "Two curves each of CDP and of SNR over luminance, with the thesis' physics and with the correct one.",
    )
    return write_files(folder, "reproduce", result_files(result, _page(result, figure), [figure]))


def _page(result: Result, figure: ReportFigure) -> Page:
    table, seeds = result.table("table_5_3"), result.configuration["seeds"]
    close = sum(abs(z) <= AGREES_Z for z in table["z"])
    card = Card(
        "Published values reproduced",
        f"{close} of {len(table)}",
        f"within {AGREES_Z:g} standard deviations over {seeds} seeds",
        state="good" if close == len(table) else "open",
    )
    facts = Facts((("Source", SOURCE), ("Seeds", str(seeds))))
    return Page(
        "reproduction of published values",
        result.title,
        SOURCE,
        cards=(card,),
        lead=(figure, table.showing(*_SHORT)),
        findings=result.findings,
        sections=[
            Section(
                "Table 5.3 and figure 3.10",
                (
                    "All values are of each pixel against its right and its lower neighbour, except the last column; z "
                    "is the distance of the published value from the mean in standard deviations. labcdp: the thesis' "
                    "chain with its own noise, photon constant and windscreen, and with the 418 of 252 119 contrasts "
                    "that its program never fills counted as not detected. All pairs filled: the same without those. "
                    "Correct physics: light of D65 with its shot noise, a fixed pattern that is fixed, rounding, and "
                    "glare subtracted as it was added; each seed is another device. The last column predicts region to "
                    "region without random numbers; it is lower where rows and columns have a pattern, which "
                    "neighbouring pixels share and pixels of two regions do not.",
                    table,
                    "For figure 3.10 the thesis gives one value, 0.66630, for a scene of 10 and 20 cd/m² and no "
                    "exposure time; its program has 5 ms in one place and 15 ms in another.",
                    result.table("figure_3_10"),
                ),
            ),
            Section("Provenance", (facts,), collapsed=True),
        ],
    )


def _sweep_figure(sweep: Table) -> bytes:
    figure = new_figure(8.0, 6.4)
    above, below = figure.subplots(2, 1, sharex=True)
    for panel, name in ((above, "cdp"), (below, "snr_db")):
        curves = ((name, VERMILLION, "thesis' physics"), (f"corrected_{name}", BLUE, "correct physics, exact"))
        for column, colour, text in curves:
            values = np.asarray(sweep[column])
            drawn = np.where(np.isfinite(values), values, np.nan)
            panel.plot(sweep["luminance_cd_m2"], drawn, color=colour, linewidth=1.5, label=text)
        panel.set_xscale("log")
    above.set_ylim(-0.03, 1.05)
    finish(above, "", "CDP", "CDP and SNR over the intensity of the scene")
    finish(below, "luminance of the dark squares in cd/m²", "SNR in dB (10 lg), bright squares", "")
    return png(figure)
