"""Checks of a luminance meter: permission to open its serial port, answer and unit."""

from __future__ import annotations

import grp
import os
import pwd
import stat

from ...core.reading import SerialMeterModel
from ..check import Check, State
from ..meter import MeterError, MeterNotFoundError, MeterReportedError, MeterTimeoutError, require_mode
from ..minolta.ls import MinoltaLS
from ..minolta.models import DRIVERS

#: Debian's group with access to serial ports.
_GROUP = "dialout"


def serial_port_check(device: str, needed: bool) -> Check:
    """Report whether a port can be opened, with a remedy otherwise; a fault only if `needed`; does not open it."""
    topic = f"serial port {device}"
    bad: State = "fault" if needed else "notice"
    other = "choose one of the ports that labcdp devices lists"
    try:
        status = os.stat(device)
    except (OSError, ValueError):
        return Check(topic, bad, f"there is no {device}", f"plug the adapter in, or {other}")
    if not stat.S_ISCHR(status.st_mode):
        return Check(topic, bad, f"{device} is not a serial port", other)
    user, group, mode = _user(os.getuid()), _group(status.st_gid), stat.filemode(status.st_mode)
    whose = f"{mode}, owner {_user(status.st_uid)}, group {group}"
    if os.access(device, os.R_OK | os.W_OK):
        return Check(topic, "good", f"{user} may open it ({whose})")
    cause, again = f"{user} may not open it ({whose})", "log out and in again"
    if mode[4:6] != "rw" or group == "root":
        give = f"sudo chgrp {_GROUP} {device}; sudo chmod g+rw {device}"
        return Check(topic, bad, cause, f"{give}; sudo adduser {user} {_GROUP}, then {again}")
    if _is_member(user, status.st_gid):
        # Not yet in this login session.
        return Check(topic, bad, f"{cause}, though of its group", again)
    return Check(topic, bad, cause, f"sudo adduser {user} {group}, then {again}")


def _user(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def _is_member(user: str, group: int) -> bool:
    try:
        return user in grp.getgrgid(group).gr_mem or pwd.getpwnam(user).pw_gid == group
    except KeyError:
        return False


#: Memory value error: answer of a meter queried for a reading before the first measurement.
_NOTHING_HELD = "ER11"


def check_meter(port: str, model: SerialMeterModel = "LS-110", timeout_s: float = 6.0) -> list[Check]:
    """Open a meter, set it up, read the display of an LS-100 or LS-110, and close it again, without a measurement.

    Parameters
    ----------
    port : str
        Serial port, for example ``/dev/ttyUSB0``, or ``socket://HOST:PORT``.
    model : str
        Its model, which it cannot report.
    timeout_s : float
        Longest wait for an answer, in seconds; the meter itself gives up after 5 s.

    Returns
    -------
    list of Check
        Errors of the meter are returned as findings.
    """
    checks = [] if "://" in port else [serial_port_check(port, needed=True)]
    if checks and checks[0].state == "fault":
        return checks
    try:
        with DRIVERS[model].configured(port, timeout_s=timeout_s) as meter:
            if isinstance(meter, MinoltaLS):
                checks.append(Check("meter", "good", f"it answers, and took PRESET, ABS, FAST and CONT (as {model})"))
                checks.append(_unit(meter))
            else:
                checks.append(Check("meter", "good", f"it answers, and took its settings (as {model})"))
    except MeterNotFoundError as error:
        checks.append(Check.failed("port", error))
    except MeterTimeoutError as error:
        checks.append(Check("meter", "fault", error.cause, error.remedy))
    except MeterError as error:
        checks.append(Check.failed("meter", error))
    return checks


def _unit(meter: MinoltaLS) -> Check:
    try:
        shown = meter.read_held()
    except MeterReportedError as error:
        if error.code == _NOTHING_HELD:
            remedy = "measure once with its button, then run this again"
            return Check("unit", "unknown", "the meter has no reading yet, so its unit is unknown", remedy)
        # A value out of range is not a fault of the meter; an empty battery is.
        return Check.failed("unit", error, "fault" if error.code in ("ER20", "ER30") else "notice")
    if shown.unit != "%":
        try:
            require_mode(shown)
        except MeterError as error:
            return Check.failed("mode", error, "notice")
    if shown.unit == "cd/m2":
        return Check("unit", "good", f"cd/m²; it shows {shown.value:g}")
    if shown.unit == "fL":
        cause = f"the meter is set to fL; it shows {shown.value:g} fL, which is {shown.luminance_cd_m2:g} cd/m²"
        return Check("unit", "notice", cause, "set its unit switch to cd/m² unless fL is intended")
    return Check("unit", "notice", "the meter shows a ratio in %", "measure once to return to cd/m²")
