"""Command verify: whether a calibration still holds."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import typer

from ..errors import InputError
from .acquire import record
from .devices_of_session import DeviceChoice
from .terminal import JSON_OPTION, print_json, print_table, progress_bars, say

if TYPE_CHECKING:
    from ..calibration import AnyCalibration
    from ..calibration.verification import Verification

#: Exit status for a calibration that no longer holds.
NOT_VALID = 3


def verify(
    calibration: Path = typer.Argument(help="Calibration file, as labcdp calibrate saved it."),
    paths: list[Path] = typer.Argument(
        metavar="[CONFIGURATION] SESSION",
        help="TOML file of the bench and a new folder, to measure now; or the folder of a recorded session, as of one "
        "by labcdp import.",
    ),
    patch: list[str] = typer.Option(
        [],
        "--patch",
        help="Patch to measure again; may be given several times. Default: darkest, middle, brightest (grey ones, with "
        "colour filters); of a recorded session all.",
    ),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for verification.json.", show_default="SESSION-results"
    ),
    camera: str | None = typer.Option(None, help="Serial number, address or model; default: as configured."),
    meter: str | None = typer.Option(None, help="Serial port, for example /dev/ttyUSB0; default: as configured."),
    simulated: bool = typer.Option(False, "--simulated", help="Use the simulated bench instead of devices."),
    simulated_time: bool = typer.Option(False, "--simulated-time", help="With --simulated: let no time pass."),
    faults: Path | None = typer.Option(None, help="With --simulated: file that says which faults happen when."),
    patience: float = typer.Option(600.0, help="Seconds to wait for a camera or meter that is lost.", min=0),
    transcript: Path | None = typer.Option(None, help="New file for every byte between computer and meter."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Measure two or three patches again and tell whether a calibration still holds.

    Exit status: 0 if it is valid (or doubtful, which is said), 3 if it is no longer valid, 1 for an error.

    The result is kept in verification.json, for labcdp history.
    """
    from ..calibration import load_any
    from ..calibration.verification_file import save_verification
    from ..report import place_for_results

    choice = DeviceChoice(camera, meter, simulated, simulated_time, faults, None, None, patience, transcript)
    configuration, session = _paths(paths)
    loaded = load_any(calibration)
    if configuration is not None:
        _acquire(configuration, session, loaded, patch, choice)
        patch = []
    elif not choice.real or camera is not None or meter is not None or transcript is not None:
        raise InputError("a recorded session needs no devices: give a configuration too, or leave their options out")
    folder = session.resolve()
    folder = output or folder.with_name(f"{folder.name}-results")
    path = folder / "verification.json"
    with place_for_results(folder):
        result = _verified(session, loaded, patch)
        save_verification(result, path)
    if as_json:
        print_json({"verification": str(path), **_values(result)})
    else:
        _show(result)
        say(f"Saved: {path}")
        if result.verdict == "not valid":
            say(f"Next: labcdp acquire and labcdp calibrate, then labcdp history {quote(str(path.parent))}")
    if result.verdict == "not valid":
        raise typer.Exit(NOT_VALID)


def _paths(paths: list[Path]) -> tuple[Path | None, Path]:
    """Tell a configuration and a session apart."""
    if len(paths) > 2:
        raise InputError(
            f"{len(paths)} paths after the calibration are too many: give CONFIGURATION and SESSION to measure, or "
            "SESSION alone"
        )
    if len(paths) == 2:
        return paths[0], paths[1]
    (session,) = paths
    if session.is_file():
        raise InputError(f"{session} is a file: give the folder of a session, or after this file a new folder for one")
    return None, session


def _acquire(
    configuration: Path, session: Path, calibration: AnyCalibration, patch: list[str], choice: DeviceChoice
) -> None:
    from ..acquire.verify_plan import verification_configuration
    from ..calibration import Calibration
    from ..evaluate.session import mismatch
    from ..session import SessionConfiguration

    bench = SessionConfiguration.load(configuration)
    choice.check(bench.meter)
    if choice.simulated and not isinstance(calibration, Calibration):
        raise InputError(
            "the camera of the simulated bench has no colour filters, the calibration's has: measure with that camera, "
            "or import its pictures and give the folder of that session alone"
        )
    # Refused before anything is measured; a warning is among the findings.
    mismatch(bench, calibration)
    wanted = verification_configuration(bench, calibration, patch)
    say(f"Measuring {', '.join(p.name for p in wanted.target.patches)} again")
    record(session, configuration, wanted, choice)


def _verified(path: Path, calibration: AnyCalibration, patches: list[str]) -> Verification:
    from ..evaluate.verify import verify_session
    from ..session import Session

    session = Session.open(path)
    with progress_bars() as bars:
        return verify_session(session, calibration, patches, lambda done, total: bars.update("reading", done, total))


def _values(result: Verification) -> dict[str, Any]:
    return {
        "verdict": result.verdict,
        "findings": list(result.findings),
        "measured": result.measured.isoformat(),
        "calibration_measured": result.calibration_measured.isoformat(),
        "same_meter": result.same_meter,
        "drift_rel": result.drift_rel,
        "drift_half_width_95_rel": result.drift_half_width_95_rel,
        "chi_squared": result.chi_squared,
        "degrees_of_freedom": len(result.patches),
        "chance": result.chance,
        "patches": [asdict(row) | {"z": row.z} for row in result.patches],
        "darks": [asdict(row) | {"z": row.z} for row in result.darks],
        "planes": [
            {"plane": plane.plane, "drift": None if plane.drift is None else asdict(plane.drift)}
            for plane in result.planes
        ],
        "balance": None if result.balance is None else asdict(result.balance),
    }


def _show(result: Verification) -> None:
    from ..report.verification_tables import verified_darks_table, verified_patches_table, verified_planes_table

    print_table("Patches measured again", *verified_patches_table(result))
    if len(result.planes) > 1:
        print_table("Colour planes", *verified_planes_table(result))
    print_table("Darkness measured again", *verified_darks_table(result))
    for finding in result.findings:
        say(f"{finding[0].upper()}{finding[1:]}")
