"""The history of cameras as table, page, picture and spreadsheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .digits import decimals, fixed, printable, significant, with_half_width
from .document import Document, Section
from .facts import Fact
from .figures import ReportFigure
from .folder import write_files
from .history_figure import history_figure
from .page import document_page
from .tables import Table
from .wording import minute
from .workbook import Cell, Number, Sheet, workbook

if TYPE_CHECKING:
    from ..calibration.history import CameraHistory, HistoryPoint


def write_history(found: Sequence[CameraHistory], path: Path) -> None:
    """Write histories to one file, whole or not at all.

    Parameters
    ----------
    found : sequence of CameraHistory
        At least one.
    path : Path
        Ends in ``.html``, ``.png`` or ``.xlsx``; a file that is there is replaced.

    Raises
    ------
    InputError
        If a picture is wanted of several cameras or settings, or the file cannot be written.
    """
    if path.suffix == ".png":
        if len(found) != 1:
            names = "; ".join(history_title(one) for one in found)
            raise InputError(f"a picture shows one camera and setting, these are {len(found)} ({names}): give an .html")
        data = history_figure(found[0])
    elif path.suffix == ".xlsx":
        times = [point.measured for one in found for point in one.points]
        data = workbook([_sheet(one, number) for number, one in enumerate(found, start=1)], "History", max(times))
    else:
        data = document_page(_document(found)).encode()
    write_files(path.parent, {path.name: data})


def history_title(one: CameraHistory) -> str:
    """Name camera, lens and setting on one line."""
    lens = f"{one.lens.model}{f' ({one.lens.serial})' if one.lens.serial else ''} at f/{one.lens.f_number:g}"
    plane = f", plane {one.plane}" if one.plane else ""
    return printable(f"{one.camera}, {lens}, {one.gain_db:g} dB, {one.pixel_format}{plane}")


def history_table(one: CameraHistory) -> Table:
    """Points of a history by time, with 95 % half widths; that of the responsivity holds the meter's scale."""
    return Table(
        (
            "measured",
            "by",
            "responsivity (DN s⁻¹ / (cd m⁻²))",
            "of which not the meter's scale (%)",
            "dark offset (DN)",
            "dark rate (DN/s)",
            "K (DN/e⁻)",
            "meter",
        ),
        tuple(_row(point) for point in one.points),
    )


def _row(point: HistoryPoint) -> tuple[str, ...]:
    r = point.responsivity_dn_s_cd_m2
    rate = "unknown"
    if point.dark_rate_dn_s is not None and point.dark_rate_half_width_dn_s is not None:
        rate = with_half_width(point.dark_rate_dn_s, point.dark_rate_half_width_dn_s)
    return (
        minute(point.measured),
        point.kind if point.verdict is None else f"verification: {point.verdict}",
        with_half_width(r, r * point.half_width_95_rel),
        f"± {significant(100 * point.random_half_width_rel, 2)}",
        with_half_width(point.dark_offset_dn, point.dark_offset_half_width_dn),
        rate,
        "-" if point.k_dn_per_e is None else significant(point.k_dn_per_e, 3),
        printable(point.meter),
    )


def history_values(found: Sequence[CameraHistory]) -> list[dict[str, Any]]:
    """Return all numbers, for JSON."""
    return [
        asdict(one)
        | {
            "points": [asdict(point) | {"measured": point.measured.isoformat()} for point in one.points],
            "change_rel": None if one.change_rel is None else list(one.change_rel),
        }
        for one in found
    ]


def change_text(one: CameraHistory) -> str:
    """Tell in a sentence how the responsivity changed."""
    if one.change_rel is None:
        return "One measurement so far: there is nothing to compare it with yet."
    change, half_width = (100 * value for value in one.change_rel)
    n = decimals(half_width, 2) if half_width else 2
    verdict = "which is within its uncertainty" if abs(change) <= half_width else "which is more than its uncertainty"
    same = one.points[0].meter == one.points[-1].meter
    meter = "the meter is the same, so its scale cancels" if same else "another meter was used, so both scales count"
    return (
        f"From the first to the last measurement the responsivity changed by {fixed(change, n, sign=True)} % ± "
        f"{fixed(half_width, n)} % (95 %), {verdict}; {meter}."
    )


def _document(found: Sequence[CameraHistory]) -> Document:
    sections = [
        Section(
            title=history_title(one),
            paragraphs=(change_text(one),),
            tables=(("Calibrations and verifications, with 95 % half widths", history_table(one)),),
            figures=(
                ReportFigure(
                    f"history-{number}.png",
                    history_figure(one),
                    "Filled: calibrations, open: verifications. The thick bar holds 95 % without the meter's scale, "
                    "which measurements with one meter share; the thin bar holds 95 % with it.",
                    f"Responsivity and darkness of {printable(str(one.camera))} at {len(one.points)} times.",
                ),
            ),
        )
        for number, one in enumerate(found, start=1)
    ]
    simulated = any(one.camera.simulated for one in found)
    banner = "Simulated: cameras of a simulated bench are among these; their numbers are of no real camera."
    files = [Fact(minute(point.measured), printable(point.source)) for one in found for point in one.points]
    now = datetime.now(UTC)
    written = Fact("Written", f"{minute(now)} by labcdp {version('labcdp')}")
    provenance = Section("Provenance", facts=(*files, written))
    title = "History of one camera" if len(found) == 1 else f"History of {len(found)} cameras or settings"
    return Document(
        "labcdp report: history of calibrations", title, banner if simulated else "", (), (*sections, provenance)
    )


def _sheet(one: CameraHistory, number: int) -> Sheet:
    header = (
        "measured",
        "by",
        "verdict",
        "responsivity in DN s⁻¹ / (cd m⁻²)",
        "95 % uncertainty in %",
        "of which not the meter's scale in %",
        "dark offset in DN",
        "95 % half width of the dark offset in DN",
        "dark rate in DN/s",
        "95 % half width of the dark rate in DN/s",
        "K in DN/e⁻",
        "meter",
        "file",
    )
    rows: list[tuple[Cell, ...]] = []
    for p in one.points:
        r = p.responsivity_dn_s_cd_m2
        n_rate = decimals(p.dark_rate_half_width_dn_s, 2) if p.dark_rate_half_width_dn_s else 2
        n_offset = decimals(p.dark_offset_half_width_dn, 2)
        rows.append(
            (
                minute(p.measured),
                p.kind,
                p.verdict,
                Number(r, decimals(r * p.half_width_95_rel, 2)),
                Number(100 * p.half_width_95_rel, decimals(100 * p.half_width_95_rel, 2)),
                Number(100 * p.random_half_width_rel, decimals(100 * p.random_half_width_rel, 2)),
                Number(p.dark_offset_dn, n_offset),
                Number(p.dark_offset_half_width_dn, n_offset),
                None if p.dark_rate_dn_s is None else Number(p.dark_rate_dn_s, n_rate),
                None if p.dark_rate_half_width_dn_s is None else Number(p.dark_rate_half_width_dn_s, n_rate),
                None if p.k_dn_per_e is None else Number(p.k_dn_per_e, decimals(p.k_dn_per_e, 3)),
                p.meter,
                p.source,
            )
        )
    # A workbook takes up to 31 characters, and none of []:*?/\ in the name of a sheet.
    return Sheet(f"Camera {number}", header, [*rows, (history_title(one), *(None for _ in header[1:]))])
