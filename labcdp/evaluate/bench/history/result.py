"""The history of cameras as labelled tables."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeAlias

from ....calibration.verify.history import CameraHistory, HistoryPoint
from ....core.finding import Finding, unique, warning
from ....core.result import InputFile, Result
from ....core.table import Column, Table
from ....report.digits import minute, printable
from ..calibration.quantities import RESPONSIVITY

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
        Column("number", "number", "", "Number of camera, lens and setting in this result.", shown=len(cameras) > 1),
        Column("camera", "camera", "", "Model and serial number, lens and setting."),
        Column("plane", "plane", "", "Colour plane.", shown=any(len(planes) > 1 for planes in cameras)),
        Column("n_points", "points", "", "Calibrations and verifications."),
        Column("first", "first", "", "Time of the first one."),
        Column("last", "last", "", "Time of the last one."),
        Column("change_rel", "change of R", "%", "Of the responsivity from first to last.", expanded="expanded_rel"),
        Column("expanded_rel", "U of change", "%", "U (95 %); the scale of one meter cancels.", shown=False),
        Column("changed", "changed", "", "Whether the change is more than its U."),
    )
    rows = []
    for number, planes in enumerate(cameras, start=1):
        for one in planes:
            change, expanded = one.change_rel or (None, None)
            verdict = None if change is None or expanded is None else "yes" if abs(change) > expanded else "no"
            rows.append(
                {
                    "number": number,
                    "camera": history_title(planes),
                    "plane": one.plane or "",
                    "n_points": len(one.points),
                    "first": minute(one.points[0].measured),
                    "last": minute(one.points[-1].measured),
                    "change_rel": change,
                    "expanded_rel": expanded,
                    "changed": verdict,
                }
            )
    return Table.of_rows("cameras", "Change of the responsivity", columns, rows)


def _history(cameras: Sequence[Camera]) -> Table:
    planes = any(len(one) > 1 for one in cameras)
    meters = len({str(point.meter) for camera in cameras for one in camera for point in one.points}) > 1
    columns = (
        Column("number", "number", "", "Number of camera, lens and setting in this result.", shown=len(cameras) > 1),
        Column("measured", "measured", "", "Time of the last reading."),
        Column("by", "by", "", "Calibration, or verification with its verdict."),
        Column("plane", "plane", "", "Colour plane.", shown=planes),
        Column("weight", "weight", "", "Of the plane in the luminance.", decimals=3, shown=planes),
        Column(
            "responsivity", "responsivity", RESPONSIVITY, "U includes the scale of the meter.", expanded="expanded_r"
        ),
        Column(
            "expanded_r", "U of responsivity", RESPONSIVITY, "U (95 %), the scale of the meter included.", shown=False
        ),
        Column("expanded_fit_rel", "U without meter scale", "%", "Relative U (95 %), the meter's scale excluded.", 2),
        Column("dark_offset_dn", "dark offset", "DN", "At exposure time 0.", expanded="expanded_dark_offset_dn"),
        Column("expanded_dark_offset_dn", "U of dark offset", "DN", "U (95 %).", shown=False),
        Column("dark_rate_dn_s", "dark rate", "DN/s", "Growth with exposure time.", expanded="expanded_dark_rate_dn_s"),
        Column("expanded_dark_rate_dn_s", "U of dark rate", "DN/s", "U (95 %).", shown=False),
        Column("k_dn_per_e", "K", "DN/e⁻", "Overall system gain.", digits=3),
        Column("meter", "meter", "", "Model and serial number of the meter.", shown=meters),
        Column("file", "file", "", "Source file.", shown=False),
    )
    rows = [
        _point(number, one, point) for number, planes in enumerate(cameras, start=1) for one, point in _by_time(planes)
    ]
    note = "± is U (95 %), the scale error of the meter included."
    return Table.of_rows("history", "Calibrations and verifications", columns, rows, note)


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


def _point(number: int, one: CameraHistory, point: HistoryPoint) -> dict[str, Any]:
    r, own_rel, whole_rel = point.responsivity or (None, None, None)
    offset, rate = point.dark_offset_dn, point.dark_rate_dn_s or (None, None)
    return {
        "number": number,
        "measured": minute(point.measured),
        "by": "calibration" if point.verdict is None else f"verification: {point.verdict}",
        "plane": one.plane or "",
        "weight": point.weight,
        "responsivity": r,
        "expanded_r": None if r is None or whole_rel is None else r * whole_rel,
        "expanded_fit_rel": own_rel,
        "dark_offset_dn": offset[0],
        "expanded_dark_offset_dn": offset[1],
        "dark_rate_dn_s": rate[0],
        "expanded_dark_rate_dn_s": rate[1],
        "k_dn_per_e": point.k_dn_per_e,
        "meter": str(point.meter),
        "file": point.source,
    }
