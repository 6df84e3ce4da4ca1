"""Commands calibrate and evaluate, for recorded sessions."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, Literal

import typer

from ...core.errors import InputError, SessionError
from ..options import CERTIFICATE_OPTION, CONTRAST_HELP, PAIR_METAVAR, parse_contrasts, parse_pair, parse_tolerance
from ..output import FORCE_OPTION, OPEN_OPTION, default_folder, output_option, results_folder, show_page
from ..terminal import JSON_OPTION, fraction_of_percent, print_result, progress_bars, say
from .verify import EXIT_STATUS

if TYPE_CHECKING:
    from ...core.result import Result
    from ...evaluate.bench.corrections import PlaneCorrections
    from ...evaluate.bench.observe import ObservedSession
    from ...evaluate.bench.session import SessionEvaluation
    from ...output import ResultsFolder
    from ...session import ContrastConfiguration, MeterCertificate, Session, SessionConfiguration

SESSION_ARGUMENT = typer.Argument(help="Folder of the session.")
WITHOUT_OPTION = typer.Option([], "--without", help="Patch to leave out; may be repeated.")
CONTRAST_OPTION = typer.Option([], "--contrast", help=CONTRAST_HELP, show_default="as configured")
EPSILON_OPTION = typer.Option(None, help="Relative tolerance of the contrast, for example 50%; default: as configured.")
PAIR_OPTION = typer.Option(
    [], "--pair", metavar=PAIR_METAVAR, help="Names of two patches. May be repeated.", show_default="as configured"
)


def calibrate(
    context: typer.Context,
    session: Path = SESSION_ARGUMENT,
    more: list[Path] = typer.Argument(
        None, help="Further sessions of the same camera and lens, at other gains or temperatures."
    ),
    output: Path | None = output_option("SESSION-calibrate"),
    without: list[str] = WITHOUT_OPTION,
    hold_out: list[str] = typer.Option([], help="Patch used to test the fit, not to make it; may be repeated."),
    flat_field: Path | None = typer.Option(
        None, help="Session recorded with uniform light that fills the image; default: cos⁴ vignetting."
    ),
    nonuniformity: str = typer.Option("1%", help="Standard uncertainty of the uniformity of that light."),
    response: Literal["debevec"] | None = typer.Option(
        None,
        help="Estimate the camera's response (tone curve, gamma) from the session's exposures as a bracket, after "
        "Debevec and Malik; the readings scale it. Default: linear, or nonlinear if the readings require it.",
    ),
    certificate: Path | None = CERTIFICATE_OPTION,
    force: bool = FORCE_OPTION,
    open_page: bool = OPEN_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Fit the camera's conversion from DN to cd/m², save it, and report its uncertainty.

    Hot pixels and the dark pattern are measured in the session's dark frames. The pattern is subtracted, also from
    frames converted later, if it is larger than its own noise.
    """
    from ...calibration import save
    from ...evaluate.bench.calibration.page import write_calibration_report
    from ...evaluate.bench.calibration.result import calibration_result
    from ...evaluate.bench.certificate import calibration_certificate
    from ...evaluate.bench.flat import UniformLight, require_same_optics
    from ...evaluate.bench.recorded_calibration import calibrate_recorded
    from ...evaluate.bench.report.result import session_input
    from ...report.envelope import envelope_json
    from ...session import MeterCertificate, Session

    opened = Session.open(session)
    of_meter = None if certificate is None else MeterCertificate.load(certificate)
    with results_folder(context, session, output, force) as results:
        with progress_bars() as bars:

            def report(what: str) -> Callable[[int, int], None]:
                return partial(bars.update, what)

            uniform = None
            if flat_field is not None:
                flat = Session.open(flat_field)
                require_same_optics(opened, flat)
                rel = fraction_of_percent(nonuniformity, "--nonuniformity")
                uniform = UniformLight.read(flat, rel, report("flat field"))
            sessions = [opened, *(Session.open(path) for path in more or ())]
            calibration, observed = calibrate_recorded(
                sessions,
                uniform,
                without=without,
                held_out=hold_out,
                bracket=response is not None,
                certificate=of_meter,
                report=report,
            )
        path = results.folder / "calibration.json"
        save(calibration, results.path(path.name))
        inputs = [session_input(opened), *(session_input(Session.open(one)) for one in more or ())]
        options = {
            "output": str(results.folder),
            "without": without,
            "hold_out": hold_out,
            "flat_field": None if flat_field is None else str(flat_field),
            "nonuniformity": nonuniformity,
            "response": response,
            "certificate": None if certificate is None else str(certificate),
        }
        result = calibration_result(calibration, opened.configuration.name, inputs, options)
        written = write_calibration_report(calibration, result, results)
        certified = calibration_certificate(opened, observed, calibration)
        written += results.add({"certificate.html": certified, "results.json": envelope_json(result).encode()})
    print_result(result, as_json)
    if not as_json:
        say(f"Saved: {', '.join(str(p) for p in (path, *written))}")
        chosen = "" if output is None else f" --calibration {quote(str(path))}"
        say(f"Next: labcdp evaluate {quote(str(session))}{chosen}")
    show_page(results.folder / "calibration.html", open_page)


def evaluate(
    context: typer.Context,
    session: Path | None = typer.Argument(
        None, help="Folder of the session; default with --recalibrate: the session that ships with labcdp."
    ),
    calibration: Path | None = typer.Option(
        None, help="Calibration file.", show_default="SESSION-calibrate/calibration.json"
    ),
    recalibrate: bool = typer.Option(
        False, "--recalibrate", help="Calibrate with the session itself instead of loading a calibration."
    ),
    against: Path | None = typer.Option(
        None, help="With --recalibrate: results.json to compare with; any difference is an error."
    ),
    output: Path | None = output_option("SESSION-evaluate"),
    without: list[str] = WITHOUT_OPTION,
    contrast: list[str] = CONTRAST_OPTION,
    epsilon: str | None = EPSILON_OPTION,
    pair: list[str] = PAIR_OPTION,
    force: bool = FORCE_OPTION,
    open_page: bool = OPEN_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Compute luminance and contrast detection probability of a session's patches.

    The exit status is 3 if a patch fails its limits_cd_m2 of the plan, 4 if one is undecided.

    Example: labcdp evaluate my-session --pair white:grey --contrast 50%,100%
    """
    from ...evaluate.bench.report.page import write_results
    from ...session import Session, example_session

    if recalibrate and calibration is not None:
        raise InputError("--recalibrate and --calibration exclude each other: leave one out")
    if against is not None and not recalibrate:
        raise InputError("--against requires --recalibrate: give both or neither")
    if session is None and not recalibrate:
        raise InputError("no session given: give its folder, or --recalibrate for the session that ships with labcdp")
    source = session or example_session()
    opened = Session.open(source)
    path = None if recalibrate else _calibration_file(source, calibration)
    recorded = None if against is None else _recorded_results(against)
    contrasts = _contrasts(opened.configuration, contrast, epsilon, pair)
    with results_folder(context, source, output, force) as results:
        evaluation, result = _evaluated(source, path, without, contrasts)
        if recorded is not None:
            _require_same(result, recorded, str(against))
        if path is None:
            _save_calibration(evaluation, results)
        written = write_results(evaluation, result, results)
    print_result(result, as_json)
    if not as_json:
        say(f"Written: {', '.join(str(p) for p in written)}")
    if against is not None:
        say(f"Identical to {against}")
    show_page(results.folder / "report.html", open_page)
    verdicts = {row.region.name: row.limit_verdict for row in evaluation.patches}
    if not set(verdicts.values()) <= {None, "pass"}:
        missed = [f"{name} ({verdict})" for name, verdict in verdicts.items() if verdict not in (None, "pass")]
        say(f"Limits not met: {', '.join(missed)}")
        raise typer.Exit(EXIT_STATUS["not conform" if "fail" in verdicts.values() else "undecided"])


def _calibration_file(session: Path, given: Path | None) -> Path:
    path = given or default_folder(session, "calibrate") / "calibration.json"
    if given is None and not path.exists():
        raise InputError(
            f"{path} does not exist: run 'labcdp calibrate {quote(str(session))}' in this folder first, or give "
            "--calibration or --recalibrate"
        )
    return path


def _evaluated(
    source: Path, calibration: Path | None, without: list[str], contrasts: list[ContrastConfiguration]
) -> tuple[SessionEvaluation, Result]:
    """Evaluate a session with a calibration file, or with the calibration made from the session."""
    from ...calibration import load_any
    from ...core.result import InputFile
    from ...evaluate.bench.calibrate import calibrate_session
    from ...evaluate.bench.corrections import corrections_of
    from ...evaluate.bench.recorded import certificate_of
    from ...evaluate.bench.report.result import session_input, session_result
    from ...evaluate.bench.session import evaluate_session
    from ...session import Session

    if calibration is None:
        opened, observed = _observe(source, without)
        evaluation = evaluate_session(opened, observed, calibrate_session(observed), contrasts)
        return evaluation, session_result(evaluation, [session_input(opened)])
    loaded = load_any(calibration)
    opened, observed = _observe(source, without, corrections_of(loaded), certificate_of(loaded, Session.open(source)))
    evaluation = evaluate_session(opened, observed, loaded, contrasts)
    return evaluation, session_result(evaluation, [session_input(opened), InputFile.of("calibration", calibration)])


def _save_calibration(evaluation: SessionEvaluation, results: ResultsFolder) -> None:
    from ...calibration import save

    save(evaluation.calibration, results.path("calibration.json"))


def _observe(
    path: Path,
    without: list[str],
    corrections: PlaneCorrections | None = None,
    certificate: MeterCertificate | None = None,
) -> tuple[Session, ObservedSession]:
    from ...evaluate.bench.observe import observe_session
    from ...session import Session

    session = Session.open(path)
    with progress_bars() as bars:
        report = partial(bars.update, "reading")
        return session, observe_session(session, without, report, corrections, certificate)


def _contrasts(
    configuration: SessionConfiguration, contrast: list[str], epsilon: str | None, pairs: list[str]
) -> list[ContrastConfiguration]:
    """Return pairs and contrasts as given, or else as configured."""
    from ...session import ContrastConfiguration

    chosen: list[dict[str, Any]] = [one.model_dump() for one in configuration.contrasts]
    if pairs:
        if not contrast:
            raise InputError("--pair needs a contrast: give --contrast, for example --contrast 1000%")
        names = [patch.name for patch in configuration.target.patches]
        chosen = [dict(zip(("bright", "dark"), parse_pair(text, names), strict=True)) for text in pairs]
    if epsilon is not None:
        chosen = [one | {"epsilon": parse_tolerance(epsilon)} for one in chosen]
    if contrast:
        values = parse_contrasts(contrast)
        different = list({json.dumps(one | {"contrast": None}): one for one in chosen}.values())
        chosen = [one | {"contrast": value} for one in different for value in values]
    return [ContrastConfiguration(**one) for one in chosen]


def _recorded_results(against: Path) -> dict[str, Any]:
    from ...core.disk import read_json

    recorded = read_json(against, "a results.json")
    if not isinstance(recorded, dict):
        raise InputError(f"{against} holds no results: give a results.json")
    return recorded


def _require_same(result: Result, recorded: dict[str, Any], against: str) -> None:
    """Check that numbers and findings agree; versions and paths may differ, and the demo has more tables."""
    from ...report.envelope import SCHEMA, envelope_json

    if recorded.get("schema") != SCHEMA:
        raise InputError(f"{against} is no result of this version of labcdp: give a results.json")
    now = json.loads(envelope_json(result))
    tables, before = now["tables"], recorded.get("tables") or {}
    differing = sorted(name for name in tables if tables[name] != before.get(name))
    differing += ["configuration"] if now["configuration"] != recorded.get("configuration") else []
    differing += ["findings"] if any(one not in recorded.get("findings", []) for one in now["findings"]) else []
    if differing:
        raise SessionError(
            f"the result differs from {against} in {', '.join(differing)}: another version of labcdp or of its "
            "libraries wrote it, or it belongs to another session"
        )
