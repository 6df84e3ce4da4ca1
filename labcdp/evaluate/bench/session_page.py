"""The files of an evaluated session: a page with its CDP first, spreadsheet, numbers and figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

from ...core.clock import exposure_text
from ...core.result import Result
from ...core.table import Table
from ...metrics import ContrastDistribution
from ...report.drawing import reduction
from ...report.files import result_files
from ...report.layout import SIMULATED, Card, Page, ReportFigure, Section, Verbatim, page_text
from ...report.maps import luminance_picture, regions_picture
from ...report.plots import ContrastPanel, contrast_figures
from ...report.text import cell_interval, cell_text, cell_value, day, percent, printable, share_percent, shortened, span
from ..judgement import requirement_cards
from ..verdict import STATES
from .calibration_page import calibration_figures, condition_blocks
from .quantities import range_text
from .rows import ContrastRow
from .session import SessionEvaluation

#: Number of contrast columns that fit next to the picture.
_BESIDE_PICTURE = (
    "pair", "target_contrast", "measured_contrast", "expanded_measured_contrast", "camera_contrast",
    "expanded_camera_contrast", "cdp", "cdp_low", "cdp_high",
)  # fmt: skip
_CDP = (
    "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance around "
    "the target contrast; below and above are the shares to either side. Contrasts from meter and camera are those "
    "of the mean luminances, ± U (95 %); the scale error of the meter cancels in them."
)


def _pictures(evaluation: SessionEvaluation) -> tuple[ReportFigure, ReportFigure]:
    """Draw the target with its patches, and the luminance of each pixel."""
    seen, simulated, calibrated = evaluation.map, bool(evaluation.simulated), evaluation.calibration
    regions = [row.region for row in evaluation.patches]
    names = ", ".join(printable(region.name) for region in regions)
    title = f"Target: {shortened(evaluation.observed.configuration.target.name, 60)}"
    limits, valid = range_text(calibrated), share_percent(float(seen.valid.mean()))
    side = seen.step * reduction(seen.shape)
    scale = f" Each drawn pixel is the mean of {side} x {side} of the camera's." if side > 1 else ""
    target = ReportFigure(
        "target.png",
        regions_picture(seen, regions, title, simulated),
        f"The target as the camera sees it, in logarithmic grey levels, with the patches.{scale}",
        f"Grey picture of the target with the outlines and names of its {len(regions)} patches: {names}.",
    )
    return target, ReportFigure(
        "luminance.png",
        luminance_picture(seen, "Luminance from the calibrated camera", simulated, calibrated.range_cd_m2),
        f"Luminance of each pixel, from the longest exposure that does not saturate it. {valid} of the pixels "
        f"are valid; the others have the colours of the legend. Calibrated range: {limits}.{scale}",
        f"Luminance map in false colours on a logarithmic scale over {limits}; {valid} of the pixels are valid.",
    )


def _panel(row: ContrastRow, distribution: ContrastDistribution) -> ContrastPanel:
    numbers = dict.fromkeys((row.frame_number, row.dark_frame_number))
    frames = f"{'frames' if len(numbers) > 1 else 'frame'} {' and '.join(map(str, numbers))}"
    title = f"{shortened(row.name, 60)}, {exposure_text(row.exposure_s)}, {frames}"
    return ContrastPanel(title, distribution, row.cdp, row.measured_contrast)


def session_files(evaluation: SessionEvaluation, result: Result) -> dict[str, bytes]:
    """Return the files of an evaluated session as `result_files` does."""
    contrasts = result.table("contrasts").only(*_BESIDE_PICTURE)
    main = contrasts if evaluation.contrasts else result.table("luminance")
    main = replace(main, note=f"{main.note} {page_text('uncertainty-in-short')}".strip())
    target, luminance = _pictures(evaluation)
    lead: tuple[ReportFigure | Table, ...] = (target, main)
    sections = _sections(evaluation, result, luminance)
    cards = [*requirement_cards(result), *_cards(result.table("contrasts"))]
    if evaluation.chart is not None:
        from ..chart.figures import chart_section, range_cards

        cards = [*range_cards(evaluation.chart), *cards]
        of_chart = chart_section(evaluation.observed.configuration.target.name, evaluation.chart, result)
        lead, sections = (target, *result.tables_named("dynamic_range")), chain((of_chart,), sections)
    if evaluation.colours:
        from ..colour.figures import colour_cards, colour_section

        cards += colour_cards(evaluation.colours)
        sections = chain((colour_section(evaluation.colours, result),), sections)
    if evaluation.flicker:
        from ..flicker.page import flicker_cards, flicker_section

        cards += flicker_cards(evaluation.flicker)
        sections = chain((flicker_section(evaluation.flicker, result),), sections)
    kind = "Luminance and contrast detection probability (CDP)"
    page = Page.of(result, kind, _summary(evaluation), cards, lead, sections)
    if evaluation.simulated:
        page = replace(page, banner=f"{SIMULATED[:-1]}: {printable(', '.join(evaluation.simulated))}.")
    return result_files(result, page, time=evaluation.observed.times[-1])


def _cards(table: Table) -> Iterator[Card]:
    for row in table.rows():
        interval = cell_interval(table.column("cdp"), row)
        yield Card(
            row["pair"],
            cell_value(table.column("cdp"), row),
            f"95 % interval {interval}" if interval else "",
            (
                f"target contrast {percent(row['target_contrast'])}, ε {percent(row['epsilon'])}",
                f"meter {cell_text(table.column('measured_contrast'), row)} %",
                f"camera {cell_text(table.column('camera_contrast'), row)} %",
                f"detected if CDP ≥ {row['cdp_limit']:g}",
            ),
            row["verdict"],
            STATES[row["verdict"]],
        )


def _summary(evaluation: SessionEvaluation) -> str:
    observed, camera, n = evaluation.observed, evaluation.calibration.state.camera, len(evaluation.patches)
    configuration, days = observed.configuration, span(day(observed.times[0]), day(observed.times[-1]))
    meter = next(iter(observed.readings.values()))[0].meter
    return (
        f"{n} {'patch' if n == 1 else 'patches'} of {configuration.target.name}, {days}, {configuration.operator}; "
        f"{camera.model}, {configuration.lens.model} at f/{configuration.lens.f_number:g}, {meter.model}, "
        f"{configuration.source.spectrum} light."
    )


def _sections(evaluation: SessionEvaluation, result: Result, luminance: ReportFigure) -> Iterator[Section]:
    yield from (Section("Requirement", (table,)) for table in result.tables if table.name == "requirement")
    if evaluation.contrasts:
        panels = [_panel(row, row.distribution) for row in evaluation.contrasts if row.distribution is not None]
        figures = contrast_figures(panels, "bench" if evaluation.simulated else "")
        yield Section("Luminance", (result.table("luminance"), luminance))
        yield Section("Contrast detection probability (CDP)", (_CDP, result.table("contrasts"), *figures))
    else:
        yield Section("Luminance", (luminance,))
    tables = {table.name: table for table in result.tables}
    shown = [tables[name] for name in ("planes", "calibration", "calibration_patches") if name in tables]
    fitted = calibration_figures(evaluation.calibration, "calibration-")
    yield Section("Calibration", (*shown, *fitted, *condition_blocks(tables["conditions"])), True)
    # Spectra are in the session; here their first values identify them.
    lines = evaluation.observed.configuration.to_toml().splitlines()
    configuration = Verbatim("\n".join(shortened(line, 160) for line in lines))
    blocks = result.table("provenance"), "Configuration of the session:", configuration
    yield Section("Provenance", blocks, collapsed=True)
