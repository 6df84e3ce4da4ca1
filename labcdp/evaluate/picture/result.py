"""The result of pictures: tables of CDP and regions, findings, and what they were made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ...core.finding import Finding, error, unique
from ...core.result import InputFile, Result
from .request import ImageRequest
from .tables import ReportedPicture, cdp_table, matrices, picture_table, region_table

#: Columns that a sheet can have, less the one for the contrasts.
_MOST_PICTURES = 2**14 - 1


def image_result(
    pictures: Sequence[ReportedPicture],
    request: ImageRequest,
    configuration: Mapping[str, Any],
    inputs: Sequence[InputFile] = (),
) -> Result:
    """Return the result of one or several pictures.

    Parameters
    ----------
    pictures : sequence of ReportedPicture
        In the order they were given.
    request : ImageRequest
        What was asked.
    configuration : mapping
        What the command was given.
    inputs : sequence of InputFile
        Files other than the pictures, such as regions and calibration.
    """
    good = [one for one in pictures if one.evaluation is not None]
    several = len(pictures) > 1
    tables = [cdp_table(good, several), region_table(good, several), picture_table(pictures, several)]
    if several and request.contrasts is not None and len(pictures) <= _MOST_PICTURES:
        tables += matrices(pictures, request, request.contrasts)
    taken = [InputFile("picture", one.file, one.evaluation.sha256) for one in pictures if one.evaluation is not None]
    return Result(
        kind="image",
        title=f"{len(pictures)} pictures" if several else pictures[0].file,
        tables=tuple(table for table in tables if len(table)),
        findings=_findings(pictures),
        inputs=(*taken, *inputs),
        configuration=configuration,
        simulated=any(one.evaluation.simulated for one in good if one.evaluation is not None),
    )


def _findings(pictures: Sequence[ReportedPicture]) -> tuple[Finding, ...]:
    """Return each finding once and, of several pictures, which ones it is about if not all of them."""
    failed = [error("picture-failed", one.file, reason=one.failure) for one in pictures if one.evaluation is None]
    found: dict[Finding, list[str]] = {}
    for one in pictures:
        for finding in () if one.evaluation is None else one.evaluation.findings:
            found.setdefault(finding, []).append(one.file)
    of_some = [
        finding
        if len(files) == len(pictures) - len(failed)
        else replace(finding, values={**finding.values, "files": files})
        for finding, files in found.items()
    ]
    return unique([*failed, *of_some])
