"""Command verify: check whether a calibration is still valid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from ...acquire.verify_plan import verification_configuration
from ...calibration import AnyCalibration, Calibration, load_any
from ...calibration.record import save_verification
from ...calibration.verify.result import require_tolerance
from ...core.errors import InputError
from ...core.result import InputFile
from ...evaluate.bench.certificate import verification_certificate
from ...evaluate.bench.session import mismatch
from ...evaluate.bench.session_result import session_input
from ...evaluate.bench.verification import verification_result, verify_session
from ...report.files import envelope_json
from ...session import MeterCertificate, Session, SessionConfiguration
from ..bench.acquire import record
from ..bench.options import DeviceOptions
from ..commands import As
from ..options import Certificate, Results
from ..terminal import progress_bar, say
from ..values import fraction_of_percent

#: Exit status by verdict.
EXIT_STATUS = {"conform": 0, "not conform": 3, "undecided": 4}


def _tolerance(text: str, name: str) -> float:
    return require_tolerance(fraction_of_percent(text, name))


@dataclass(frozen=True)
class Judgement:
    """Options for what is measured and when it conforms.

    Parameters
    ----------
    patch
        Patch to measure; may be repeated. Default: darkest, middle and brightest (grey ones, with colour filters); all
        of a recorded session.
    tolerance
        Largest deviation of the camera from the meter that conforms, for example 3%; default: U (95 %).
    """

    patch: tuple[str, ...] = ()
    tolerance: Annotated[float | None, As(parse=_tolerance)] = None
    certificate: Certificate = None


def verify(
    context: typer.Context,
    judgement: Judgement,
    devices: DeviceOptions,
    results: Results,
    calibration: Path,
    paths: tuple[Path, ...],
) -> None:
    """Check a calibration by measuring two or three patches again.

    A patch conforms if its deviation and the uncertainty U of that are together within the tolerance, and does not if
    the deviation exceeds the tolerance by more than U; in between it is undecided. Exit status: 0 conform, 3 not
    conform, 4 undecided, 1 for an error. Writes verification.json, which labcdp history reads.

    Parameters
    ----------
    calibration
        Calibration file written by labcdp calibrate.
    paths : [CONFIGURATION] SESSION
        TOML file of the bench and a new session folder, to measure now; or the folder of a recorded session.
    """
    configuration, session = _paths(paths)
    certificate = None if judgement.certificate is None else MeterCertificate.load(judgement.certificate)
    loaded = load_any(calibration)
    if configuration is None and devices.given:
        raise InputError(
            "options of devices cannot be used with a recorded session: leave them out, or give a configuration too"
        )
    with results.folder(context, session) as folder:
        path = folder.folder / "verification.json"
        if configuration is not None:
            _acquire(configuration, session, loaded, judgement.patch, devices)
        measured = Session.open(session)
        with progress_bar("reading") as report:
            verification, observed = verify_session(
                measured,
                loaded,
                judgement.patch if configuration is None else (),
                report,
                judgement.tolerance,
                certificate,
            )
        save_verification(verification, folder.path(path.name))
        inputs = (session_input(measured), InputFile.of("calibration", calibration))
        result = verification_result(verification, session.resolve().name, inputs)
        certified = verification_certificate(measured, observed, loaded, verification)
        folder.add({"certificate.html": certified, "results.json": envelope_json(result).encode()})
    following = [f"Saved: {path}"]
    if verification.verdict == "not conform":
        history = f"labcdp history {quote(str(path.parent))}"
        following.append(f"Next: labcdp acquire and labcdp calibrate, then {history}")
    results.print(result, *following, page=folder.folder / "certificate.html")
    raise typer.Exit(EXIT_STATUS[verification.verdict])


def _paths(paths: Sequence[Path]) -> tuple[Path | None, Path]:
    """Distinguish between a configuration and a session."""
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
    configuration: Path, session: Path, calibration: AnyCalibration, patches: Sequence[str], devices: DeviceOptions
) -> None:
    bench = SessionConfiguration.load(configuration)
    devices.check(bench.meter)
    if devices.simulating and not isinstance(calibration, Calibration):
        raise InputError(
            "the camera of the simulated bench has no colour filters, the calibration's has: measure with that camera, "
            "or import its pictures and give the folder of that session alone"
        )
    # Refused before anything is measured; the findings include a warning.
    mismatch(bench, calibration)
    wanted = verification_configuration(bench, calibration, patches)
    say(f"Measuring {', '.join(p.name for p in wanted.target.patches)} again")
    record(session, configuration, wanted, devices)
