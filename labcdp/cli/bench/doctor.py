"""Command doctor: find faults of the bench and the commands that fix them."""

from __future__ import annotations

import logging
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import typer
from rich.console import Console
from rich.text import Text

from ...core.errors import DeviceError, LabcdpError
from ...core.reading import SerialMeterModel
from ...core.result import Result
from ...core.table import Column, Table
from ...drivers.aravis.connection import find_camera
from ...drivers.aravis.library import CameraInfo, discover
from ...drivers.camera import CameraError
from ...drivers.check import Check
from ...drivers.computer import firewall
from ...drivers.doctor.camera import check_camera
from ...drivers.doctor.computer import host_checks, no_camera_check
from ...drivers.doctor.link import PlannedStream, planned_stream
from ...drivers.doctor.meter import check_meter
from ...drivers.doctor.report import camera_files, meter_files
from ...drivers.network import interfaces
from ...output import write_file
from ...report.files import envelope_json
from ...session import SessionConfiguration
from ..commands import as_json
from ..options import Force, MeterModel, output_file, require_apart
from ..terminal import print_result, say

#: Marks and colours of the states; the second marks are for terminals without the first.
_MARKS = {"good": ("✓", "ok", "green"), "notice": ("!", "!", "yellow"), "fault": ("✗", "XX", "red")}
_UNKNOWN = ("?", "?", "cyan")

_log = logging.getLogger(__name__)


def doctor(
    *,
    camera: str | None = None,
    meter: str | None = None,
    meter_model: MeterModel = "LS-110",
    stream_test: str | None = None,
    plan: Path | None = None,
    report: Path | None = None,
    force: Force = False,
) -> None:
    """Check this computer, the cameras and the meter; list faults and the commands that fix them.

    Cameras are only read, except that of --stream-test. The meter's modes are set, as it cannot report them.
    The exit status is 1 if there is a fault, else 0.

    Parameters
    ----------
    camera
        Serial number, address or model; default: all cameras found.
    meter
        Serial port of the luminance meter, for example /dev/ttyUSB0; default: no meter is checked.
    stream_test : SERIAL
        Also take some frames with this camera; its settings are restored afterwards.
    plan
        TOML file with bench and plan: also check that the link carries its pixel format at its frame rate.
    report
        .zip file for a problem report: findings, GenICam description and features, bytes of the meter.
    """
    require_apart({"--camera": camera}, {"--stream-test": stream_test})
    if report is not None:
        output_file(report, force, option="--report")
    stream = None if plan is None else planned_stream(SessionConfiguration.load(plan))
    computer = _attempt(host_checks)
    groups = [("This computer", computer), *_cameras(stream_test or camera, stream_test is not None, stream)]
    if meter is not None:
        groups.append((f"Luminance meter on {meter}", _attempt(lambda: check_meter(meter, meter_model))))
    counts: Counter[str] = Counter(finding.state for _, findings in groups for finding in findings)
    result = _result(groups, counts)
    if as_json():
        print_result(result)
    else:
        _print(groups, counts)
    if report is not None:
        write_file(report, _report(result, stream_test or camera, meter, meter_model), force=force)
        say(f"Written: {report}")
    if counts["fault"]:
        raise typer.Exit(1)


def _result(groups: list[tuple[str, list[Check]]], counts: Counter[str]) -> Result:
    columns = (
        Column("group", "group", "", "Computer, camera or meter."),
        Column("topic", "topic", "", "What was checked."),
        Column("state", "state", "", "good, notice, fault or unknown."),
        Column("cause", "cause", "", "What was found."),
        Column("remedy", "remedy", "", "Command or action that fixes it."),
    )
    rows = [{"group": name, **asdict(finding)} for name, findings in groups for finding in findings]
    states = [*_MARKS, "unknown"]
    data: dict[str, list[Any]] = {"state": states, "count": [counts[state] for state in states]}
    count = Table("counts", "Counts", (Column("state", "state"), Column("count", "count")), data)
    return Result("doctor", "Bench", (Table.of_items("checks", "Checks", columns, rows), count))


def _report(result: Result, selector: str | None, meter: str | None, model: SerialMeterModel) -> bytes:
    """Make the archive of a problem report; what cannot be read is left out, as the findings say why."""
    files = {"doctor.json": envelope_json(result).encode()}
    with suppress(CameraError):
        for info in discover() if selector is None else [find_camera(selector)]:
            with suppress(CameraError):
                files |= camera_files(info)
    if meter is not None:
        files |= meter_files(meter, model)
    buffer = BytesIO()
    with ZipFile(buffer, "w", ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def _attempt(checks: Callable[[], list[Check]]) -> list[Check]:
    """Turn the failure of checks into one of its own, so that the others still run."""
    try:
        return checks()
    except DeviceError as error:
        return [Check.failed("check", error)]
    except LabcdpError as error:
        return [Check("check", "fault", str(error))]
    except Exception as error:
        _log.debug("a check failed", exc_info=True)
        return [Check("check", "unknown", f"the check itself failed ({type(error).__name__}: {error})")]


def _cameras(selector: str | None, stream: bool, planned: PlannedStream | None) -> list[tuple[str, list[Check]]]:
    """Check the selected camera, or all cameras found."""
    known = interfaces()
    try:
        devices = discover() if selector is None else [find_camera(selector)]
    except CameraError as error:
        # A missing Aravis is reported as a fault of this computer; only real cameras need it.
        return [("Cameras", [Check.failed("discovery", error, "unknown" if selector is None else "fault")])]
    if not devices:
        return [("Cameras", [no_camera_check(known, firewall(), "notice" if selector is None else "fault")])]

    def check(info: CameraInfo) -> tuple[str, list[Check]]:
        name = f"Camera {info.vendor} {info.model}, serial {info.serial}, at {info.address}"
        return name, _attempt(lambda: check_camera(info, known, stream=stream, planned=planned))

    return [check(info) for info in devices]


def _print(groups: list[tuple[str, list[Check]]], counts: Counter[str]) -> None:
    console = Console(highlight=False, soft_wrap=True)
    marks = "".join(mark for mark, _, _ in _MARKS.values())
    encoding = sys.stdout.encoding or "ascii"
    plain = marks.encode(encoding, "replace").decode(encoding) != marks
    for name, findings in groups:
        console.print(Text(name, style="bold"))
        for finding in findings:
            mark, ascii_mark, colour = _MARKS.get(finding.state, _UNKNOWN)
            line = Text("  ").append(f"{ascii_mark if plain else mark:<3}", style=colour)
            console.print(line.append(f"{finding.topic}: {finding.cause}"))
            if finding.remedy is not None:
                console.print(Text(f"       {finding.remedy}"))
    # "unknown" and "good" have no plural.
    words = {state: state if counts[state] == 1 else f"{state}s" for state in ("fault", "notice")}
    total = ", ".join(f"{counts[state]} {words.get(state, state)}" for state in ("fault", "notice", "unknown", "good"))
    console.print(Text(total, style="bold"))
