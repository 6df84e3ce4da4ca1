"""Command doctor: what keeps the bench from working, and the commands that mend it."""

from __future__ import annotations

import logging
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Literal

import typer

from ..errors import LabcdpError
from .terminal import JSON_OPTION, print_json

if TYPE_CHECKING:
    from ..drivers.diagnosis import Finding

#: Marks and colours of the states; the second marks are for terminals without the first.
_MARKS = {"good": ("✓", "ok", "green"), "notice": ("!", "!", "yellow"), "fault": ("✗", "XX", "red")}
_UNKNOWN = ("?", "?", "cyan")

_log = logging.getLogger(__name__)


def doctor(
    camera: str | None = typer.Option(
        None, help="Serial number, address or model; default: every camera that answers."
    ),
    meter: str | None = typer.Option(
        None, help="Serial port of the luminance meter, for example /dev/ttyUSB0; only then is a meter looked for."
    ),
    meter_model: Literal["LS-110", "LS-100"] = typer.Option("LS-110", help="Model of the meter, which it cannot tell."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Check this computer, the cameras and the meter; name what is wrong and the command that mends it.

    Nothing is changed for good. Cameras are opened and take a few frames; the meter is asked what it shows.
    The exit status is 1 if anything does not work, else 0.
    """
    groups = [("This computer", _attempt(_host)), *_cameras(camera)]
    if meter is not None:
        groups.append((f"Luminance meter on {meter}", _attempt(lambda: _meter(meter, meter_model))))
    counts: Counter[str] = Counter(finding.state for _, findings in groups for finding in findings)
    if as_json:
        rows = [{"group": name} | asdict(finding) for name, findings in groups for finding in findings]
        print_json({"findings": rows, "counts": {state: counts[state] for state in (*_MARKS, "unknown")}})
    else:
        _print(groups, counts)
    if counts["fault"]:
        raise typer.Exit(1)


def _attempt(check: Callable[[], list[Finding]]) -> list[Finding]:
    """Make a check that fails itself a finding: the others are still worth having."""
    from ..drivers.diagnosis import Finding

    try:
        return check()
    except LabcdpError as error:
        return [Finding.of_error("check", error)]
    except Exception as error:
        _log.debug("a check failed", exc_info=True)
        return [Finding("check", "unknown", f"the check itself failed ({type(error).__name__}: {error})")]


def _host() -> list[Finding]:
    from ..drivers.diagnosis.host import host_facts, host_findings

    return host_findings(host_facts())


def _meter(port: str, model: Literal["LS-110", "LS-100"]) -> list[Finding]:
    from ..drivers.diagnosis.meter import check_meter

    return check_meter(port, model)


def _cameras(selector: str | None) -> list[tuple[str, list[Finding]]]:
    """Check the camera that is asked for, or every one that answers."""
    from ..drivers.aravis_library import CameraInfo, choose, discover
    from ..drivers.camera import CameraError
    from ..drivers.diagnosis import Finding
    from ..drivers.diagnosis.camera import check_camera
    from ..drivers.diagnosis.discovery import no_camera_finding
    from ..drivers.diagnosis.kernel import firewall
    from ..drivers.diagnosis.network import interfaces

    known = interfaces()
    try:
        found = discover()
        if selector is not None and found:
            found = [choose(found, selector)]
    except CameraError as error:
        # Without Aravis the finding about this computer is the fault, and all but real cameras works.
        return [("Cameras", [Finding.of_error("discovery", error, "unknown" if selector is None else "fault")])]
    if not found:
        return [("Cameras", [no_camera_finding(known, firewall(), "notice" if selector is None else "fault")])]

    def check(info: CameraInfo) -> tuple[str, list[Finding]]:
        name = f"Camera {info.vendor} {info.model}, serial {info.serial}, at {info.address}"
        return name, _attempt(lambda: check_camera(info, known))

    return [check(info) for info in found]


def _print(groups: list[tuple[str, list[Finding]]], counts: Counter[str]) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    plain = not _can_print("".join(mark for mark, _, _ in _MARKS.values()))
    for name, findings in groups:
        console.print(Text(name, style="bold"))
        for finding in findings:
            mark, ascii_mark, colour = _MARKS.get(finding.state, _UNKNOWN)
            line = Text("  ").append(f"{ascii_mark if plain else mark:<3}", style=colour)
            console.print(line.append(f"{finding.topic}: {finding.cause}"))
            if finding.remedy is not None:
                console.print(Text(f"       {finding.remedy}"))
    # Two of the words count, two describe.
    words = {state: state if counts[state] == 1 else f"{state}s" for state in ("fault", "notice")}
    told = ", ".join(f"{counts[state]} {words.get(state, state)}" for state in ("fault", "notice", "unknown", "good"))
    console.print(Text(told, style="bold"))


def _can_print(text: str) -> bool:
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return False
    return True
