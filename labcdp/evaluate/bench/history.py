"""The history of cameras: tables, picture and page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ...calibration.verify.history import CameraHistory, HistoryPoint
from ...core.result import Finding, InputFile, Result, unique, warning
from ...core.table import Column, Table, with_expanded
from ...report.drawing import BLUE, GREEN, LABEL_SIZE, TITLE_SIZE, VERMILLION, finish, new_figure, reported
from ...report.files import result_files
from ...report.layout import Card, Page, ReportFigure, Section, State, page_text
from ...report.text import cell_text, minute, printable
from .quantities import RESPONSIVITY

if TYPE_CHECKING:
    from matplotlib.axes import Axes


#: A camera with a lens and a setting: its planes, or the one history of a monochrome sensor.
Camera: TypeAlias = tuple[CameraHistory, ...]
#: A value with its expanded uncertainties, without and with what points share; None where it is not known.
_Value: TypeAlias = "tuple[float, float, float] | None"
#: Colour of a plane, and shape of its marks.
_STYLES = {"R": (VERMILLION, "^"), "Gr": (GREEN, "o"), "Gb": (GREEN, "s"), "B": (BLUE, "v")}
#: Verdict on a change, and its colour.
_STATES: dict[str, tuple[str, State]] = {"yes": ("changed", "bad"), "no": ("within U", "good")}
#: Planes measured at one time stand side by side, so far apart, as a share of the time that is shown.
_APART = 0.012


class _Row(NamedTuple):
    """A row of a table: a camera by its number and title, one of its planes, and a point of it."""

    number: int
    camera: str
    history: CameraHistory
    point: HistoryPoint


def by_camera(histories: Sequence[CameraHistory]) -> list[Camera]:
    """Put the planes of each camera, lens and setting together."""
    groups: dict[tuple[object, ...], list[CameraHistory]] = {}
    for history in histories:
        key = (
            history.state.camera,
            history.lens,
            history.state.gain_db,
            history.state.pixel_format,
            history.plane is None,
        )
        groups.setdefault(key, []).append(history)
    return [tuple(group) for group in groups.values()]


def history_title(planes: Camera) -> str:
    """Return camera, lens and setting on one line."""
    first = planes[0]
    lens = f"{first.lens.model}{f' ({first.lens.serial})' if first.lens.serial else ''} at f/{first.lens.f_number:g}"
    single = f", plane {first.plane}" if first.plane and len(planes) == 1 else ""
    return printable(f"{first.state.camera}, {lens}, {first.state.gain_db:g} dB, {first.state.pixel_format}{single}")


def history_result(histories: Sequence[CameraHistory], inputs: Sequence[InputFile] = ()) -> Result:
    """Return all numbers of the histories of cameras.

    Parameters
    ----------
    found : sequence of CameraHistory
        At least one.
    inputs : sequence of InputFile
        Files of the calibrations and verifications.
    """
    cameras = by_camera(histories)
    title = "History of one camera" if len(cameras) == 1 else f"History of {len(cameras)} cameras or settings"
    last, rows = [], []
    for number, planes in enumerate(cameras, start=1):
        points = [_Row(number, history_title(planes), history, point) for history in planes for point in history.points]
        last += [_Row(number, history_title(planes), history, history.points[-1]) for history in planes]
        # By time, and those of one measurement together.
        rows += sorted(points, key=lambda row: (row.point.measured, row.point.source))
    first = (
        Column("number", "number", "", "Number of camera, lens and setting in this result.", shown=len(cameras) > 1),
        Column("plane", "plane", "", "Colour plane.", shown=any(len(planes) > 1 for planes in cameras),
               value=lambda row: row.history.plane or ""),
    )  # fmt: skip
    tables = (_changes(first, last), _history(first, rows))
    simulated = any(planes[0].state.camera.simulated for planes in cameras)
    return Result("history", title, tables, _findings(histories), inputs=tuple(inputs), simulated=simulated)


def _changes(first: tuple[Column, Column], rows: Sequence[_Row]) -> Table:
    """Return the change of each plane; the rows are of its last point."""
    columns = (
        first[0],
        Column("camera", "camera", "", "Model and serial number, lens and setting."),
        first[1],
        Column("n_points", "points", "", "Number of measurements, for calibrations or verifications.",
               value="history.n_measurements"),
        Column("first", "first", "", "Time of the first.", value=lambda row: minute(row.history.points[0].measured)),
        Column("last", "last", "", "Time of the last one.", value=lambda row: minute(row.point.measured)),
        *with_expanded(
            Column("change_rel", "change of R", "%", "From first to last; the scale error of a single meter cancels.",
                   value="history.change_rel.0"),
            "history.change_rel.1", "expanded_rel",
        ),
        Column("changed", "changed", "", "Whether the change exceeds its U.",
               value=lambda row: (of := row.history.change_rel) and ("yes" if abs(of[0]) > of[1] else "no")),
    )  # fmt: skip
    return Table.of_items("cameras", "Change of responsivity", columns, rows)


def _history(first: tuple[Column, Column], rows: Sequence[_Row]) -> Table:
    """Return one row for each number of a camera, plane and point."""
    offset = Column("dark_offset_dn", "dark offset", "DN", "At exposure time 0.", value="point.dark_offset_dn.0")
    rate = Column("dark_rate_dn_s", "dark rate", "DN/s", "Growth with exposure time.", value="point.dark_rate_dn_s.0")
    columns = (
        first[0],
        Column("measured", "measured", "", "Time of the last reading.", value=lambda row: minute(row.point.measured)),
        Column("by", "by", "", "Calibration, or verification with its verdict.",
               value=lambda row: f"verification: {row.point.verdict}" if row.point.verdict else "calibration"),
        first[1],
        Column("weight", "weight", "", "Of the plane in the luminance.", decimals=3, shown=first[1].shown,
               value="point.weight"),
        *with_expanded(
            Column("responsivity", "responsivity", RESPONSIVITY, "U includes the scale of the meter.",
                   value="point.responsivity.0"),
            lambda row: (r := row.point.responsivity) and r[0] * r[2], "expanded_r",
        ),
        Column("expanded_fit_rel", "U without meter scale", "%", "Relative U (95 %), the meter's scale excluded.", 2,
               value="point.responsivity.1"),
        *with_expanded(offset, "point.dark_offset_dn.1"),
        *with_expanded(rate, "point.dark_rate_dn_s.1"),
        Column("k_dn_per_e", "K", "DN/e⁻", "Overall system gain.", digits=3, value="point.k_dn_per_e"),
        Column("meter", "meter", "", "Model and serial number of the meter.",
               shown=len({str(row.point.meter) for row in rows}) > 1, value=lambda row: str(row.point.meter)),
        Column("file", "file", "", "Source file.", shown=False, value="point.source"),
    )  # fmt: skip
    note = "± is U (95 %), the scale error of the meter included."
    return Table.of_items("history", "Calibrations and verifications", columns, rows, note)


def _findings(histories: Sequence[CameraHistory]) -> tuple[Finding, ...]:
    """Name meters that were calibrated again, whose change a change may be, and calibrations of one measurement."""
    points = [pair for history in histories for pair in pairwise(history.points)]
    pairs = [(a.meter, b.meter) for a, b in points if not b.meter.is_as_in(a.meter)]
    recalibrated = [
        warning("meter-recalibrated", f"{b.meter.model} {b.meter.serial}", now=b.state, then=a.state)
        for a, b in pairs
        if (a.meter.model, a.meter.serial) == (b.meter.model, b.meter.serial)
    ]
    same = []
    for history in histories:
        for n, point in enumerate(history.points):
            before = next((other for other in history.points[:n] if point.is_measured_with(other)), None)
            if before is not None:
                same.append(warning("measured-once", point.source, other=before.source))
    return unique([*recalibrated, *same])


def history_figure(planes: Camera, number: int = 1) -> ReportFigure:
    """Draw responsivity, weights, dark offset, dark rate and K over time; planes in their colours."""
    from matplotlib import dates

    first, several = planes[0], len(planes) > 1
    panels = {
        "change of the\nresponsivity in %" if several else "responsivity in\nDN s⁻¹ / (cd m⁻²)": [
            _responsivities(history, several) for history in planes
        ],
        "weight in the\nluminance": [[_exact(p.weight) for p in history.points] for history in planes],
        "dark offset in DN": [[_with_u(p.dark_offset_dn) for p in history.points] for history in planes],
        "dark rate in DN/s": [[_with_u(p.dark_rate_dn_s) for p in history.points] for history in planes],
        "K in DN/e⁻": [[_exact(p.k_dn_per_e) for p in history.points] for history in planes],
    }
    shown = {label: values for label, values in panels.items() if any(v for of_plane in values for v in of_plane)}
    figure = new_figure(6.4, 0.9 + 1.25 * len(shown), "camera" if first.state.camera.simulated else "")
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (label, values) in zip(axes, shown.items(), strict=True):
        for position, (history, of_plane) in enumerate(zip(planes, values, strict=True)):
            _draw(panel, history, of_plane, position - (len(planes) - 1) / 2)
        finish(panel, "", label, "", loc="upper left", bbox_to_anchor=(1.01, 1.0))
        panel.margins(x=0.06, y=0.15)
        panel.ticklabel_format(axis="y", useOffset=False)
    lens = f"{first.lens.model} at f/{first.lens.f_number:g}, {first.state.gain_db:g} dB"
    axes[0].set_title(f"{printable(str(first.state.camera))}\n{printable(lens)}", fontsize=TITLE_SIZE, parse_math=False)
    axes[-1].set_xlabel("time of measurement (UTC)", fontsize=LABEL_SIZE)
    # matplotlib's dates have no types.
    make: Any = dates
    locator = make.AutoDateLocator(minticks=3, maxticks=8)
    axes[-1].xaxis.set_major_locator(locator)
    axes[-1].xaxis.set_major_formatter(make.ConciseDateFormatter(locator))
    return reported(
        f"history-{number}",
        figure,
        page_text("history"),
        page_text("history-picture", camera=str(first.state.camera), n_points=len(first.points)),
    )


def _responsivities(history: CameraHistory, relative: bool) -> list[_Value]:
    """Responsivities, or what they are above the first one in percent, with which planes can be compared."""
    known = [p.responsivity for p in history.points]
    first = next((r[0] for r in known if r), 1.0)
    scale, less = (100 / first, 100.0) if relative else (1.0, 0.0)
    return [r and (scale * r[0] - less, scale * r[0] * r[1], scale * r[0] * r[2]) for r in known]


def _exact(value: float | None) -> _Value:
    return None if value is None else (value, 0.0, 0.0)


def _with_u(value: tuple[float, float] | None) -> _Value:
    return value and (value[0], value[1], value[1])


def _draw(axes: Axes, history: CameraHistory, values: Sequence[_Value], position: float) -> None:
    # Days since 1970, as matplotlib counts them.
    days = np.array([p.measured.timestamp() / 86400 for p in history.points])
    days += position * _APART * (days[-1] - days[0])
    known = [(p, day, *v) for p, day, v in zip(history.points, days, values, strict=True) if v is not None]
    colour, mark = _STYLES[history.plane] if history.plane else (BLUE, "o")
    line, edge = (colour, colour) if history.plane else ("0.75", "black")
    axes.plot([day for _, day, *_ in known], [value for _, _, value, *_ in known], color=line, linewidth=1.0, zorder=1)
    for number, (point, day, value, without_scale, whole) in enumerate(known):
        axes.errorbar(day, value, yerr=whole, fmt="none", ecolor=colour, elinewidth=1.0, capsize=3.0, zorder=2)
        axes.errorbar(day, value, yerr=without_scale, fmt="none", ecolor=colour, elinewidth=3.0, zorder=3)
        face, name = (
            "white" if point.verdict else edge,
            f"plane {history.plane}" if history.plane and number == 0 else None,
        )
        axes.plot([day], [value], mark, markersize=6, color=edge, markerfacecolor=face, zorder=4, label=name)


def history_files(histories: Sequence[CameraHistory], result: Result) -> dict[str, bytes]:
    """Return the files of histories as `result_files` does; at least one."""
    newest = max(point.measured for history in histories for point in history.points)
    return result_files(result, _page(by_camera(histories), result), time=newest)


def _page(cameras: Sequence[Camera], result: Result) -> Page:
    changes, history, single = result.table("cameras"), result.table("history"), len(cameras) == 1
    cards = [_card(row, cell_text(changes.column("change_rel"), row), single) for row in changes.rows()]
    files = Section("Files", (history.only("measured", "by", "file").all_shown(),), collapsed=True)
    if single:
        brief = history.only("measured", "by", "plane", "responsivity", "expanded_r", "expanded_fit_rel")
        times = dict.fromkeys((changes["first"][0], changes["last"][0]))
        summary = f"{history_title(cameras[0])}: {' to '.join(times)}."
        sections = [Section("Calibrations and verifications", (history,)), files]
        return Page.of(result, "History of calibrations", summary, cards, (history_figure(cameras[0]), brief), sections)
    numbers = np.array(history["number"])
    sections = [
        Section(
            history_title(planes), (history_figure(planes, n), history.select(np.flatnonzero(numbers == n).tolist()))
        )
        for n, planes in enumerate(cameras, start=1)
    ]
    return Page.of(result, "History of calibrations", cards=cards, sections=[*sections, files])


def _card(row: Mapping[str, Any], change: str, single: bool) -> Card:
    title, lines = f"Change of R{row['plane'] and ' in plane '}{row['plane']}", () if single else (row["camera"],)
    if row["changed"] is None:
        return Card(title, "-", "one measurement so far", lines)
    verdict, state = _STATES[row["changed"]]
    return Card(title, f"{change} %", "± U (95 %), first to last measurement", lines, verdict, state)
