"""The reproduction of the 2018 thesis as a result, and its files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...core.result import Finding, Result, info
from ...core.table import Column, Table
from ...report.drawing import BLUE, VERMILLION, finish, new_figure, reported
from ...report.files import result_files
from ...report.layout import Card, Page, ReportFigure, Section, facts_table
from .thesis import NEIGHBOUR_PAIRS, UNFILLED_SLOTS, ThesisReproduction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Where the published values come from.
SOURCE = "L. Ebbert, Implementierung von CDP, HS Düsseldorf, 2018"

#: Standard deviations beyond which a value is not reproduced.
AGREES_Z = 2.0


_COLUMNS = (
    Column("row", "row", "", "Column of table 5.3, or the figure.", value="published.label"),
    Column("contrast", "contrast", "%", "Weber contrast.", decimals=0, value="published.contrast"),
    Column("luminance_cd_m2", "dark squares", "cd/m²", "Luminance of the dark squares.", decimals=0,
           value="published.luminance_cd_m2"),
    Column("temperature_c", "temperature", "°C", "Of the sensor.", decimals=0, value="published.temperature_c"),
    Column("exposure_s", "exposure", "s", "Exposure time.", time=True, value="published.exposure_s"),
    Column("pixel_pitch_um", "pixel pitch", "µm", "Of the sensor.", decimals=0,
           value=lambda row: 1e6 * row.published.pixel_pitch_m),
    Column("published_cdp", "thesis", "", "CDP in the thesis.", decimals=5, value="published.published_cdp"),
    Column("mean", "labcdp", "", "Mean CDP over the seeds, with the thesis' physics.", decimals=5),
    Column("standard_deviation", "std", "", "Standard deviation over the seeds.", decimals=5),
    Column("z", "z", "", "Published value minus mean, in standard deviations.", decimals=2),
    Column("all_pairs_mean", "all pairs filled", "", "Mean CDP without unfilled slots.", decimals=5),
    Column("corrected_mean", "correct physics", "", "Mean CDP over the seeds, with correct physics.", decimals=5),
    Column("corrected_standard_deviation", "std", "", "Standard deviation with correct physics.", decimals=5),
    Column("corrected_exact", "region to region, exact", "",
           "CDP of all pairs of the two regions, predicted with correct physics.", decimals=5),
)  # fmt: skip
_SWEEP = (
    Column("luminance_cd_m2", "luminance", "cd/m²", "Luminance of the dark squares.", digits=6),
    Column("cdp", "CDP", meaning="With the thesis' physics.", decimals=5),
    Column("snr_db", "SNR (10 lg)", "dB", "SNR of the bright squares, with the thesis' physics.", decimals=3),
    Column("corrected_cdp", "CDP, correct physics", meaning="Predicted with correct physics.", decimals=5),
    Column("corrected_snr_db", "SNR (10 lg), correct physics", "dB", "Predicted with correct physics.", decimals=3),
)


def thesis_result(reproduction: ThesisReproduction) -> Result:
    """Return the published and reproduced values, and the sweep of intensities."""
    sweep = {column.name: getattr(reproduction.sweep, column.name) for column in _SWEEP}
    title = f"Table 5.3: published values, and means over {reproduction.seeds} seeds"
    return Result(
        "reproduce",
        "The 2018 thesis, reproduced",
        (
            Table.of_items("table_5_3", title, _COLUMNS, reproduction.table),
            Table.of_items("figure_3_10", "Figure 3.10", _COLUMNS, reproduction.figure),
            Table("intensity_sweep", "Sweep of intensities", _SWEEP, sweep, detail=True),
        ),
        tuple(_findings(reproduction)),
        configuration={"what": "thesis", "source": SOURCE, "seeds": reproduction.seeds},
        simulated=True,
    )


def _findings(reproduction: ThesisReproduction) -> Iterator[Finding]:
    for row in reproduction.table:
        label = row.published.label
        if row.published.is_unfilled_slots:
            yield info("thesis-unfilled-slots", label, n_slots=UNFILLED_SLOTS, n_pairs=NEIGHBOUR_PAIRS)
        if abs(row.z) > AGREES_Z:
            yield info("thesis-value-differs", label, z=row.z)


#: Columns of the first table of the page; the details have all.
_SHORT = ("row", "contrast", "luminance_cd_m2", "published_cdp", "mean", "standard_deviation", "z", "corrected_mean")


def thesis_files(result: Result) -> dict[str, bytes]:
    """Return the files of the reproduction of the 2018 thesis by their names.

    Returns
    -------
    dict of str to bytes
        results.json, report.html, results.xlsx and figures/intensity-sweep.png.
    """
    figure = reported(
        "intensity-sweep",
        _sweep_figure(result.table("intensity_sweep")),
        "CDP and SNR over the luminance of the dark squares: contrast 100 %, 100 °C, 5 ms, 2 µm, glare 20 %. Above the "
        "full well nothing is detected although the thesis' SNR is infinite there, which is why it asks for CDP.",
        "Two curves each of CDP and of SNR over luminance, with the thesis' physics and with the correct one.",
    )
    return result_files(result, _page(result, figure))


def _page(result: Result, figure: ReportFigure) -> Page:
    table, seeds = result.table("table_5_3"), result.configuration["seeds"]
    close = sum(abs(z) <= AGREES_Z for z in table["z"])
    card = Card(
        "Published values reproduced",
        f"{close} of {len(table)}",
        f"within {AGREES_Z:g} standard deviations over {seeds} seeds",
        state="good" if close == len(table) else "open",
    )
    facts = facts_table((("Source", SOURCE), ("Seeds", str(seeds))))
    return Page.of(
        result,
        "reproduction of published values",
        SOURCE,
        cards=(card,),
        lead=(figure, table.showing(*_SHORT)),
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


def _sweep_figure(sweep: Table) -> Figure:
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
    return figure
