"""The history of cameras: tables, picture and page."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ...calibration.verify.history import CameraHistory, HistoryPoint
from ...core.errors import InputError
from ...core.finding import Finding, unique, warning
from ...core.result import InputFile, Result
from ...core.table import Column, Table
from ...output import write_file
from ...report.cells import cell_text
from ...report.digits import minute, printable
from ...report.figure import ReportFigure
from ...report.figures.drawing import BLUE, GREEN, LABEL_SIZE, TITLE_SIZE, VERMILLION, finish, new_figure, png
from ...report.html import render_page
from ...report.layout import Card, Page, Section
from ...report.sheets import result_workbook
from .quantities import RESPONSIVITY

if TYPE_CHECKING:
    from matplotlib.axes import Axes


#: A camera with a lens and a setting: its planes, or the one history of a monochrome sensor.
Camera: TypeAlias = tuple[CameraHistory, ...]


def by_camera(found: Sequence[CameraHistory]) -> list[Camera]:
    """Put the planes of each camera, lens and setting together."""
    groups: dict[tuple[object, ...], list[CameraHistory]] = {}
    for one in found:
        groups.setdefault((one.camera, one.lens, one.gain_db, one.pixel_format, one.plane is None), []).append(one)
    return [tuple(group) for group in groups.values()]


def history_title(planes: Camera) -> str:
    """Return camera, lens and setting on one line."""
    one = planes[0]
    lens = f"{one.lens.model}{f' ({one.lens.serial})' if one.lens.serial else ''} at f/{one.lens.f_number:g}"
    single = f", plane {one.plane}" if one.plane and len(planes) == 1 else ""
    return printable(f"{one.camera}, {lens}, {one.gain_db:g} dB, {one.pixel_format}{single}")


def history_result(found: Sequence[CameraHistory], inputs: Sequence[InputFile] = ()) -> Result:
    """Return all numbers of the histories of cameras.

    Parameters
    ----------
    found : sequence of CameraHistory
        At least one.
    inputs : sequence of InputFile
        Files of the calibrations and verifications.
    """
    cameras = by_camera(found)
    title = "History of one camera" if len(cameras) == 1 else f"History of {len(cameras)} cameras or settings"
    simulated = any(planes[0].camera.simulated for planes in cameras)
    tables = (_cameras(cameras), _history(cameras))
    return Result("history", title, tables, _findings(found), inputs=tuple(inputs), simulated=simulated)


def _cameras(cameras: Sequence[Camera]) -> Table:
    columns = (
        Column("number", "number", "", "Number of camera, lens and setting in this result.", shown=len(cameras) > 1,
               value=lambda row: row[0]),
        Column("camera", "camera", "", "Model and serial number, lens and setting.",
               value=lambda row: history_title(row[1])),
        Column("plane", "plane", "", "Colour plane.", shown=any(len(planes) > 1 for planes in cameras),
               value=lambda row: row[2].plane or ""),
        Column("n_points", "points", "", "Calibrations and verifications.", value=lambda row: len(row[2].points)),
        Column("first", "first", "", "Time of the first one.", value=lambda row: minute(row[2].points[0].measured)),
        Column("last", "last", "", "Time of the last one.", value=lambda row: minute(row[2].points[-1].measured)),
        Column("change_rel", "change of R", "%", "Of the responsivity from first to last.", expanded="expanded_rel",
               value=lambda row: row[2].change_rel and row[2].change_rel[0]),
        Column("expanded_rel", "U of change", "%", "U (95 %); the scale of one meter cancels.", shown=False,
               value=lambda row: row[2].change_rel and row[2].change_rel[1]),
        Column("changed", "changed", "", "Whether the change is more than its U.",
               value=lambda row: row[2].change_rel and _changed(*row[2].change_rel)),
    )  # fmt: skip
    rows = [(number, planes, one) for number, planes in enumerate(cameras, start=1) for one in planes]
    return Table.of_items("cameras", "Change of the responsivity", columns, rows)


def _changed(change_rel: float, expanded_rel: float) -> str:
    return "yes" if abs(change_rel) > expanded_rel else "no"


def _history(cameras: Sequence[Camera]) -> Table:
    """One row for each number of a camera, plane and point."""
    planes = any(len(one) > 1 for one in cameras)
    meters = len({str(point.meter) for camera in cameras for one in camera for point in one.points}) > 1
    columns = (
        Column("number", "number", "", "Number of camera, lens and setting in this result.", shown=len(cameras) > 1,
               value=lambda row: row[0]),
        Column("measured", "measured", "", "Time of the last reading.", value=lambda row: minute(row[2].measured)),
        Column("by", "by", "", "Calibration, or verification with its verdict.",
               value=lambda row: "calibration" if row[2].verdict is None else f"verification: {row[2].verdict}"),
        Column("plane", "plane", "", "Colour plane.", shown=planes, value=lambda row: row[1].plane or ""),
        Column("weight", "weight", "", "Of the plane in the luminance.", decimals=3, shown=planes,
               value=lambda row: row[2].weight),
        Column("responsivity", "responsivity", RESPONSIVITY, "U includes the scale of the meter.",
               expanded="expanded_r", value=lambda row: row[2].responsivity and row[2].responsivity[0]),
        Column("expanded_r", "U of responsivity", RESPONSIVITY, "U (95 %), the scale of the meter included.",
               shown=False, value=lambda row: (r := row[2].responsivity) and r[0] * r[2]),
        Column("expanded_fit_rel", "U without meter scale", "%", "Relative U (95 %), the meter's scale excluded.", 2,
               value=lambda row: row[2].responsivity and row[2].responsivity[1]),
        Column("dark_offset_dn", "dark offset", "DN", "At exposure time 0.", expanded="expanded_dark_offset_dn",
               value=lambda row: row[2].dark_offset_dn[0]),
        Column("expanded_dark_offset_dn", "U of dark offset", "DN", "U (95 %).", shown=False,
               value=lambda row: row[2].dark_offset_dn[1]),
        Column("dark_rate_dn_s", "dark rate", "DN/s", "Growth with exposure time.", expanded="expanded_dark_rate_dn_s",
               value=lambda row: row[2].dark_rate_dn_s and row[2].dark_rate_dn_s[0]),
        Column("expanded_dark_rate_dn_s", "U of dark rate", "DN/s", "U (95 %).", shown=False,
               value=lambda row: row[2].dark_rate_dn_s and row[2].dark_rate_dn_s[1]),
        Column("k_dn_per_e", "K", "DN/e⁻", "Overall system gain.", digits=3, value=lambda row: row[2].k_dn_per_e),
        Column("meter", "meter", "", "Model and serial number of the meter.", shown=meters,
               value=lambda row: str(row[2].meter)),
        Column("file", "file", "", "Source file.", shown=False, value=lambda row: row[2].source),
    )  # fmt: skip
    rows = [(number, *point) for number, camera in enumerate(cameras, start=1) for point in _by_time(camera)]
    note = "± is U (95 %), the scale error of the meter included."
    return Table.of_items("history", "Calibrations and verifications", columns, rows, note)


def _findings(found: Sequence[CameraHistory]) -> tuple[Finding, ...]:
    """Name meters that were calibrated again: a change between such points may be theirs."""
    pairs = [(a.meter, b.meter) for one in found for a, b in pairwise(one.points) if not b.meter.is_as_in(a.meter)]
    return unique(
        warning("meter-recalibrated", f"{b.meter.model} {b.meter.serial}", now=b.state, then=a.state)
        for a, b in pairs
        if (a.meter.model, a.meter.serial) == (b.meter.model, b.meter.serial)
    )


def _by_time(planes: Camera) -> list[tuple[CameraHistory, HistoryPoint]]:
    """Points of all planes, those of one measurement together."""
    points = [(one, point) for one in planes for point in one.points]
    return sorted(points, key=lambda pair: (pair[1].measured, pair[1].source))


#: A value with its half widths of 95 %, without and with what points share; None where it is not known.
_Value = tuple[float, float, float] | None
#: Colour of a plane, and shape of its marks.
_STYLES = {"R": (VERMILLION, "^"), "Gr": (GREEN, "o"), "Gb": (GREEN, "s"), "B": (BLUE, "v")}
#: Planes measured at one time stand side by side, so far apart, as a share of the time that is shown.
_APART = 0.012


def history_figure(planes: Camera) -> bytes:
    """Draw responsivity, weights, dark offset, dark rate and K over time, as PNG; planes in their colours."""
    first = planes[0]
    responsivity = "responsivity in\nDN s⁻¹ / (cd m⁻²)" if len(planes) == 1 else "change of the\nresponsivity in %"
    panels: list[tuple[str, list[list[_Value]]]] = [
        (responsivity, [_responsivities(one, relative=len(planes) > 1) for one in planes]),
        ("weight in the\nluminance", [[_plain(p.weight) for p in one.points] for one in planes]),
        ("dark offset in DN", [[_with_u(p.dark_offset_dn) for p in one.points] for one in planes]),
        ("dark rate in DN/s", [[_with_u(p.dark_rate_dn_s) for p in one.points] for one in planes]),
        ("K in DN/e⁻", [[_plain(p.k_dn_per_e) for p in one.points] for one in planes]),
    ]
    shown = [(label, values) for label, values in panels if any(v is not None for of_plane in values for v in of_plane)]
    figure = new_figure(8.0, 0.9 + 1.9 * len(shown), "camera" if first.camera.simulated else "")
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (label, values) in zip(axes, shown, strict=True):
        for number, (one, of_plane) in enumerate(zip(planes, values, strict=True)):
            _draw(panel, one, of_plane, number - (len(planes) - 1) / 2)
        _finish_panel(panel, label)
    lens = f"{first.lens.model} at f/{first.lens.f_number:g}, {first.gain_db:g} dB"
    axes[0].set_title(f"{printable(str(first.camera))}\n{printable(lens)}", fontsize=TITLE_SIZE, parse_math=False)
    axes[-1].set_xlabel("time of measurement (UTC)", fontsize=LABEL_SIZE)
    _time_axis(axes[-1])
    return png(figure)


def _responsivities(one: CameraHistory, relative: bool) -> list[_Value]:
    """Responsivities, or what they are above the first one in percent, with which planes can be compared."""
    known = [p.responsivity for p in one.points]
    first = next((r[0] for r in known if r), 1.0)
    scale, less = (100 / first, 100.0) if relative else (1.0, 0.0)
    return [r and (scale * r[0] - less, scale * r[0] * r[1], scale * r[0] * r[2]) for r in known]


def _plain(value: float | None) -> _Value:
    return None if value is None else (value, 0.0, 0.0)


def _with_u(value: tuple[float, float] | None) -> _Value:
    return value and (value[0], value[1], value[1])


def _draw(axes: Axes, one: CameraHistory, values: Sequence[_Value], place: float) -> None:
    known = [(p, v) for p, v in zip(one.points, values, strict=True) if v is not None]
    if not known:
        return
    # Days since 1970, as matplotlib counts them.
    days = [p.measured.timestamp() / 86400 for p in one.points]
    aside = place * _APART * (days[-1] - days[0])
    times = [p.measured.timestamp() / 86400 + aside for p, _ in known]
    colour, mark = _STYLES[one.plane] if one.plane else (BLUE, "o")
    line = "0.75" if one.plane is None else colour
    label = None if one.plane is None else f"plane {one.plane}"
    axes.plot(times, [v[0] for _, v in known], color=line, linewidth=1.0, zorder=1)
    for number, ((point, (value, own, whole)), time) in enumerate(zip(known, times, strict=True)):
        edge = "black" if one.plane is None else colour
        filled = edge if point.verdict is None else "white"
        axes.errorbar(time, value, yerr=whole, fmt="none", ecolor=colour, elinewidth=1.0, capsize=3.0, zorder=2)
        axes.errorbar(time, value, yerr=own, fmt="none", ecolor=colour, elinewidth=3.0, zorder=3)
        named = label if number == 0 else None
        axes.plot([time], [value], mark, markersize=6, color=edge, markerfacecolor=filled, zorder=4, label=named)


def _finish_panel(axes: Axes, label: str) -> None:
    finish(axes, "", label, "", loc="upper left", bbox_to_anchor=(1.01, 1.0))
    axes.margins(x=0.06, y=0.15)
    axes.ticklabel_format(axis="y", useOffset=False)


def _time_axis(axes: Axes) -> None:
    from matplotlib import dates

    # matplotlib's dates have no types.
    make: Any = dates
    locator = make.AutoDateLocator(minticks=3, maxticks=8)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(make.ConciseDateFormatter(locator))


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
    figures = [_history_figure(planes, number) for number, planes in enumerate(cameras, start=1)]
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


def _history_figure(planes: Camera, number: int) -> ReportFigure:
    return ReportFigure(
        f"history-{number}.png",
        history_figure(planes),
        "Filled: calibrations, open: verifications. The thick bar is ± U (95 %) without the scale of the meter, which "
        "measurements with one meter share; the thin bar includes it.",
        f"Responsivity and dark signal of {printable(str(planes[0].camera))}, {len(planes[0].points)} times.",
    )
