"""The results of pictures as files: pages, surfaces, figures, a spreadsheet and numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..json_text import results_json
from .image_figures import image_figures
from .image_page import ReportedPicture, overview_page, picture_page
from .image_sheets import image_sheets
from .image_surface import surface_page
from .workbook import workbook

if TYPE_CHECKING:
    from ..evaluate.image import ImageEvaluation, ImageRequest
    from ..luminance import LuminanceMap
    from ..sources.picture import Picture

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
    conversion: str,
    epsilon: float,
    surface: bool,
) -> dict[str, bytes]:
    """Make the files of one picture, by their names: report.html, figures/*.png and, if wanted, surface.html.

    Parameters
    ----------
    evaluation : ImageEvaluation
        What it says.
    picture, luminance : Picture, LuminanceMap
        Its values.
    conversion : str
        How these became luminance.
    epsilon : float
        Tolerance of the contrasts.
    surface : bool
        Whether the page with the surface is wanted.
    """
    figures = image_figures(evaluation, picture, luminance)
    files = {
        "report.html": picture_page(evaluation, figures, conversion, surface, epsilon).encode(),
        **{f"figures/{figure.file_name}": figure.png for figure in figures},
    }
    if surface:
        files["surface.html"] = surface_page(luminance, evaluation.path.name, evaluation.unit).encode()
    return files


def summary_files(
    pictures: Sequence[ReportedPicture],
    request: ImageRequest,
    conversion: str,
    configuration: dict[str, Any],
    written: Sequence[str],
) -> dict[str, bytes]:
    """Make the files over all pictures: results.json, results.xlsx and, of several, report.html.

    Parameters
    ----------
    pictures : sequence of ReportedPicture
        In the order they were given.
    request : ImageRequest
        What was asked.
    conversion : str
        How values became luminance.
    configuration : dict
        What the command was given, for the record; values JSON can hold.
    written : sequence of str
        Names of the files of the pictures, for the record.
    """
    names = [*written, "results.json", "results.xlsx", *(["report.html"] if len(pictures) > 1 else [])]
    values = image_values(pictures, request, conversion, configuration)
    sheets = image_sheets(pictures, request, conversion)
    files = {
        "results.json": results_json({**values, "written": sorted(set(names))}).encode(),
        "results.xlsx": workbook(sheets, "CDP of pictures", datetime.now(UTC)),
    }
    if len(pictures) > 1:
        files["report.html"] = overview_page(pictures, conversion, request.epsilon).encode()
    return files


def image_values(
    pictures: Sequence[ReportedPicture], request: ImageRequest, conversion: str, configuration: dict[str, Any]
) -> dict[str, Any]:
    """Return all numbers, values JSON can hold; parameters as for `summary_files`."""
    return {
        "contrasts": list(request.contrasts),
        "epsilon": request.epsilon,
        "conversion": conversion,
        "pictures": [
            {"number": one.number, "folder": one.folder, **one.evaluation.to_dict()}
            for one in pictures
            if one.evaluation is not None
        ],
        "failures": [
            {"number": one.number, "file": one.file, "reason": one.failure}
            for one in pictures
            if one.evaluation is None
        ],
        "configuration": configuration,
        "versions": {name: version(name) for name in ("labcdp", "numpy", "scipy")},
    }
