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
from .history_figure import Camera, history_figure
from .page import document_page
from .tables import Table
from .wording import listed, minute
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
    cameras = by_camera(found)
    if path.suffix == ".png":
        if len(cameras) != 1:
            names = "; ".join(history_title(one) for one in cameras)
            raise InputError(
                f"a picture shows one camera and setting, these are {len(cameras)} ({names}): give an .html"
            )
        data = history_figure(cameras[0])
    elif path.suffix == ".xlsx":
        times = [point.measured for one in found for point in one.points]
        data = workbook([_sheet(one, number) for number, one in enumerate(cameras, start=1)], "History", max(times))
    else:
        data = document_page(_document(cameras)).encode()
    write_files(path.parent, {path.name: data})


def by_camera(found: Sequence[CameraHistory]) -> list[Camera]:
    """Put the planes of each camera, lens and setting together."""
    groups: dict[tuple[object, ...], list[CameraHistory]] = {}
    for one in found:
        groups.setdefault((one.camera, one.lens, one.gain_db, one.pixel_format, one.plane is None), []).append(one)
    return [tuple(group) for group in groups.values()]


def history_title(planes: Camera) -> str:
    """Name camera, lens and setting on one line."""
    one = planes[0]
    lens = f"{one.lens.model}{f' ({one.lens.serial})' if one.lens.serial else ''} at f/{one.lens.f_number:g}"
    single = f", plane {one.plane}" if one.plane and len(planes) == 1 else ""
    return printable(f"{one.camera}, {lens}, {one.gain_db:g} dB, {one.pixel_format}{single}")


def history_table(planes: Camera) -> Table:
    """Points of a history by time, with 95 % half widths; that of the responsivity holds the meter's scale.

    A table of planes is wide, so one meter for all is left to the text.
    """
    several = len(planes) > 1
    meters = not several or len({point.meter for one in planes for point in one.points}) > 1
    return Table(
        (
            "measured",
            "by",
            *(("plane", "weight") if several else ()),
            "responsivity (DN s⁻¹ / (cd m⁻²))",
            "of which not the meter's scale (%)",
            "dark offset (DN)",
            "dark rate (DN/s)",
            "K (DN/e⁻)",
            *(("meter",) if meters else ()),
        ),
        tuple(
            (*_row(point, (f"{one.plane}", _weight(point)) if several else ()), *(_meter(point) if meters else ()))
            for one, point in _by_time(planes)
        ),
    )


def _by_time(planes: Camera) -> list[tuple[CameraHistory, HistoryPoint]]:
    """Points of all planes, those of one measurement together."""
    points = [(one, point) for one in planes for point in one.points]
    return sorted(points, key=lambda pair: (pair[1].measured, pair[1].source))


def _weight(point: HistoryPoint) -> str:
    return "-" if point.weight is None else fixed(point.weight, 3, sign=True)


def _row(point: HistoryPoint, of_plane: tuple[str, ...]) -> tuple[str, ...]:
    r, own, whole = point.responsivity_dn_s_cd_m2, point.random_half_width_rel, point.half_width_95_rel
    rate = "unknown"
    if point.dark_rate_dn_s is not None and point.dark_rate_half_width_dn_s is not None:
        rate = with_half_width(point.dark_rate_dn_s, point.dark_rate_half_width_dn_s)
    return (
        minute(point.measured),
        point.kind if point.verdict is None else f"verification: {point.verdict}",
        *of_plane,
        "-" if r is None or whole is None else with_half_width(r, r * whole),
        "-" if own is None else f"± {significant(100 * own, 2)}",
        with_half_width(point.dark_offset_dn, point.dark_offset_half_width_dn),
        rate,
        "-" if point.k_dn_per_e is None else significant(point.k_dn_per_e, 3),
    )


def _meter(point: HistoryPoint) -> tuple[str, ...]:
    return (printable(point.meter),)


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


def change_text(planes: Camera) -> str:
    """Tell in a sentence or two how the responsivity changed."""
    changes = [(one, one.change_rel) for one in planes]
    known = [(one, *change) for one, change in changes if change is not None]
    if not known:
        return "One measurement so far: there is nothing to compare it with yet."
    texts = [f"{_change(change, half_width)}{_in_plane(one)}" for one, change, half_width in known]
    beyond = [one for one, change, half_width in known if abs(change) > half_width]
    if not beyond:
        verdict = "which is within its uncertainty"
    elif len(beyond) == len(known):
        verdict = "which is more than its uncertainty"
    else:
        verdict = f"which is more than its uncertainty in {listed([f'{one.plane}' for one in beyond])}"
    points = [point for point in known[0][0].points if point.responsivity_dn_s_cd_m2 is not None]
    same = points[0].meter == points[-1].meter
    meter = (
        f"the meter {printable(points[0].meter)} is the same, so its scale cancels"
        if same
        else "another meter was used, so both scales count"
    )
    return (
        f"From the first to the last measurement the responsivity changed by {listed(texts)} (95 %), {verdict}; "
        f"{meter}."
    )


def _change(change: float, half_width: float) -> str:
    n = decimals(100 * half_width, 2) if half_width else 2
    return f"{fixed(100 * change, n, sign=True)} % ± {fixed(100 * half_width, n)} %"


def _in_plane(one: CameraHistory) -> str:
    return f" in plane {one.plane}" if one.plane else ""


def _document(cameras: Sequence[Camera]) -> Document:
    sections = [
        Section(
            title=history_title(planes),
            paragraphs=(change_text(planes),),
            tables=(("Calibrations and verifications, with 95 % half widths", history_table(planes)),),
            figures=(
                ReportFigure(
                    f"history-{number}.png",
                    history_figure(planes),
                    "Filled: calibrations, open: verifications. The thick bar holds 95 % without the meter's scale, "
                    "which measurements with one meter share; the thin bar holds 95 % with it.",
                    f"Responsivity and darkness of {printable(str(planes[0].camera))}, {len(planes[0].points)} times.",
                ),
            ),
        )
        for number, planes in enumerate(cameras, start=1)
    ]
    simulated = any(planes[0].camera.simulated for planes in cameras)
    banner = "Simulated: cameras of a simulated bench are among these; their numbers are of no real camera."
    files = [Fact(minute(point.measured), printable(point.source)) for planes in cameras for point in planes[0].points]
    now = datetime.now(UTC)
    written = Fact("Written", f"{minute(now)} by labcdp {version('labcdp')}")
    provenance = Section("Provenance", facts=(*files, written))
    title = "History of one camera" if len(cameras) == 1 else f"History of {len(cameras)} cameras or settings"
    return Document(
        "labcdp report: history of calibrations", title, banner if simulated else "", (), (*sections, provenance)
    )


def _sheet(planes: Camera, number: int) -> Sheet:
    header = (
        "measured",
        "by",
        "verdict",
        "plane",
        "weight",
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
    for one, p in _by_time(planes):
        r, own, whole = p.responsivity_dn_s_cd_m2, p.random_half_width_rel, p.half_width_95_rel
        n_rate = decimals(p.dark_rate_half_width_dn_s, 2) if p.dark_rate_half_width_dn_s else 2
        n_offset = decimals(p.dark_offset_half_width_dn, 2)
        rows.append(
            (
                minute(p.measured),
                p.kind,
                p.verdict,
                one.plane,
                None if p.weight is None else Number(p.weight, 4),
                None if r is None or whole is None else Number(r, decimals(r * whole, 2)),
                _percent(whole),
                _percent(own),
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
    return Sheet(f"Camera {number}", header, [*rows, (history_title(planes), *(None for _ in header[1:]))])


def _percent(fraction: float | None) -> Number | None:
    return None if fraction is None else Number(100 * fraction, decimals(100 * fraction, 2))
