"""The result of pictures: tables of CDP and regions, findings, and what they were made from."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from ...core.result import Finding, InputFile, Result, error, unique, warning
from ...files.picture import Picture
from ...files.read import read_picture
from ...regions import require_on_image
from ...report.files import envelope_json
from ...report.sheets import result_workbook
from ..judgement import judged_pairs
from .figures import picture_figures
from .image import MeasuredPicture, measure_picture
from .page import picture_page
from .settings import ImageSettings
from .tables import cdp_table, matrices, picture_table, region_table, seen_contrasts

#: Columns that a sheet can have, less the one for the contrasts.
_MOST_PICTURES = 2**14 - 1


def evaluate_picture(
    settings: ImageSettings, path: Path, *, pages: bool, surface: bool
) -> tuple[MeasuredPicture, Result | None, dict[str, bytes]]:
    """Evaluate a picture, and make its page.

    Returns
    -------
    (MeasuredPicture, Result or None, dict of str to bytes)
        What was measured; and with `pages` its result, and by their names report.html, figures/*.png and, with
        `surface`, surface.html.
    """
    converter = settings.converter
    picture = read_picture(path, converter.options)
    height, width = picture.shape
    files = [file.path for file in settings.inputs if file.role == "regions"]
    require_on_image(settings.rois, settings.image_size, (width, height), *files)
    luminance = converter.luminance(picture)
    settings = settings.located(luminance)
    measured = measure_picture(luminance, converter.source(picture), settings)
    if settings.colours:
        measured = _with_colours(measured, picture, settings)
    pairs = [(pair.bright_region.roi, pair.dark_region.roi) for pair in measured.pairs]
    findings = converter.with_pairs(measured.findings, picture, luminance, pairs)
    measured = replace(measured, file=str(path), findings=findings)
    if not pages:
        return measured, None, {}
    result = image_result([measured], settings)
    figures = picture_figures(measured, picture, luminance)
    made = {
        "report.html": picture_page(measured, result, figures, settings.cdp_limit, surface).encode(),
        **{f"figures/{figure.file_name}": figure.png for figure in figures},
    }
    if surface:
        from .surface import surface_page

        made["surface.html"] = surface_page(luminance, path.name, measured.unit).encode()
    return measured, result, made


def _with_colours(measured: MeasuredPicture, picture: Picture, settings: ImageSettings) -> MeasuredPicture:
    """Return a measured picture with the colours of its pairs; raises InputError if it is grey."""
    from ..colour.measure import measure_colours
    from .colours import picture_colours

    colours = picture_colours(picture, settings.converter)
    assert isinstance(settings.epsilon, int | float)
    pairs = measure_colours(colours, settings.rois, settings.chosen_pairs, settings.epsilon)
    findings = [finding for pair in pairs for finding in pair.separation.findings]
    return replace(measured, colours=pairs, findings=unique([*measured.findings, *findings]))


def image_result(pictures: Sequence[MeasuredPicture], settings: ImageSettings) -> Result:
    """Return the result of one or several pictures, in the order they were given."""
    sources = [(picture.file, picture.source) for picture in pictures if picture.source is not None]
    several, contrasts = len(pictures) > 1, settings.contrasts
    cdp = cdp_table(pictures, several, settings.cdp_limit)
    if several:
        from .summary import MOST_ROWS, summary_table

        tables = [summary_table(cdp, settings.cdp_limit), cdp if len(cdp) <= MOST_ROWS else cdp.as_detail()]
    else:
        tables = [cdp]
    findings = _findings(pictures)
    if settings.requirement is not None:
        judgement = judged_pairs(settings.requirement, seen_contrasts(pictures, several))
        tables.insert(0, judgement.table)
        findings = unique([*findings, *judgement.findings])
    charts = [(picture.file, picture.chart) for picture in pictures if picture.chart is not None]
    if charts:
        from ..chart.tables import matrix_tables, patch_table, range_table

        # Pairs and regions of a chart are many.
        tables = [range_table(charts, several), *(table.as_detail() for table in tables)]
        tables.append(patch_table(charts, several))
        # Of several pictures each has its page with the matrix.
        tables += matrix_tables(charts[0][1]) if not several else ()
    colours = [(picture.file, picture.colours) for picture in pictures if picture.colours]
    if colours:
        from ..colour.tables import colour_table

        tables.append(colour_table(colours, several))
    regions = region_table(pictures, several)
    tables += [regions.as_detail() if charts else regions, picture_table(pictures, several)]
    if several and contrasts is not None and len(pictures) <= _MOST_PICTURES:
        tables += matrices(pictures, settings, contrasts)
    return Result(
        kind="image",
        title=f"{len(pictures)} pictures" if several else pictures[0].file,
        tables=tuple(table for table in tables if len(table)),
        findings=findings,
        inputs=(*(InputFile("picture", file, source.sha256) for file, source in sources), *settings.inputs),
        configuration=settings.configuration,
        simulated=any(source.simulated for _, source in sources),
    )


def _findings(pictures: Sequence[MeasuredPicture]) -> tuple[Finding, ...]:
    """Return each finding once and, of several pictures, which ones it is about if not all of them."""
    failed = [
        error("picture-failed", picture.file, reason=picture.failure) for picture in pictures if picture.source is None
    ]
    files: dict[Finding, list[str]] = {}
    for picture in pictures:
        for finding in picture.findings:
            files.setdefault(finding, []).append(picture.file)
    encodings = {finding.values["encoding"] for finding in files if finding.code.startswith("encoding-assumed")}
    n_measured = len(pictures) - len(failed)
    if len(encodings) > 1:
        failed.append(warning("encodings-differ"))
    named = [
        finding if len(names) == n_measured else replace(finding, values={**finding.values, "files": names})
        for finding, names in files.items()
    ]
    return unique([*failed, *named])


#: Longest part of a file's name in that of its folder.
_LONGEST_STEM = 60


def picture_folder(number: int, path: Path) -> str:
    """Name of the folder of a picture's page: unlike that of any other, and known by number and name."""
    stem = re.sub(r"[^\w.-]+", "-", path.stem)[:_LONGEST_STEM].strip("-.")
    return f"picture-{number}-{stem}" if stem else f"picture-{number}"


def summary_files(pictures: Sequence[MeasuredPicture], result: Result, conversion: str) -> dict[str, bytes]:
    """Make the files over all pictures: results.json, results.xlsx and, of several, report.html.

    Parameters
    ----------
    pictures : sequence of MeasuredPicture
        In the order they were given.
    result : Result
        Of all of them.
    conversion : str
        Description of the conversion to luminance.
    """
    files = {"results.json": envelope_json(result).encode(), "results.xlsx": result_workbook(result, datetime.now(UTC))}
    if len(pictures) > 1:
        from .summary import overview_page

        files["report.html"] = overview_page(result, pictures, conversion).encode()
    return files
