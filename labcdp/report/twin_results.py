"""The results of a twin as files: page, spreadsheet, numbers and chain file."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ..evaluate.twin_chain import twin_chain_text
from ..json_text import results_json
from .digits import printable
from .document import Document, Section
from .facts import Fact
from .folder import write_files
from .page import document_page
from .twin_figure import twin_figure
from .twin_sheets import twin_sheets
from .twin_tables import (
    difference_table,
    finding_table,
    influence_table,
    mean_table,
    noise_table,
    pair_table,
    parameter_table,
)
from .twin_wording import simulated, twin_notes, twin_results, twin_warnings
from .workbook import workbook

if TYPE_CHECKING:
    from ..evaluate.twin import TwinResult


def write_twin(result: TwinResult, folder: str | PathLike[str]) -> list[Path]:
    """Write a twin: for machines, for people, for spreadsheets, and as a chain file.

    Parameters
    ----------
    result : TwinResult
        The twin.
    folder : path
        Made if it does not exist; files of an earlier run are replaced.

    Returns
    -------
    list of Path
        chain.toml, report.html, results.xlsx, results.json and twin.png.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    chain, figure, facts = twin_chain_text(result), twin_figure(result), _provenance(result)
    sections = [
        Section("", tuple(twin_results(result)), figures=(figure,)),
        *_differences(result),
        Section(
            "Which parameter matters",
            ("Share of the variance of the difference between measured and predicted CDP, mean over the pairs.",),
            (("Parameters and their influence", influence_table(result)),),
        ),
        Section(
            "Patches",
            (
                "Signal of each patch in the longest exposure that does not saturate it, with 95 % half widths; z is "
                "the difference in joint standard uncertainties.",
            ),
            (
                ("Mean of each patch", mean_table(result)),
                ("Temporal noise and fixed pattern of each patch", noise_table(result)),
            ),
        ),
        Section(
            "The twin",
            ("Parameters with 95 % half widths. The file chain.toml holds them for labcdp simulate.", *_notes(result)),
            (("Parameters of the twin", parameter_table(result)),),
        ),
        Section(
            "All pairs",
            (
                "The twin sees the luminances the meter read, never those of the camera. Its CDP is computed without "
                "random numbers from the distributions of DN it predicts for the very regions and exposures. The joint "
                "interval holds the finite number of pixels with the fixed pattern of one specimen, the uncertainties "
                "of all parameters and readings, and the calibration's darkness; the meter's scale error is in "
                "both and cancels. Intervals end at 0 and 1. A pair is undecided if at least 80 % of all possible CDPs "
                "would agree: it tells nothing of the twin.",
            ),
            (("Contrast detection probability of pairs of patches", pair_table(result)),),
        ),
        Section("Provenance", facts=facts, text="\n".join(printable(line) for line in chain.splitlines())),
    ]
    title = printable(result.observed.configuration.name)
    page = Document("labcdp: a camera and its twin", title, simulated(result), twin_warnings(result), sections)
    files = {
        "chain.toml": chain.encode(),
        "report.html": document_page(page).encode(),
        "results.xlsx": workbook(twin_sheets(result, facts), title, datetime.now(UTC)),
        "results.json": results_json(result.to_dict()).encode(),
        "twin.png": figure.png,
    }
    return write_files(Path(folder), files)


def _notes(result: TwinResult) -> list[str]:
    notes = twin_notes(result)
    return [f"To mind when it is simulated: {'; '.join(notes)}."] if notes else []


def _differences(result: TwinResult) -> list[Section]:
    sections = []
    if result.findings:
        text = (
            "The mean of each patch tells the responsivity, stray light, the black level and single readings; temporal "
            "noise over the signal tells the read noise and K, the fixed pattern DSNU and PRNU."
        )
        table = ("Parameters that mean, noise and fixed pattern contradict", finding_table(result))
        sections.append(Section("What the patches' signals contradict", (text,), (table,)))
    if result.differing:
        text = (
            "First, for each pair, the parameter that the patches' signals contradict and what it leaves of the "
            "difference. Then the parameter that would have to be off by the fewest of its standard uncertainties; "
            "beyond about 3 it is no likely explanation. The last column is the chance of the pixels alone: 5 of 100 "
            "pairs are beyond 2."
        )
        table = ("What would explain the difference", difference_table(result))
        sections.append(Section("Pairs that differ", (text,), (table,)))
    return sections


def _provenance(result: TwinResult) -> list[Fact]:
    configuration, calibration = result.observed.configuration, result.calibration
    lens, meter = configuration.lens, calibration.meter_scale.meter
    facts = [
        Fact("Session", configuration.name),
        Fact("Operator", configuration.operator),
        Fact("Camera", str(calibration.state.camera)),
        Fact("Lens", f"{lens.model}, focal length {lens.focal_length_m * 1e3:g} mm, f/{lens.f_number:g}"),
        Fact("Luminance meter", f"{meter.model}, serial number {meter.serial}"),
        Fact("Light", configuration.source.spectrum),
        Fact("SHA-256 of frames and readings", result.observed.input_sha256),
        Fact("SHA-256 of those of the calibration", calibration.provenance.input_sha256),
        Fact("Report written by", f"labcdp {version('labcdp')}"),
    ]
    return [Fact(fact.name, printable(fact.value)) for fact in facts]
