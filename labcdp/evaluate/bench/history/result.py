"""The history of cameras as labelled tables."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

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
