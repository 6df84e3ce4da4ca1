"""Command verify: check whether a calibration is still valid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shlex import quote

import typer

from ...acquire.verify_plan import verification_configuration
from ...calibration import AnyCalibration, Calibration, load_any
from ...calibration.record import save_verification
from ...calibration.verify.result import Verification, require_tolerance
from ...core.errors import InputError
from ...core.result import InputFile
from ...evaluate.bench.certificate import verification_certificate
from ...evaluate.bench.observe import ObservedSession
from ...evaluate.bench.session import mismatch
from ...evaluate.bench.session_result import session_input
from ...evaluate.bench.verification import verification_result, verify_session
from ...report.files import envelope_json
from ...session import MeterCertificate, Session, SessionConfiguration
from ..bench.acquire import record
from ..bench.device_options import DeviceChoice, DeviceOptions
from ..options import CERTIFICATE_OPTION
from ..output import FORCE_OPTION, output_option, results_folder
from ..terminal import JSON_OPTION, fraction_of_percent, print_result, progress_bars, say

#: Exit status by verdict.
EXIT_STATUS = {"conform": 0, "not conform": 3, "undecided": 4}


@dataclass(frozen=True)
class Judgement:
    """Options for what is measured and when it conforms."""

    patch: list[str] = typer.Option(
        [],
        "--patch",
        help="Patch to measure; may be repeated. Default: darkest, middle and brightest (grey ones, with colour "
        "filters); all of a recorded session.",
    )
    tolerance: str | None = typer.Option(
        None,
        help="Largest deviation of the camera from the meter that conforms, for example 3%.",
        show_default="U (95 %)",
    )
    certificate: Path | None = CERTIFICATE_OPTION


def verify(
    context: typer.Context,
    judgement: Judgement,
    devices: DeviceOptions,
    calibration: Path = typer.Argument(help="Calibration file written by labcdp calibrate."),
    paths: list[Path] = typer.Argument(
        metavar="[CONFIGURATION] SESSION",
        help="TOML file of the bench and a new session folder, to measure now; or the folder of a recorded session.",
    ),
    output: Path | None = output_option("SESSION-verify"),
    force: bool = FORCE_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Check a calibration by measuring two or three patches again.

    A patch conforms if its deviation and the uncertainty U of that are together within the tolerance, and does not if
    the deviation exceeds the tolerance by more than U; in between it is undecided. Exit status: 0 conform, 3 not
    conform, 4 undecided, 1 for an error. Writes verification.json, which labcdp history reads.
    """
    configuration, session = _paths(paths)
    tolerance, certificate, patches = judgement.tolerance, judgement.certificate, judgement.patch
    tolerance_rel = None if tolerance is None else require_tolerance(fraction_of_percent(tolerance, "--tolerance"))
    of_meter = None if certificate is None else MeterCertificate.load(certificate)
    loaded = load_any(calibration)
    if configuration is None and devices.given:
        raise InputError(
            "options of devices cannot be used with a recorded session: leave them out, or give a configuration too"
        )
    with results_folder(context, session, output, force) as results:
        path = results.folder / "verification.json"
        if configuration is not None:
            _acquire(configuration, session, loaded, patches, devices.choice())
        wanted = patches if configuration is None else []
        verification, observed = _verified(session, loaded, wanted, tolerance_rel, of_meter)
        save_verification(verification, results.path(path.name))
        inputs = (session_input(Session.open(session)), InputFile.of("calibration", calibration))
        result = verification_result(verification, session.resolve().name, inputs)
        certified = verification_certificate(Session.open(session), observed, loaded, verification)
        results.add({"certificate.html": certified, "results.json": envelope_json(result).encode()})
    print_result(result, as_json)
    if not as_json:
        say(f"Saved: {path}")
        if verification.verdict == "not conform":
            say(f"Next: labcdp acquire and labcdp calibrate, then labcdp history {quote(str(path.parent))}")
    raise typer.Exit(EXIT_STATUS[verification.verdict])


def _paths(paths: list[Path]) -> tuple[Path | None, Path]:
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
    configuration: Path, session: Path, calibration: AnyCalibration, patch: list[str], choice: DeviceChoice
) -> None:
    bench = SessionConfiguration.load(configuration)
    choice.check(bench.meter)
    if choice.simulated and not isinstance(calibration, Calibration):
        raise InputError(
            "the camera of the simulated bench has no colour filters, the calibration's has: measure with that camera, "
            "or import its pictures and give the folder of that session alone"
        )
    # Refused before anything is measured; the findings include a warning.
    mismatch(bench, calibration)
    wanted = verification_configuration(bench, calibration, patch)
    say(f"Measuring {', '.join(p.name for p in wanted.target.patches)} again")
    record(session, configuration, wanted, choice)


def _verified(
    path: Path,
    calibration: AnyCalibration,
    patches: list[str],
    tolerance_rel: float | None,
    certificate: MeterCertificate | None,
) -> tuple[Verification, ObservedSession]:
    session = Session.open(path)
    with progress_bars() as bars:
        report = partial(bars.update, "reading")
        return verify_session(session, calibration, patches, report, tolerance_rel, certificate)
