"""Check of the permission to open a serial port."""

from __future__ import annotations

import grp
import os
import pwd
import stat
from dataclasses import dataclass

from ..host.finding import Finding, State

#: Debian's group with access to serial ports.
_GROUP = "dialout"


@dataclass(frozen=True)
class SerialPortFacts:
    """A serial port as the operating system shows it.

    Parameters
    ----------
    device : str
        Device name.
    exists, is_terminal_device : bool
        Whether there is such a file, and whether it is a character device.
    may_open : bool
        Whether this process may read and write it.
    mode : str
        Permissions in the format of ``ls -l``.
    owner, group : str
        Owner.
    user : str
        User of this process.
    in_group : bool
        Whether the user is listed in the group, even if not yet in this login session.
    """

    device: str
    exists: bool = True
    is_terminal_device: bool = True
    may_open: bool = True
    mode: str = ""
    owner: str = ""
    group: str = ""
    user: str = ""
    in_group: bool = False


def serial_port_facts(device: str) -> SerialPortFacts:
    """Inspect a serial port without opening it."""
    try:
        found = os.stat(device)
    except (OSError, ValueError):
        return SerialPortFacts(device, exists=False, is_terminal_device=False, may_open=False)
    user, group = _user(os.getuid()), _group(found.st_gid)
    return SerialPortFacts(
        device=device,
        is_terminal_device=stat.S_ISCHR(found.st_mode),
        may_open=os.access(device, os.R_OK | os.W_OK),
        mode=stat.filemode(found.st_mode),
        owner=_user(found.st_uid),
        group=group,
        user=user,
        in_group=_is_member(user, found.st_gid),
    )


def serial_port_finding(facts: SerialPortFacts, needed: bool) -> Finding:
    """Report whether a port can be opened, with a remedy otherwise; a fault only if `needed`."""
    topic = f"serial port {facts.device}"
    bad: State = "fault" if needed else "notice"
    other = "choose one of the ports that labcdp devices lists"
    if not facts.exists:
        return Finding(topic, bad, f"there is no {facts.device}", f"plug the adapter in, or {other}")
    if not facts.is_terminal_device:
        return Finding(topic, bad, f"{facts.device} is not a serial port", other)
    whose = f"{facts.mode}, owner {facts.owner}, group {facts.group}"
    if facts.may_open:
        return Finding(topic, "good", f"{facts.user} may open it ({whose})")
    cause = f"{facts.user} may not open it ({whose})"
    if facts.mode[4:6] != "rw" or facts.group == "root":
        give = f"sudo chgrp {_GROUP} {facts.device}; sudo chmod g+rw {facts.device}"
        return Finding(topic, bad, cause, f"{give}; sudo adduser {facts.user} {_GROUP}, then log out and in again")
    if facts.in_group:
        return Finding(topic, bad, f"{cause}, though of its group", "log out and in again")
    return Finding(topic, bad, cause, f"sudo adduser {facts.user} {facts.group}, then log out and in again")


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
