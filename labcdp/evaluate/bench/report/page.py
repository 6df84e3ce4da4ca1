"""The files of an evaluated session: a page with its CDP first, spreadsheet, numbers and figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ....core.result import Result
from ....output import Destination, write_files
from ....report.cells import cell_text
from ....report.digits import day, percent, printable, shortened
from ....report.files import result_files
from ....report.layout import Card, Facts, Page, Section, State, Verbatim
from ..calibration.page import condition_blocks
from ..contrast import Verdict
from ..session import SessionEvaluation
from .figures import ReportFigures, draw_figures
from .result import recorded

#: Number of contrast columns that fit next to the picture.
_BESIDE_PICTURE = (
    "pair",
    "target_contrast",
    "measured_contrast",
    "expanded_measured_contrast",
    "camera_contrast",
    "expanded_camera_contrast",
    "cdp",
    "cdp_low",
    "cdp_high",
)
_STATES: dict[Verdict, State] = {"detected": "good", "not detected": "bad", "undecided": "open"}
_CDP = (
    "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance around "
    "the target contrast; below and above are the shares to either side. Contrasts by meter and camera are those of "
    "the mean luminances, ± U (95 %); the scale error of the meter cancels in them."
)


def write_results(
    evaluation: SessionEvaluation, result: Result, folder: Destination, figures: ReportFigures | None = None
) -> list[Path]:
    """Write the results of an evaluated session into a folder as `write_files` takes it.

    Everything is made before the first file is written; InputError is raised if one cannot be written. The figures are
    drawn unless they are given.

    Returns
    -------
    list of Path
        results.json, report.html, results.xlsx and figures/*.png.
    """
    figures = figures or draw_figures(evaluation)
    page = session_page(evaluation, result, figures)
    return write_files(folder, "evaluate", result_files(result, page, figures, recorded(evaluation)[1]))


def session_page(evaluation: SessionEvaluation, result: Result, figures: ReportFigures) -> Page:
    """Return the page of an evaluated session.

    Parameters
    ----------
    evaluation : SessionEvaluation
        What to show.
    result : Result
        Its tables.
    figures : ReportFigures
        Its figures.
    """
    contrasts = result.table("contrasts").only(*_BESIDE_PICTURE)
    main = contrasts if evaluation.contrasts else result.table("luminance")
    banner = f"Simulated data, not a measurement: {printable(', '.join(evaluation.simulated))}."
    return Page(
        "Luminance and contrast detection probability (CDP)",
        result.title,
        _summary(evaluation),
        banner if evaluation.simulated else "",
        tuple(_cards(evaluation, result)),
        (figures.target, main),
        result.findings,
        tuple(_sections(evaluation, result, figures)),
    )


def _cards(evaluation: SessionEvaluation, result: Result) -> Iterator[Card]:
    table = result.table("contrasts")
    for contrast, row in zip(evaluation.contrasts, table.rows(), strict=True):
        value, _, interval = cell_text(table.column("cdp"), row).partition(" ")
        yield Card(
            row["pair"],
            value,
            f"95 % interval {interval.strip('()')}" if interval else "",
            (
                f"target contrast {percent(row['target_contrast'])}, ε {percent(row['epsilon'])}",
                f"meter {cell_text(table.column('measured_contrast'), row)} %",
                f"camera {cell_text(table.column('camera_contrast'), row)} %",
                f"detected if CDP ≥ {row['cdp_limit']:g}",
            ),
            contrast.verdict,
            _STATES[contrast.verdict],
        )


def _summary(evaluation: SessionEvaluation) -> str:
    configuration, camera = evaluation.observed.configuration, evaluation.calibration.state.camera
    meter = next(iter(evaluation.observed.readings.values()))[0].meter
    days = " to ".join(dict.fromkeys(day(time) for time in recorded(evaluation)))
    n = len(evaluation.patches)
    return (
        f"{n} {'patch' if n == 1 else 'patches'} of {configuration.target.name}, {days}, {configuration.operator}; "
        f"{camera.model}, {configuration.lens.model} at f/{configuration.lens.f_number:g}, {meter.model}, "
        f"{configuration.source.spectrum} light."
    )


def _sections(evaluation: SessionEvaluation, result: Result, figures: ReportFigures) -> Iterator[Section]:
    if evaluation.contrasts:
        yield Section("Luminance", (result.table("luminance"), figures.luminance))
        yield Section("Contrast detection probability", (_CDP, result.table("contrasts"), *figures.contrasts))
    else:
        yield Section("Luminance", (figures.luminance,))
    tables = [result.table(name) for name in ("calibration", "calibration_patches")]
    planes = [table for table in result.tables if table.name == "planes"]
    conditions = condition_blocks(result.table("conditions"))
    yield Section("Calibration", (*planes, *tables, *figures.calibration, *conditions), collapsed=True)
    # Spectra are in the session; here their first values identify them.
    lines = evaluation.observed.configuration.to_toml().splitlines()
    configuration = "\n".join(shortened(line, 160) for line in lines)
    yield Section(
        "Provenance",
        (Facts.of(result.table("provenance")), "Configuration of the session:", Verbatim(configuration)),
        collapsed=True,
    )
