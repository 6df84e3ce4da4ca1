"""Check of a luminance meter: answer and unit."""

from __future__ import annotations

from typing import Literal

from ..host.finding import Finding
from ..meter import MeterError, MeterNotFoundError, MeterReportedError, MeterTimeoutError
from ..minolta_ls.meter import DRIVERS, MinoltaLS
from .serial_port import serial_port_facts, serial_port_finding

MeterModel = Literal["LS-100", "LS-110"]

#: Memory value error: answer of a meter queried for a reading before the first measurement.
_NOTHING_HELD = "ER11"

_REMOTE_MODE = "switch the meter off, hold F while switching it on so that it shows C, and check the cable LS-A12"


def check_meter(port: str, model: MeterModel = "LS-110", timeout_s: float = 6.0) -> list[Finding]:
    """Open a meter, set its modes, read its display, and close it again, without a measurement.

    Parameters
    ----------
    port : str
        Serial port, for example ``/dev/ttyUSB0``.
    model : {'LS-110', 'LS-100'}
        Its model, which it cannot report.
    timeout_s : float
        Longest wait for an answer, in seconds; the meter itself gives up after 5 s.

    Returns
    -------
    list of Finding
        Errors of the meter are returned as findings.
    """
    permission = serial_port_finding(serial_port_facts(port), needed=True)
    if permission.state == "fault":
        return [permission]
    found = [permission]
    try:
        with DRIVERS[model](port, timeout_s=timeout_s) as meter:
            found.append(Finding("meter", "good", f"it answers, and took PRESET, ABS, FAST and CONT (as {model})"))
            found.append(_unit(meter))
    except MeterNotFoundError as error:
        found.append(Finding.of_error("port", error))
    except MeterTimeoutError as error:
        cause = Finding.of_error("meter", error).cause
        found.append(Finding("meter", "fault", cause, _REMOTE_MODE))
    except MeterError as error:
        found.append(Finding.of_error("meter", error))
    return found


def _unit(meter: MinoltaLS) -> Finding:
    try:
        shown = meter.read_held()
    except MeterReportedError as error:
        if error.code == _NOTHING_HELD:
            remedy = "measure once with its button, then run this again"
            return Finding("unit", "unknown", "the meter holds no reading, which would tell its unit", remedy)
        # A value out of range is not a fault of the meter; an empty battery is.
        return Finding.of_error("unit", error, "fault" if error.code in ("ER20", "ER30") else "notice")
    if shown.unit == "cd/m2":
        return Finding("unit", "good", f"cd/m^2; it shows {shown.value:g}")
    if shown.unit == "fL":
        cause = f"the meter is set to fL; it shows {shown.value:g} fL, which is {shown.luminance_cd_m2:g} cd/m^2"
        return Finding("unit", "notice", cause, "set its unit switch to cd/m^2 if fL is not meant")
    return Finding("unit", "notice", "the meter shows a ratio in %", "measure once, which shows cd/m^2 again")
