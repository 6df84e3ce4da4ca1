"""The result of pictures: tables of CDP and regions, findings, and what they were made from."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...core.result import Finding, InputFile, Result, error, unique, warning
from ...files.read import read_picture
from ...regions import load_regions
from ...report.files import envelope_json
from ...report.sheets import result_workbook
from ..requirement import judged_pairs
from .conversion import PictureConversion
from .figures import image_figures
from .image import ImageEvaluation, ImageRequest, evaluate_image
from .page import MOST_ROWS, overview_page, picture_page
from .summary import summary_table
from .tables import ReportedPicture, cdp_table, matrices, picture_table, region_table, seen_contrasts

#: Columns that a sheet can have, less the one for the contrasts.
_MOST_PICTURES = 2**14 - 1


@dataclass(frozen=True)
class PictureTask:
    """How pictures are evaluated; can be sent to another process.

    Parameters
    ----------
    request : ImageRequest
        What is asked.
    conversion : PictureConversion
        How values become luminance.
    configuration : mapping
        What the command was given.
    inputs : tuple of InputFile
        Files other than the pictures, such as regions and calibration.
    regions : Path or None
        File of the regions: those outside a picture, or drawn on one of another size, are refused.
    """

    request: ImageRequest
    conversion: PictureConversion
    configuration: Mapping[str, Any]
    inputs: tuple[InputFile, ...] = ()
    regions: Path | None = None

    def made(self, path: Path, *, pages: bool, surface: bool) -> tuple[ImageEvaluation, dict[str, bytes]]:
        """Evaluate a picture, and make its page.

        Returns
        -------
        (ImageEvaluation, dict of str to bytes)
            Its contrasts; and with `pages`, by their names, report.html, figures/*.png and, with `surface`,
            surface.html.
        """
        picture = read_picture(path, self.conversion.options)
        height, width = picture.shape
        if self.regions is not None:
            load_regions(self.regions, (width, height))
        luminance = self.conversion.luminance(picture)
        evaluation = evaluate_image(luminance, self.conversion.source(picture), self.request)
        pairs = [(pair.bright_region.roi, pair.dark_region.roi) for pair in evaluation.pairs]
        findings = self.conversion.with_pairs(evaluation.findings, picture, luminance, pairs)
        evaluation = replace(evaluation, findings=findings)
        if not pages:
            return evaluation, {}
        result = self.result([ReportedPicture(1, str(path), "", evaluation)])
        figures = image_figures(evaluation, picture, luminance)
        files = {
            "report.html": picture_page(result, figures, self.conversion.description, surface).encode(),
            **{f"figures/{figure.file_name}": figure.png for figure in figures},
        }
        if surface:
            from .surface import surface_page

            files["surface.html"] = surface_page(luminance, path.name, evaluation.source.unit).encode()
        return evaluation, files

    def result(self, pictures: Sequence[ReportedPicture]) -> Result:
        """Return the result of one or several pictures, in the order they were given."""
        good = [one for one in pictures if one.evaluation is not None]
        sources = [(one.file, one.evaluation.source) for one in pictures if one.evaluation is not None]
        several, contrasts = len(pictures) > 1, self.request.contrasts
        cdp = cdp_table(good, several, self.request.cdp_limit)
        if several:
            overall = summary_table(cdp, self.request.cdp_limit)
            tables = [overall, cdp if len(cdp) <= MOST_ROWS else cdp.as_detail()]
        else:
            tables = [cdp]
        findings = _findings(pictures)
        if self.request.requirement is not None:
            judgement = judged_pairs(self.request.requirement, seen_contrasts(good, several))
            tables.insert(0, judgement.table)
            findings = unique([*findings, *judgement.findings])
        tables += [region_table(good, several), picture_table(pictures, several)]
        if several and contrasts is not None and len(pictures) <= _MOST_PICTURES:
            tables += matrices(pictures, self.request, contrasts)
        return Result(
            kind="image",
            title=f"{len(pictures)} pictures" if several else pictures[0].file,
            tables=tuple(table for table in tables if len(table)),
            findings=findings,
            inputs=(*(InputFile("picture", file, source.sha256) for file, source in sources), *self.inputs),
            configuration=self.configuration,
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
