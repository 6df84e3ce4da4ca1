"""The report of a calibration as files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from .calibration_page import calibration_document, combination_document
from .calibration_sheets import calibration_sheets, combination_sheets
from .folder import write_files
from .page import document_page
from .workbook import workbook

if TYPE_CHECKING:
    from ..calibration import Calibration
    from ..calibration.colour import ColourCalibration


def write_calibration_report(
    calibration: Calibration | ColourCalibration, folder: str | PathLike[str], title: str = ""
) -> list[Path]:
    """Write what a calibration says about itself: for people, and for spreadsheets.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        What to report.
    folder : path
        Made if it does not exist; files of an earlier report are replaced.
    title : str
        Name of the measurement; empty for that of the camera.

    Returns
    -------
    list of Path
        calibration.html and calibration.xlsx.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    from ..calibration import Calibration

    if isinstance(calibration, Calibration):
        document, sheets = calibration_document(calibration, title), calibration_sheets(calibration)
        measured = calibration.provenance.measured
    else:
        document, sheets = combination_document(calibration, title), combination_sheets(calibration)
        measured = calibration.planes[0].provenance.measured
    files = {
        "calibration.html": document_page(document).encode(),
        "calibration.xlsx": workbook(sheets, document.title, measured),
    }
    return write_files(Path(folder), files)
