"""The results of pictures as files: pages, surfaces, figures, a spreadsheet and JSON."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.result import Result
from ...report.envelope import envelope_json
from ...report.sheets import result_workbook
from .figures import image_figures
from .page import overview_page, picture_page
from .tables import ReportedPicture

if TYPE_CHECKING:
    from ...core.luminance import LuminanceMap
    from ...files.picture.read import Picture
    from .image import ImageEvaluation

#: Longest part of a file's name in that of its folder.
_LONGEST_STEM = 60


def picture_folder(number: int, path: Path) -> str:
    """Name of the folder of a picture's page: unlike that of any other, and known by number and name."""
    stem = re.sub(r"[^\w.-]+", "-", path.stem)[:_LONGEST_STEM].strip("-.")
    return f"picture-{number}-{stem}" if stem else f"picture-{number}"


def picture_files(
    evaluation: ImageEvaluation,
    picture: Picture,
    luminance: LuminanceMap,
    result: Result,
    conversion: str,
    surface: bool,
) -> dict[str, bytes]:
    """Make the files of one picture, by their names: report.html, figures/*.png and, if wanted, surface.html.

    Parameters
    ----------
    evaluation : ImageEvaluation
        Its contrasts.
    picture, luminance : Picture, LuminanceMap
        Its values.
    result : Result
        Of this picture alone.
    conversion : str
        How the values became luminance.
    surface : bool
        Whether the page with the surface is wanted.
    """
    figures = image_figures(evaluation, picture, luminance)
    files = {
        "report.html": picture_page(result, figures, conversion, surface).encode(),
        **{f"figures/{figure.file_name}": figure.png for figure in figures},
    }
    if surface:
        from .surface import surface_page

        files["surface.html"] = surface_page(luminance, evaluation.path.name, evaluation.unit).encode()
    return files


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
