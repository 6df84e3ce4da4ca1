"""The result of pictures: tables of CDP and regions, findings, and what they were made from."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from ...core.result import Finding, InputFile, Result, error, unique, warning
from ...files.read import read_picture
from ...regions import require_on_image
from ...report.files import envelope_json
from ...report.sheets import result_workbook
from ..requirement import judged_pairs
from .figures import image_figures
from .image import ImageEvaluation, evaluate_image
from .page import MOST_ROWS, overview_page, picture_page
from .settings import ImageSettings
from .summary import summary_table
from .tables import ReportedPicture, cdp_table, matrices, picture_table, region_table, seen_contrasts

#: Columns that a sheet can have, less the one for the contrasts.
_MOST_PICTURES = 2**14 - 1


def evaluate_picture(
    settings: ImageSettings, path: Path, *, pages: bool, surface: bool
) -> tuple[ImageEvaluation, dict[str, bytes]]:
    """Evaluate a picture, and make its page.

    Returns
    -------
    (ImageEvaluation, dict of str to bytes)
        Its contrasts; and with `pages`, by their names, report.html, figures/*.png and, with `surface`, surface.html.
    """
    converter = settings.converter
    picture = read_picture(path, converter.options)
    height, width = picture.shape
    files = [file.path for file in settings.inputs if file.role == "regions"]
    require_on_image(settings.rois, settings.image_size, (width, height), *files)
    luminance = converter.luminance(picture)
    evaluation = evaluate_image(luminance, converter.source(picture), settings)
    pairs = [(pair.bright_region.roi, pair.dark_region.roi) for pair in evaluation.pairs]
    findings = converter.with_pairs(evaluation.findings, picture, luminance, pairs)
    evaluation = replace(evaluation, findings=findings)
    if not pages:
        return evaluation, {}
    result = image_result([ReportedPicture(1, str(path), "", evaluation)], settings)
    figures = image_figures(evaluation, picture, luminance)
    made = {
        "report.html": picture_page(result, figures, converter.description, surface).encode(),
        **{f"figures/{figure.file_name}": figure.png for figure in figures},
    }
    if surface:
        from .surface import surface_page

        made["surface.html"] = surface_page(luminance, path.name, evaluation.source.unit).encode()
    return evaluation, made


def image_result(pictures: Sequence[ReportedPicture], settings: ImageSettings) -> Result:
    """Return the result of one or several pictures, in the order they were given."""
    good = [one for one in pictures if one.evaluation is not None]
    sources = [(one.file, one.evaluation.source) for one in pictures if one.evaluation is not None]
    several, contrasts = len(pictures) > 1, settings.contrasts
    cdp = cdp_table(good, several, settings.cdp_limit)
    if several:
        overall = summary_table(cdp, settings.cdp_limit)
        tables = [overall, cdp if len(cdp) <= MOST_ROWS else cdp.as_detail()]
    else:
        tables = [cdp]
    findings = _findings(pictures)
    if settings.requirement is not None:
        judgement = judged_pairs(settings.requirement, seen_contrasts(good, several))
        tables.insert(0, judgement.table)
        findings = unique([*findings, *judgement.findings])
    tables += [region_table(good, several), picture_table(pictures, several)]
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


def _findings(pictures: Sequence[ReportedPicture]) -> tuple[Finding, ...]:
    """Return each finding once and, of several pictures, which ones it is about if not all of them."""
    failed = [error("picture-failed", one.file, reason=one.failure) for one in pictures if one.evaluation is None]
    found: dict[Finding, list[str]] = {}
    for one in pictures:
        for finding in () if one.evaluation is None else one.evaluation.findings:
            found.setdefault(finding, []).append(one.file)
    taken = {one.values["encoding"] for one in found if one.code.startswith("encoding-assumed")}
    if len(taken) > 1:
        failed.append(warning("encodings-differ"))
    of_some = [
        finding
        if len(files) == len(pictures) - len(failed)
        else replace(finding, values={**finding.values, "files": files})
        for finding, files in found.items()
    ]
    return unique([*failed, *of_some])


#: Longest part of a file's name in that of its folder.
_LONGEST_STEM = 60


def picture_folder(number: int, path: Path) -> str:
    """Name of the folder of a picture's page: unlike that of any other, and known by number and name."""
    stem = re.sub(r"[^\w.-]+", "-", path.stem)[:_LONGEST_STEM].strip("-.")
    return f"picture-{number}-{stem}" if stem else f"picture-{number}"


def summary_files(pictures: Sequence[ReportedPicture], result: Result, conversion: str) -> dict[str, bytes]:
    """Make the files over all pictures: results.json, results.xlsx and, of several, report.html.

    Parameters
    ----------
    pictures : sequence of ReportedPicture
        In the order they were given.
    result : Result
        Of all of them.
    conversion : str
        How values became luminance.
    """
    files = {"results.json": envelope_json(result).encode(), "results.xlsx": result_workbook(result, datetime.now(UTC))}
    if len(pictures) > 1:
        files["report.html"] = overview_page(result, pictures, conversion).encode()
    return files
