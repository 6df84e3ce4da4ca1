"""The reproduction of the 2018 thesis as a result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ....core.finding import Finding, info
from ....core.result import Result
from ....core.table import Column, Table
from .reproduce import NEIGHBOUR_PAIRS, UNFILLED_SLOTS, ReproducedRow, ThesisReproduction

#: Where the published values come from.
SOURCE = "L. Ebbert, Implementierung von CDP, HS Düsseldorf, 2018"

#: Standard deviations beyond which a value is not reproduced.
AGREES_Z = 2.0

_COLUMNS = (
    Column("row", "row", meaning="Column of table 5.3, or the figure."),
    Column("contrast", "contrast", "%", "Weber contrast.", decimals=0),
    Column("luminance_cd_m2", "dark squares", "cd/m²", "Luminance of the dark squares.", decimals=0),
    Column("temperature_c", "temperature", "°C", "Of the sensor.", decimals=0),
    Column("exposure_s", "exposure", "s", "Exposure time.", time=True),
    Column("pixel_pitch_um", "pixel pitch", "µm", "Of the sensor.", decimals=0),
    Column("published_cdp", "thesis", meaning="CDP in the thesis.", decimals=5),
    Column("mean", "labcdp", meaning="Mean CDP over the seeds, with the thesis' physics.", decimals=5),
    Column("standard_deviation", "std", meaning="Standard deviation over the seeds.", decimals=5),
    Column("z", "z", meaning="Published value minus mean, in standard deviations.", decimals=2),
    Column("all_pairs_mean", "all pairs filled", meaning="Mean CDP without unfilled slots.", decimals=5),
    Column("corrected_mean", "correct physics", meaning="Mean CDP over the seeds, with correct physics.", decimals=5),
    Column("corrected_standard_deviation", "std", meaning="Standard deviation with correct physics.", decimals=5),
    Column(
        "corrected_exact",
        "region to region, exact",
        meaning="CDP of all pairs of the two regions, predicted with correct physics.",
        decimals=5,
    ),
)
_SWEEP = (
    Column("luminance_cd_m2", "luminance", "cd/m²", "Luminance of the dark squares.", digits=6),
    Column("cdp", "CDP", meaning="With the thesis' physics.", decimals=5),
    Column("snr_db", "SNR (10 lg)", "dB", "SNR of the bright squares, with the thesis' physics.", decimals=3),
    Column("corrected_cdp", "CDP, correct physics", meaning="Predicted with correct physics.", decimals=5),
    Column("corrected_snr_db", "SNR (10 lg), correct physics", "dB", "Predicted with correct physics.", decimals=3),
)


def result(reproduction: ThesisReproduction) -> Result:
    """Return the published and reproduced values, and the sweep of intensities."""
    sweep = {column.name: getattr(reproduction.sweep, column.name) for column in _SWEEP}
    title = f"Table 5.3: published values, and means over {reproduction.seeds} seeds"
    return Result(
        "reproduce",
        "The 2018 thesis, reproduced",
        (
            _table("table_5_3", title, reproduction.table),
            _table("figure_3_10", "Figure 3.10", reproduction.figure),
            Table("intensity_sweep", "Sweep of intensities", _SWEEP, sweep, detail=True),
        ),
        tuple(_findings(reproduction)),
        configuration={"what": "thesis", "source": SOURCE, "seeds": reproduction.seeds},
        simulated=True,
    )


def _table(name: str, title: str, rows: Sequence[ReproducedRow]) -> Table:
    own = [column.name for column in _COLUMNS[7:]]
    return Table.of_rows(
        name,
        title,
        _COLUMNS,
        [
            {
                "row": row.published.label,
                "contrast": row.published.contrast,
                "luminance_cd_m2": row.published.luminance_cd_m2,
                "temperature_c": row.published.temperature_c,
                "exposure_s": row.published.exposure_s,
                "pixel_pitch_um": 1e6 * row.published.pixel_pitch_m,
                "published_cdp": row.published.published_cdp,
                **{column: getattr(row, column) for column in own},
            }
            for row in rows
        ],
    )


def _findings(reproduction: ThesisReproduction) -> Iterator[Finding]:
    for row in reproduction.table:
        label = row.published.label
        if row.published.is_unfilled_slots:
            yield info("thesis-unfilled-slots", label, n_slots=UNFILLED_SLOTS, n_pairs=NEIGHBOUR_PAIRS)
        if abs(row.z) > AGREES_Z:
            yield info("thesis-value-differs", label, z=row.z)
