"""The files of a characterisation: page, spreadsheet, numbers and figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ...calibration.emva.result import Characterisation
from ...core.result import Result
from ...output import Destination, write_files
from ...report.cells import cell_text
from ...report.figure import ReportFigure
from ...report.files import result_files
from ...report.layout import SIMULATED, Card, Facts, Page, Section
from .figures import signal_figures
from .nonuniformity import spatial_figures

#: Quantities on the cards, with a second one where there is one.
_CARDS = (
    ("k_dn_per_e", ""),
    ("dark_noise_e", "dark_current_e_s"),
    ("full_well_e", "snr_max_db"),
    ("dynamic_range_db", ""),
    ("prnu_rel", "dsnu_e"),
    ("quantum_efficiency", "responsivity"),
    ("linearity_error_rel", ""),
)
_NO_COMPLIANCE = (
    "This is a measurement with the standard's definitions, not a declaration of compliance with it: light source and "
    "procedure were not checked. U comes from the statistics of the fits: the temporal noise of the points, widened "
    "where the points scatter more than it explains."
)


def write_characterisation(found: Characterisation, result: Result, folder: Destination) -> list[Path]:
    """Write a characterisation into a folder as `write_files` takes it.

    Everything is made before the first file is written; InputError is raised if one cannot be written.

    Returns
    -------
    list of Path
        results.json, report.html, results.xlsx and figures/*.png.
    """
    signal, spatial = signal_figures(found), spatial_figures(found)
    page = _page(found, result, signal, spatial)
    return write_files(folder, "characterise", result_files(result, page, [*signal, *spatial]))


def _page(found: Characterisation, result: Result, signal: list[ReportFigure], spatial: list[ReportFigure]) -> Page:
    table = result.table("characterisation")
    size = f"{found.image_shape[1]} x {found.image_shape[0]} pixels, {found.bits} bits"
    facts = [
        ("Source", found.source),
        ("Camera", found.camera or "not stated by the data set"),
        ("Images", size if found.gain_db is None else f"{size}, gain {found.gain_db:g} dB"),
        ("Temperature", "not known" if found.temperature_c is None else f"{found.temperature_c:.1f} °C"),
        ("Definitions", found.definition),
    ]
    return Page(
        "characterisation after EMVA 1288",
        result.title,
        ", ".join(part for part in (found.camera, size) if part),
        SIMULATED if found.simulated else "",
        tuple(_cards(result)),
        (signal[0], table.only("quantity", "value", "expanded_value", "unit")),
        result.findings,
        (
            Section("How the values were found", (_NO_COMPLIANCE, table.only("quantity", "meaning")), collapsed=True),
            Section("Signal and noise", signal[1:]),
            *([Section("Non-uniformity", spatial)] if spatial else []),
            Section("Series and provenance", (result.table("series"), result.table("dark_signal"), Facts(facts)), True),
        ),
    )


def _cards(result: Result) -> Iterator[Card]:
    table = result.table("characterisation")
    rows = {row["key"]: row for row in table.rows()}
    for key, beside in _CARDS:
        if key in rows:
            value, plus_minus, expanded = cell_text(table.column("value"), rows[key]).partition(" ± ")
            lines = []
            if beside in rows:
                other = rows[beside]
                lines.append(f"{other['quantity']} {cell_text(table.column('value'), other)} {other['unit']}")
            unit = rows[key]["unit"]
            detail = f"{plus_minus.strip()} {expanded} {unit}, U (95 %)" if expanded else ""
            name = rows[key]["quantity"]
            yield Card(f"{name[:1].upper()}{name[1:]}", f"{value} {unit}".strip(), detail, tuple(lines))
