"""The results of an evaluation as files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ..json_text import results_json
from .figures import draw_figures
from .folder import write_files
from .page import html_page
from .spreadsheet import spreadsheet

if TYPE_CHECKING:
    from ..evaluate import SessionEvaluation

_FIGURES = "figures"


def write_results(evaluation: SessionEvaluation, folder: str | PathLike[str]) -> list[Path]:
    """Write the results of an evaluation: for machines, for people, for spreadsheets, and as pictures.

    Everything is made before the first file is written, and each file is there whole or not at all. Files of an
    earlier evaluation in the folder are replaced; its pictures of contrasts that are no longer there are removed.

    Parameters
    ----------
    evaluation : SessionEvaluation
        What to write.
    folder : path
        Made if it does not exist.

    Returns
    -------
    list of Path
        results.json, report.html, results.xlsx and figures/*.png.

    Raises
    ------
    InputError
        If the folder cannot be made or a file cannot be written.
    """
    return write_files(Path(folder), _files(evaluation), r"contrast-\d+\.png")


def _files(evaluation: SessionEvaluation) -> dict[str, bytes]:
    """Make all files, by their names in the folder."""
    figures = draw_figures(evaluation)
    return {
        "results.json": results_json(evaluation.to_dict()).encode(),
        "report.html": html_page(evaluation, figures).encode(),
        "results.xlsx": spreadsheet(evaluation),
        **{f"{_FIGURES}/{figure.file_name}": figure.png for figure in figures},
    }
