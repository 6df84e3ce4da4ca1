"""The common files of all results: numbers, page, spreadsheet and figures."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime

from ..core.result import Result
from .envelope import envelope_json
from .figure import ReportFigure
from .html import render_page
from .layout import Page
from .sheets import result_workbook


def result_files(
    result: Result, page: Page, figures: Iterable[ReportFigure] = (), time: datetime | None = None
) -> dict[str, bytes]:
    """Return results.json, report.html, results.xlsx and figures/*.png by their names.

    Parameters
    ----------
    result : Result
        The numbers.
    page : Page
        The page.
    figures : iterable of ReportFigure
        Figures that are also written as files.
    time : datetime or None
        Time of the content, for the properties of the spreadsheet; None for the current time.
    """
    return {
        "results.json": envelope_json(result).encode(),
        "report.html": render_page(page).encode(),
        "results.xlsx": result_workbook(result, time or datetime.now(UTC)),
        **{f"figures/{figure.file_name}": figure.png for figure in figures},
    }
