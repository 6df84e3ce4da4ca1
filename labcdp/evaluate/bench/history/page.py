"""The history of cameras as page, picture and spreadsheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ....calibration.verify.history import CameraHistory
from ....core.errors import InputError
from ....core.result import Result
from ....output import write_file
from ....report.cells import cell_text
from ....report.digits import printable
from ....report.figure import ReportFigure
from ....report.html import render_page
from ....report.layout import Card, Page, Section
from ....report.sheets import result_workbook
from .figure import history_figure
from .result import Camera, by_camera, history_title


def write_history(found: Sequence[CameraHistory], result: Result, path: Path, *, force: bool = False) -> None:
    """Write histories to one file, whole or not at all.

    Parameters
    ----------
    found : sequence of CameraHistory
        At least one.
    result : Result
        Their tables.
    path : Path
        Ends in ``.html``, ``.png`` or ``.xlsx``.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    InputError
        If a picture is wanted of several cameras or settings, or the file cannot be written.
    """
    cameras = by_camera(found)
    if path.suffix == ".png":
        if len(cameras) != 1:
            names = "; ".join(history_title(one) for one in cameras)
            raise InputError(
                f"a picture shows one camera and setting, these are {len(cameras)} ({names}): give an .html"
            )
        data = history_figure(cameras[0])
    elif path.suffix == ".xlsx":
        data = result_workbook(result, max(point.measured for one in found for point in one.points))
    else:
        data = render_page(_page(cameras, result)).encode()
    write_file(path, data, force=force)


def _page(cameras: Sequence[Camera], result: Result) -> Page:
    table, history = result.table("cameras"), result.table("history")
    cards = []
    for row in table.rows():
        changed = row["changed"]
        cards.append(
            Card(
                " ".join(("Change of R", *(("in plane", row["plane"]) if row["plane"] else ()))),
                "-" if changed is None else f"{cell_text(table.column('change_rel'), row)} %",
                "one measurement so far" if changed is None else "± U (95 %), first to last measurement",
                (row["camera"],) if len(cameras) > 1 else (),
                "" if changed is None else "changed" if changed == "yes" else "within U",
                "open" if changed is None else "bad" if changed == "yes" else "good",
            )
        )
    figures = [_figure(planes, number) for number, planes in enumerate(cameras, start=1)]
    rows = [[index for index, of in enumerate(history["number"]) if of == n + 1] for n in range(len(cameras))]
    blocks = [(figure, history.select(own)) for figure, own in zip(figures, rows, strict=True)]
    one = len(cameras) == 1
    brief = ("measured", "by", "plane", "responsivity", "expanded_r", "expanded_fit_rel")
    sections = [Section(history_title(planes), of) for planes, of in zip(cameras, blocks, strict=True)]
    if one:
        sections = [Section("Calibrations and verifications", (history,))]
    return Page(
        "History of calibrations",
        result.title,
        f"{history_title(cameras[0])}: {table['first'][0]} to {table['last'][0]}." if one else "",
        "Simulated data, not measurements: some of these cameras are simulated." if result.simulated else "",
        cards,
        (figures[0], history.only(*brief)) if one else (),
        sections=[*sections, Section("Files", (history.only("measured", "by", "file").all_shown(),), collapsed=True)],
    )


def _figure(planes: Camera, number: int) -> ReportFigure:
    return ReportFigure(
        f"history-{number}.png",
        history_figure(planes),
        "Filled: calibrations, open: verifications. The thick bar is ± U (95 %) without the scale of the meter, which "
        "measurements with one meter share; the thin bar includes it.",
        f"Responsivity and dark signal of {printable(str(planes[0].camera))}, {len(planes[0].points)} times.",
    )
