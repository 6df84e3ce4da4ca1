"""Check of the installation of Aravis."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

from ..host.finding import Finding

#: Debian's packages that a GigE Vision camera needs.
NEEDED = ("gir1.2-aravis-0.8", "libaravis-0.8-0", "python3-gi")

_DPKG = "dpkg-query"
_LONGEST_S = 10


@dataclass(frozen=True)
class AravisFacts:
    """State of Aravis on this computer.

    Parameters
    ----------
    problem : str
        Why it cannot be loaded, with the remedy; empty if it can.
    pygobject : str
        Version of PyGObject; empty if it cannot be loaded.
    packages : dict or None
        Version of each of `NEEDED` that is installed; None if this is not a Debian system.
    """

    problem: str = ""
    pygobject: str = ""
    packages: dict[str, str] | None = None


def aravis_facts(root: Path = Path("/")) -> AravisFacts:
    """Load Aravis and query Debian's package database below `root`."""
    from ..aravis.library import aravis
    from ..camera import CameraError

    packages = debian_packages(root / "var/lib/dpkg")
    try:
        aravis()
    except CameraError as error:
        return AravisFacts(problem=str(error), packages=packages)
    import gi

    return AravisFacts(pygobject=gi.__version__, packages=packages)


def debian_packages(database: Path) -> dict[str, str] | None:
    """Return the versions of the needed packages that are installed, None if there is no package database."""
    command = [_DPKG, f"--admindir={database}", "--show", "--showformat=${Package} ${Version} ${db:Status-Status}\n"]
    if not (database / "status").exists():
        return None
    try:
        # It fails if one of the packages is unknown, but still lists the others.
        done = subprocess.run(  # noqa: S603
            [*command, *NEEDED], capture_output=True, text=True, timeout=_LONGEST_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    rows = [line.split() for line in done.stdout.splitlines()]
    return {row[0]: row[1] for row in rows if len(row) == 3 and row[2] == "installed"}


def aravis_finding(facts: AravisFacts) -> Finding:
    """Report whether GigE Vision cameras can be used, and otherwise what to install."""
    packages = facts.packages or {}
    versions = ", ".join(f"{name} {version}" for name, version in packages.items())
    if not facts.problem:
        known = f" ({versions})" if versions else ""
        return Finding("Aravis", "good", f"Aravis 0.8 is there, through PyGObject {facts.pygobject}{known}")
    missing = [name for name in NEEDED if name not in packages]
    if facts.packages is not None and missing:
        return Finding(
            "Aravis",
            "fault",
            f"no camera can be used: {' and '.join(missing)} not installed",
            f"sudo apt-get install {' '.join(missing)}",
        )
    return Finding.of_error("Aravis", RuntimeError(facts.problem))
