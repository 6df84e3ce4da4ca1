"""Commands calibrate and evaluate, for recorded sessions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from math import isclose
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ..calibration import load_any, save
from ..calibration.record import SavedFile
from ..core.disk import read_json
from ..core.disk.files import shell_word
from ..core.errors import InputError, SessionError
from ..core.result import InputFile, Result
from ..evaluate.bench.calibrate import calibrate_recorded
from ..evaluate.bench.calibration_page import calibration_files
from ..evaluate.bench.calibration_result import calibration_result
from ..evaluate.bench.certificate import calibration_certificate, calibration_dcc
from ..evaluate.bench.corrections import UniformLight, require_same_optics
from ..evaluate.bench.kept import OBSERVATIONS, keep_observations
from ..evaluate.bench.session import SessionEvaluation, chosen_contrasts, evaluate_session, observe_calibrated
from ..evaluate.bench.session_page import session_files
from ..evaluate.bench.session_result import session_input, session_result
from ..evaluate.judgement import Verdict, verdicts_of, worst_verdict
from ..evaluate.requirement import Requirement
from ..metrics.uncertainty import LimitVerdict
from ..report.files import SCHEMA, WrittenResult, envelope, envelope_json, whole_result
from ..session import ContrastConfiguration, MeterCertificate, Session, SessionConfiguration, example_session
from .commands import As
from .options import (
    REQUIREMENT_STATUS,
    Certificate,
    Contrasts,
    FlickerOptions,
    Require,
    Results,
    Tolerance,
    Without,
    default_folder,
    require_apart,
    require_together,
    say_unmet,
)
from .terminal import progress_bar, progress_bars, say
from .values import fraction_of_percent, parse_corners, parse_pair


@dataclass(frozen=True)
class FitOptions:
    """Options of the calibration.

    Parameters
    ----------
    hold_out
        Patch used to test the fit, not to make it; may be repeated.
    flat_field
        Session recorded with uniform light that fills the image; default: cos⁴ vignetting.
    nonuniformity
        Standard uncertainty of the uniformity of that light.
    response
        Estimate the camera's response (tone curve, gamma) from the session's exposures as a bracket, after Debevec and
        Malik; the readings scale it. Default: linear, or nonlinear if the readings require it.
    """

    without: Without = ()
    hold_out: tuple[str, ...] = ()
    flat_field: Path | None = None
    nonuniformity: str = "1%"
    response: Literal["debevec"] | None = None
    certificate: Certificate = None

    def configuration(self) -> dict[str, Any]:
        """Return the options of the fit as values JSON can hold."""
        values = {field.name: getattr(self, field.name) for field in fields(FitOptions)}
        return {name: str(value) if isinstance(value, Path) else value for name, value in values.items()}

    def uniform_light(self, session: Session, report: Callable[[int, int], None]) -> UniformLight | None:
        """Read the session recorded with uniform light, None if there is none; raises InputError."""
        if self.flat_field is None:
            return None
        flat = Session.open(self.flat_field)
        require_same_optics(session, flat)
        return UniformLight.read(flat, fraction_of_percent(self.nonuniformity, "--nonuniformity"), report)


@dataclass(frozen=True)
class ContrastOptions:
    """Options for the contrasts of the patches; those not given are as configured.

    Parameters
    ----------
    contrast
        Target contrasts: 100%, a list such as 50%,100%, or a range START:STOP:COUNT[:log] such as 10%:200%:20. May
        be repeated; default: as configured.
    epsilon
        Relative tolerance of the contrast, for example 50%; default: as configured.
    pair : BRIGHT:DARK
        Names of two patches. May be repeated; default: as configured.
    """

    without: Without = ()
    contrast: Contrasts = None
    epsilon: Tolerance | None = None
    pair: tuple[str, ...] = ()
    require: Require = None

    def requirement(self) -> Requirement | None:
        """Return what the pairs are judged by; raises InputError if contrast or tolerance are given beside it."""
        require_apart({"--require": self.require}, {"--contrast": self.contrast, "--epsilon": self.epsilon})
        return None if self.require is None else Requirement.load(self.require)

    def contrasts(self, configuration: SessionConfiguration, by: Requirement | None) -> list[ContrastConfiguration]:
        """Return pairs and contrasts as given or required, or else as configured; raises InputError."""
        if self.pair and not self.contrast and by is None:
            raise InputError("--pair needs a contrast: give --contrast, for example --contrast 1000%")
        names = [patch.name for patch in configuration.target.patches]
        pairs = [parse_pair(text, names) for text in self.pair] or None
        if by is None:
            return chosen_contrasts(configuration, pairs, self.contrast, self.epsilon)
        if not (pairs or configuration.contrasts):
            raise InputError("the plan names no pairs of patches to judge by the requirement: give --pair BRIGHT:DARK")
        return chosen_contrasts(configuration, pairs, [by.contrast], by.epsilon, by.cdp_limit)


@dataclass(frozen=True)
class CalibrationOptions:
    """Options for the calibration that a session is evaluated with.

    Parameters
    ----------
    calibration
        Calibration file; default: SESSION-calibrate/calibration.json in this folder, else beside the session.
    recalibrate
        Calibrate with the session itself instead of loading a calibration.
    against
        With --recalibrate: results.json to compare with; a difference beyond rounding is an error.
    """

    calibration: Path | None = None
    recalibrate: bool = False
    against: Path | None = None

    def file(self, session: Path) -> Path | None:
        """Return the calibration file, None for a calibration with the session itself; raises InputError."""
        require_apart({"--recalibrate": self.recalibrate}, {"--calibration": self.calibration})
        require_together({"--against": self.against}, {"--recalibrate": self.recalibrate})
        if self.recalibrate or self.calibration is not None:
            return self.calibration
        usual = default_folder(session, "calibrate") / "calibration.json"
        path = next((path for path in (usual, session.absolute().parent / usual) if path.exists()), None)
        if path is None:
            raise InputError(
                f"{usual} does not exist, here or beside the session: run 'labcdp calibrate {shell_word(session)}' "
                "first, or give --calibration or --recalibrate"
            )
        return path

    def recorded(self) -> WrittenResult | None:
        """Return the results to compare with; raises InputError."""
        if self.against is None:
            return None
        content = read_json(self.against, "a results.json")
        if not isinstance(content, dict) or content.get("schema") != SCHEMA:
            raise InputError(f"{self.against} is not a result of this version of labcdp: give a results.json")
        return whole_result(self.against, content)


@dataclass(frozen=True)
class CalibrateOptions(Results, FitOptions):
    """Options of the command."""


def calibrate(options: CalibrateOptions, session: Path, more: tuple[Path, ...] = ()) -> None:
    """Fit the camera's conversion from DN to cd/m², save it, and report its uncertainty.

    Hot pixels and the dark pattern are measured in the session's dark frames. The pattern is subtracted, also from
    frames converted later, if it is larger than its own noise.

    Parameters
    ----------
    session
        Folder of the session.
    more
        Further sessions of the same camera and lens, at other gains or temperatures.
    """
    opened = Session.open(session)
    of_meter = None if options.certificate is None else MeterCertificate.load(options.certificate)
    with options.folder(session) as folder:
        with progress_bars() as bars:

            def report(what: str) -> Callable[[int, int], None]:
                return partial(bars.set, what)

            uniform = options.uniform_light(opened, report("flat field"))
            observed, calibration = calibrate_recorded(
                [opened, *(Session.open(path) for path in more)],
                uniform,
                without=options.without,
                held_out=options.hold_out,
                bracket=options.response is not None,
                certificate=of_meter,
                report=report,
            )
        path = folder.folder / "calibration.json"
        save(calibration, folder.path(path.name))
        keep_observations(observed, folder.path(OBSERVATIONS))
        inputs = [session_input(opened), *(session_input(Session.open(path)) for path in more)]
        configuration = {"output": str(folder.folder), **options.configuration()}
        result = calibration_result(calibration, opened.configuration.name, inputs, configuration)
        folder.add(calibration_files(calibration, result))
        saved = SavedFile.of(folder.path(path.name))
        certified = calibration_certificate(observed[0], calibration, saved)
        files = {"certificate.html": certified, "results.json": envelope_json(result).encode()}
        if (digital := calibration_dcc(observed[0], calibration, saved)) is not None:
            files["certificate.xml"] = digital
        folder.add(files)
    chosen = "" if options.output is None else f" --calibration {shell_word(path)}"
    options.show(result, folder, "calibration.html", f"Next: labcdp evaluate {shell_word(session)}{chosen}")


@dataclass(frozen=True)
class EvaluateOptions(Results, FlickerOptions, ContrastOptions, CalibrationOptions):
    """Options of the evaluation.

    Parameters
    ----------
    chart
        Chart file (TOML, see labcdp init chart) of the target: all its patches against all, and the dynamic range.
        A chart without values has the luminances that the meter read of the session's patches of the same names.
    corners : "X,Y X,Y X,Y X,Y"
        Corners of the chart in pixels; default: the session's regions with the names of its patches, or its marks.
    colours
        Also tell how well the colours of the patches of each pair can be told apart, behind a colour filter.
    """

    chart: Path | None = None
    corners: Annotated[tuple[tuple[float, float], ...] | None, As(parse=parse_corners)] = None
    colours: bool = False


def evaluate(options: EvaluateOptions, session: Path | None = None) -> None:
    """Compute luminance and contrast detection probability of a session's patches.

    The exit status is 3 if a patch fails the limits_cd_m2 of the plan, 4 if one is undecided.

    Example: labcdp evaluate my-session --pair P04:P03 --contrast 50%,100%

    Parameters
    ----------
    session
        Folder of the session; default with --recalibrate: the session that ships with labcdp.
    """
    require_together({"--corners": options.corners}, {"--chart": options.chart})
    options.require_flicker()
    if session is None and not options.recalibrate:
        raise InputError("no session: give its folder, or --recalibrate for the session that ships with labcdp")
    source = session or example_session()
    opened = Session.open(source)
    path = options.file(source)
    recorded = options.recorded()
    requirement = options.requirement()
    contrasts = options.contrasts(opened.configuration, requirement)
    with options.folder(source) as folder:
        with progress_bar("reading") as report:
            loaded = None if path is None else load_any(path)
            evaluation = evaluate_session(
                *observe_calibrated(opened, loaded, options.without, report, beside=path), contrasts
            )
        if options.chart is not None:
            evaluation = _with_chart(evaluation, options)
        if options.colours:
            from ..evaluate.bench.colours import session_colours

            evaluation = replace(evaluation, colours=session_colours(evaluation))
        if options.flicker:
            from ..evaluate.bench.flicker import session_flicker

            with progress_bar("flicker") as report:
                measured = session_flicker(evaluation, report=report, **options.flicker_limits())
            evaluation = replace(evaluation, flicker=measured)
        files = {"calibration": path, "requirement": options.require, "chart": options.chart}
        inputs = [InputFile.of(role, path) for role, path in files.items() if path is not None]
        result = session_result(evaluation, inputs, requirement=requirement)
        if options.against is not None and recorded is not None:
            _require_same(result, recorded, options.against)
        if path is None:
            save(evaluation.calibration, folder.path("calibration.json"))
        folder.add(session_files(evaluation, result))
    options.show(result, folder)
    if options.against is not None:
        say(f"Agrees with {options.against} within rounding")
    verdicts = {row.patch.name: row.limit_verdict for row in evaluation.patches}
    if not set(verdicts.values()) <= {None, "pass"}:
        missed = [f"{name} ({verdict})" for name, verdict in verdicts.items() if verdict not in (None, "pass")]
        say(f"Limits not met: {', '.join(missed)}")
    required = verdicts_of(result)
    say_unmet(required)
    as_required: dict[LimitVerdict | None, Verdict] = {"fail": "not met", "undecided": "undecided"}
    worst = worst_verdict(
        ["met", *(as_required.get(verdict, "met") for verdict in verdicts.values()), *required.values()]
    )
    if worst != "met":
        raise typer.Exit(REQUIREMENT_STATUS[worst])


def _with_chart(evaluation: SessionEvaluation, options: EvaluateOptions) -> SessionEvaluation:
    """Return an evaluated session with its target as a chart; raises InputError."""
    from ..evaluate.bench.chart import session_chart
    from ..evaluate.chart.chart_file import load_chart

    assert options.chart is not None
    tolerance = {} if options.epsilon is None else {"epsilon": options.epsilon}
    measured = session_chart(evaluation, load_chart(options.chart)[0], options.corners, options.contrast, **tolerance)
    return replace(evaluation, chart=measured)


def _require_same(result: Result, recorded: WrittenResult, against: Path) -> None:
    """Check that numbers and findings agree but for rounding; versions may differ, and the demo has more of both."""
    now, before = (
        {name: asdict(values)[name] for name in ("tables", "configuration", "findings")}
        for values in (whole_result(against, envelope(result)), recorded)
    )
    if recorded.kind == "demo":
        codes = [finding["code"] for finding in now["findings"]]
        before["tables"] = {name: before["tables"].get(name) for name in now["tables"]}
        before["findings"] = [finding for finding in before["findings"] if finding.get("code") in codes]
    differing = next(_differences(now, before), None)
    if differing is not None:
        raise SessionError(
            f"the result differs from {against}, first in {differing}: another version of labcdp or of its libraries "
            "wrote it, or it belongs to another session"
        )


def _differences(now: Any, before: Any, where: str = "") -> Iterator[str]:
    """Say where JSON values differ by more than rounding, such as by another number of threads."""
    if isinstance(now, list) and isinstance(before, list) and len(now) == len(before):
        now, before = (dict(enumerate(values, start=1)) for values in (now, before))
    floats = isinstance(now, float) and isinstance(before, float)
    if isinstance(now, dict) and isinstance(before, dict):
        for key in now | before:
            yield from _differences(now.get(key), before.get(key), f"{where} {key}".lstrip())
    elif now != before and not (floats and isclose(now, before, rel_tol=1e-6, abs_tol=1e-9)):
        shown = (
            f"{len(values)} values" if isinstance(values, list | dict) else repr(values) for values in (now, before)
        )
        yield f"{where}: {' instead of '.join(shown)}"
