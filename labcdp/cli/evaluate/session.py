"""Commands calibrate and evaluate, for recorded sessions."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shlex import quote
from typing import Any, Literal

import typer

from ...calibration import load_any, save
from ...core.disk import read_json
from ...core.errors import InputError, SessionError
from ...core.result import InputFile, Result
from ...evaluate.bench.calibrate import calibrate_recorded, calibrate_session
from ...evaluate.bench.calibration_page import write_calibration_report
from ...evaluate.bench.calibration_result import calibration_result
from ...evaluate.bench.certificate import calibration_certificate
from ...evaluate.bench.corrections import (
    PlaneCorrections,
    UniformLight,
    calibration_for,
    corrections_of,
    require_same_optics,
)
from ...evaluate.bench.observe import ObservedSession, observe_session
from ...evaluate.bench.recorded import certificate_of
from ...evaluate.bench.session import SessionEvaluation, evaluate_session
from ...evaluate.bench.session_page import write_results
from ...evaluate.bench.session_result import session_input, session_result
from ...output import ResultsFolder
from ...report.files import SCHEMA, envelope_json
from ...session import ContrastConfiguration, MeterCertificate, Session, SessionConfiguration, example_session
from ..options import CERTIFICATE_OPTION, CONTRAST_HELP, PAIR_METAVAR, parse_contrasts, parse_pair, parse_tolerance
from ..output import Results, default_folder, show_page
from ..terminal import fraction_of_percent, print_result, progress_bars, say
from .verify import EXIT_STATUS

WITHOUT_OPTION = typer.Option([], "--without", help="Patch to leave out; may be repeated.")


@dataclass(frozen=True)
class FitOptions:
    """Options of the calibration."""

    without: list[str] = WITHOUT_OPTION
    hold_out: list[str] = typer.Option([], help="Patch used to test the fit, not to make it; may be repeated.")
    flat_field: Path | None = typer.Option(
        None, help="Session recorded with uniform light that fills the image; default: cos⁴ vignetting."
    )
    nonuniformity: str = typer.Option("1%", help="Standard uncertainty of the uniformity of that light.")
    response: Literal["debevec"] | None = typer.Option(
        None,
        help="Estimate the camera's response (tone curve, gamma) from the session's exposures as a bracket, after "
        "Debevec and Malik; the readings scale it. Default: linear, or nonlinear if the readings require it.",
    )
    certificate: Path | None = CERTIFICATE_OPTION

    def configuration(self) -> dict[str, Any]:
        """Return the options as values JSON can hold."""
        return {name: str(value) if isinstance(value, Path) else value for name, value in vars(self).items()}

    def uniform_light(self, session: Session, report: Callable[[int, int], None]) -> UniformLight | None:
        """Read the session recorded with uniform light, None if there is none; raises InputError."""
        if self.flat_field is None:
            return None
        flat = Session.open(self.flat_field)
        require_same_optics(session, flat)
        return UniformLight.read(flat, fraction_of_percent(self.nonuniformity, "--nonuniformity"), report)


@dataclass(frozen=True)
class ContrastOptions:
    """Options for the contrasts of the patches; those not given are as configured."""

    without: list[str] = WITHOUT_OPTION
    contrast: list[str] = typer.Option([], "--contrast", help=CONTRAST_HELP, show_default="as configured")
    epsilon: str | None = typer.Option(
        None, help="Relative tolerance of the contrast, for example 50%; default: as configured."
    )
    pair: list[str] = typer.Option(
        [], "--pair", metavar=PAIR_METAVAR, help="Names of two patches. May be repeated.", show_default="as configured"
    )

    def contrasts(self, configuration: SessionConfiguration) -> list[ContrastConfiguration]:
        """Return pairs and contrasts as given, or else as configured; raises InputError."""
        chosen: list[dict[str, Any]] = [one.model_dump() for one in configuration.contrasts]
        if self.pair:
            if not self.contrast:
                raise InputError("--pair needs a contrast: give --contrast, for example --contrast 1000%")
            names = [patch.name for patch in configuration.target.patches]
            chosen = [dict(zip(("bright", "dark"), parse_pair(text, names), strict=True)) for text in self.pair]
        if self.epsilon is not None:
            chosen = [one | {"epsilon": parse_tolerance(self.epsilon)} for one in chosen]
        if self.contrast:
            values = parse_contrasts(self.contrast)
            different = list({json.dumps(one | {"contrast": None}): one for one in chosen}.values())
            chosen = [one | {"contrast": value} for one in different for value in values]
        return [ContrastConfiguration(**one) for one in chosen]


@dataclass(frozen=True)
class CalibrationOptions:
    """Options for the calibration that a session is evaluated with."""

    calibration: Path | None = typer.Option(
        None, help="Calibration file.", show_default="SESSION-calibrate/calibration.json"
    )
    recalibrate: bool = typer.Option(
        False, "--recalibrate", help="Calibrate with the session itself instead of loading a calibration."
    )
    against: Path | None = typer.Option(
        None, help="With --recalibrate: results.json to compare with; any difference is an error."
    )

    def file(self, session: Path) -> Path | None:
        """Return the calibration file, None for a calibration with the session itself; raises InputError."""
        if self.recalibrate and self.calibration is not None:
            raise InputError("--recalibrate and --calibration exclude each other: leave one out")
        if self.against is not None and not self.recalibrate:
            raise InputError("--against requires --recalibrate: give both or neither")
        path = self.calibration or default_folder(session, "calibrate") / "calibration.json"
        if not self.recalibrate and self.calibration is None and not path.exists():
            raise InputError(
                f"{path} does not exist: run 'labcdp calibrate {quote(str(session))}' in this folder first, or give "
                "--calibration or --recalibrate"
            )
        return None if self.recalibrate else path


def calibrate(
    context: typer.Context,
    fit: FitOptions,
    results: Results,
    session: Path = typer.Argument(help="Folder of the session."),
    more: list[Path] = typer.Argument(
        None, help="Further sessions of the same camera and lens, at other gains or temperatures."
    ),
) -> None:
    """Fit the camera's conversion from DN to cd/m², save it, and report its uncertainty.

    Hot pixels and the dark pattern are measured in the session's dark frames. The pattern is subtracted, also from
    frames converted later, if it is larger than its own noise.
    """
    opened = Session.open(session)
    of_meter = None if fit.certificate is None else MeterCertificate.load(fit.certificate)
    with results.folder(context, session) as folder:
        with progress_bars() as bars:

            def report(what: str) -> Callable[[int, int], None]:
                return partial(bars.update, what)

            uniform = fit.uniform_light(opened, report("flat field"))
            calibration, observed = calibrate_recorded(
                [opened, *(Session.open(path) for path in more or ())],
                uniform,
                without=fit.without,
                held_out=fit.hold_out,
                bracket=fit.response is not None,
                certificate=of_meter,
                report=report,
            )
        path = folder.folder / "calibration.json"
        save(calibration, folder.path(path.name))
        inputs = [session_input(opened), *(session_input(Session.open(one)) for one in more or ())]
        options = {"output": str(folder.folder), **fit.configuration()}
        result = calibration_result(calibration, opened.configuration.name, inputs, options)
        written = write_calibration_report(calibration, result, folder)
        certified = calibration_certificate(opened, observed, calibration)
        written += folder.add({"certificate.html": certified, "results.json": envelope_json(result).encode()})
    print_result(result, results.as_json)
    if not results.as_json:
        say(f"Saved: {', '.join(str(p) for p in (path, *written))}")
        chosen = "" if results.output is None else f" --calibration {quote(str(path))}"
        say(f"Next: labcdp evaluate {quote(str(session))}{chosen}")
    show_page(folder.folder / "calibration.html", results.open_page)


def evaluate(
    context: typer.Context,
    by: CalibrationOptions,
    options: ContrastOptions,
    results: Results,
    session: Path | None = typer.Argument(
        None, help="Folder of the session; default with --recalibrate: the session that ships with labcdp."
    ),
) -> None:
    """Compute luminance and contrast detection probability of a session's patches.

    The exit status is 3 if a patch fails its limits_cd_m2 of the plan, 4 if one is undecided.

    Example: labcdp evaluate my-session --pair white:grey --contrast 50%,100%
    """
    if session is None and not by.recalibrate:
        raise InputError("no session given: give its folder, or --recalibrate for the session that ships with labcdp")
    source = session or example_session()
    path, opened = by.file(source), Session.open(source)
    recorded = None if by.against is None else _recorded_results(by.against)
    contrasts = options.contrasts(opened.configuration)
    with results.folder(context, source) as folder:
        evaluation, result = _evaluated(source, path, options.without, contrasts)
        if recorded is not None:
            _require_same(result, recorded, str(by.against))
        if path is None:
            _save_calibration(evaluation, folder)
        written = write_results(evaluation, result, folder)
    print_result(result, results.as_json)
    if not results.as_json:
        say(f"Written: {', '.join(str(p) for p in written)}")
    if by.against is not None:
        say(f"Identical to {by.against}")
    show_page(folder.folder / "report.html", results.open_page)
    verdicts = {row.region.name: row.limit_verdict for row in evaluation.patches}
    if not set(verdicts.values()) <= {None, "pass"}:
        missed = [f"{name} ({verdict})" for name, verdict in verdicts.items() if verdict not in (None, "pass")]
        say(f"Limits not met: {', '.join(missed)}")
        raise typer.Exit(EXIT_STATUS["not conform" if "fail" in verdicts.values() else "undecided"])


def _evaluated(
    source: Path, calibration: Path | None, without: list[str], contrasts: list[ContrastConfiguration]
) -> tuple[SessionEvaluation, Result]:
    """Evaluate a session with a calibration file, or with the calibration made from the session."""
    if calibration is None:
        opened, observed = _observe(source, without)
        evaluation = evaluate_session(opened, observed, calibrate_session(observed), contrasts)
        return evaluation, session_result(evaluation, [session_input(opened)])
    session = Session.open(source)
    loaded = calibration_for(session, load_any(calibration))
    opened, observed = _observe(source, without, corrections_of(loaded), certificate_of(loaded, session))
    evaluation = evaluate_session(opened, observed, loaded, contrasts)
    return evaluation, session_result(evaluation, [session_input(opened), InputFile.of("calibration", calibration)])


def _save_calibration(evaluation: SessionEvaluation, results: ResultsFolder) -> None:
    save(evaluation.calibration, results.path("calibration.json"))


def _observe(
    path: Path,
    without: list[str],
    corrections: PlaneCorrections | None = None,
    certificate: MeterCertificate | None = None,
) -> tuple[Session, ObservedSession]:
    session = Session.open(path)
    with progress_bars() as bars:
        report = partial(bars.update, "reading")
        return session, observe_session(session, without, report, corrections, certificate)


def _recorded_results(against: Path) -> dict[str, Any]:
    recorded = read_json(against, "a results.json")
    if not isinstance(recorded, dict):
        raise InputError(f"{against} holds no results: give a results.json")
    return recorded


def _require_same(result: Result, recorded: dict[str, Any], against: str) -> None:
    """Check that numbers and findings agree; versions and paths may differ, and the demo has more tables."""
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
