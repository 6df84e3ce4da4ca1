"""Commands calibrate, evaluate and replay: what is made of a recorded session."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, Literal

import typer

from ..errors import InputError, SessionError
from .terminal import JSON_OPTION, fraction_of_percent, print_json, progress_bars, say

if TYPE_CHECKING:
    from ..calibration import AnyCalibration
    from ..evaluate import ObservedSession, SessionEvaluation
    from ..evaluate.corrections import PlaneCorrections
    from ..session import ContrastConfiguration, Session, SessionConfiguration

SESSION_ARGUMENT = typer.Argument(help="Folder of the session.")
OUTPUT_OPTION = typer.Option(None, "--output", "-o", help="Folder for the results.", show_default="SESSION-results")
WITHOUT_OPTION = typer.Option([], "--without", help="Patch to leave out; may be given several times.")
CONTRAST_OPTION = typer.Option(None, help="Contrast to detect, for example 1000%; default: as configured.")
EPSILON_OPTION = typer.Option(None, help="Tolerance of the contrast, for example 50%; default: as configured.")
PAIR_OPTION = typer.Option([], "--pair", help="BRIGHT:DARK, two patches; default: as configured. May be repeated.")


def calibrate(
    session: Path = SESSION_ARGUMENT,
    more: list[Path] = typer.Argument(
        None, help="Further sessions of the same camera and lens, with other gains or at other temperatures."
    ),
    output: Path | None = OUTPUT_OPTION,
    without: list[str] = WITHOUT_OPTION,
    hold_out: list[str] = typer.Option(
        [], help="Patch to test the fit with instead of showing it; may be given several times."
    ),
    flat_field: Path | None = typer.Option(
        None, help="Session recorded with uniform light that fills the image; default: cos^4 of the lens."
    ),
    unevenness: str = typer.Option("1%", help="Standard uncertainty of the uniform light across the image."),
    response: Literal["debevec", "robertson"] | None = typer.Option(
        None,
        help="Find the camera's response (tone curve, gamma) from the session's exposures as a bracket, by Debevec or "
        "Robertson; the readings scale it. Default: linear, or bent as the readings ask for.",
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Fit the camera's conversion from DN to cd/m^2, save it, and report how good it is.

    Hot pixels and the pattern of the darkness are found in the session's dark frames. The pattern is taken off, also
    from frames that are converted later, if that leaves less than it removes.
    """
    from ..calibration import save
    from ..evaluate import calibrate_session, response_of_session
    from ..report import write_calibration_report
    from ..session import Session

    opened = Session.open(session)
    corrections = _corrections([opened, *(Session.open(path) for path in more or ())], flat_field, unevenness)
    observed = _observe(session, without, corrections)[1]
    others = [_observe(path, [], corrections)[1] for path in more or ()]
    curve = None if response is None else response_of_session(opened, observed, response)
    calibration = calibrate_session(observed, *others, held_out=hold_out, response=curve)
    folder = _made(_results_folder(opened, output))
    path = folder / "calibration.json"
    save(calibration, path)
    written = write_calibration_report(calibration, folder, opened.configuration.name)
    if as_json:
        print_json({"calibration": str(path), "report": [str(p) for p in written], **_calibration_values(calibration)})
        return
    show_calibration(calibration)
    say(f"Saved: {', '.join(str(p) for p in (path, *written))}")
    chosen = "" if output is None else f" --output {quote(str(output))}"
    say(f"Next: labcdp evaluate {quote(str(session))}{chosen}")


def evaluate(
    session: Path = SESSION_ARGUMENT,
    calibration: Path | None = typer.Option(None, help="Calibration file; default: the one in the results folder."),
    output: Path | None = OUTPUT_OPTION,
    without: list[str] = WITHOUT_OPTION,
    contrast: str | None = CONTRAST_OPTION,
    epsilon: str | None = EPSILON_OPTION,
    pair: list[str] = PAIR_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Tell luminance and detection probability of a session's patches; write report, spreadsheet and pictures."""
    from ..calibration import load_any
    from ..evaluate import corrections_of, evaluate_session
    from ..report import write_results
    from ..session import Session

    folder = _results_folder(Session.open(session), output)
    path = calibration or folder / "calibration.json"
    if calibration is None and not path.exists():
        raise InputError(f"{path} does not exist: run 'labcdp calibrate {session}' first, or give --calibration")
    loaded = load_any(path)
    opened, observed = _observe(session, without, corrections_of(loaded))
    result = evaluate_session(opened, observed, loaded, _contrasts(opened.configuration, contrast, epsilon, pair))
    written = write_results(result, _made(folder))
    if as_json:
        print_json(result.to_dict())
    else:
        show_evaluation(result)
        say(f"Written: {', '.join(str(p) for p in written)}")


def replay(
    session: Path | None = typer.Argument(None, help="Folder of the session; default: the one that ships with labcdp."),
    against: Path | None = typer.Option(None, help="results.json to compare with; a difference is an error."),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for report and calibration; default: none."
    ),
    without: list[str] = WITHOUT_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Repeat calibration and evaluation of a recorded session."""
    from ..calibration import save
    from ..evaluate import calibrate_session, evaluate_session
    from ..report import write_results
    from ..session import example_session

    recorded = None if against is None else _recorded_results(against)
    opened, observed = _observe(session or example_session(), without)
    calibration = calibrate_session(observed)
    result = evaluate_session(opened, observed, calibration)
    if recorded is not None:
        _require_same(result, recorded, str(against))
    if output is not None:
        save(calibration, _made(output) / "calibration.json")
        write_results(result, output)
    if as_json:
        print_json(result.to_dict())
    else:
        show_evaluation(result)
    if against is not None:
        say(f"Identical to {against}")


def _corrections(sessions: list[Session], flat_field: Path | None, unevenness: str) -> PlaneCorrections:
    """Measure what is taken off the frames before a calibration."""
    from ..evaluate import corrections_of_lens, measure_corrections, require_same_optics, with_darkness
    from ..session import Session

    with progress_bars() as bars:
        if flat_field is None:
            corrections: PlaneCorrections = corrections_of_lens(sessions[0])
        else:
            flat = Session.open(flat_field)
            require_same_optics(sessions[0], flat)
            rel = fraction_of_percent(unevenness, "--unevenness")
            corrections = measure_corrections(flat, rel, partial(bars.update, "flat field"))
        return with_darkness(corrections, sessions, partial(bars.update, "darkness"))


def _observe(
    path: Path, without: list[str], corrections: PlaneCorrections | None = None
) -> tuple[Session, ObservedSession]:
    from ..evaluate import observe_session
    from ..session import Session

    session = Session.open(path)
    with progress_bars() as bars:
        report = partial(bars.update, "reading")
        return session, observe_session(session, without, report, corrections)


def _results_folder(session: Session, output: Path | None) -> Path:
    path = session.path.resolve()
    return output or path.with_name(f"{path.name}-results")


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): give another --output") from error
    return folder


def _contrasts(
    configuration: SessionConfiguration, contrast: str | None, epsilon: str | None, pairs: list[str]
) -> list[ContrastConfiguration]:
    from pydantic import ValidationError

    from ..session import ContrastConfiguration

    chosen: list[dict[str, Any]] = [c.model_dump() for c in configuration.contrasts]
    if pairs:
        if contrast is None:
            raise InputError("--pair needs a contrast: give --contrast, for example --contrast 1000%")
        chosen = [dict(zip(("bright", "dark"), _pair(text), strict=True)) for text in pairs]
    changes = {
        name: fraction_of_percent(text, f"--{name}")
        for name, text in (("contrast", contrast), ("epsilon", epsilon))
        if text is not None
    }
    try:
        return [ContrastConfiguration(**values | changes) for values in chosen]
    except ValidationError as error:
        name = error.errors()[0]["loc"][0]
        given, allowed = (contrast, "above 0%") if name == "contrast" else (epsilon, "above 0%, up to 100%")
        raise InputError(f"--{name} is {given}: give a value {allowed}") from error


def _pair(text: str) -> tuple[str, str]:
    bright, found, dark = text.partition(":")
    if not (found and bright and dark):
        raise InputError(f"--pair is {text!r}: give BRIGHT:DARK, two names of patches")
    return bright, dark


def _recorded_results(against: Path) -> dict[str, Any]:
    import json

    try:
        recorded = json.loads(against.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{against} cannot be read as JSON ({error}): give a results.json") from error
    if not isinstance(recorded, dict):
        raise InputError(f"{against} holds no results: give a results.json")
    return recorded


def _require_same(result: SessionEvaluation, recorded: dict[str, Any], against: str) -> None:
    differing = sorted(key for key, value in _numbers(result.to_dict()).items() if recorded.get(key) != value)
    if differing:
        raise SessionError(
            f"the replay differs from {against} in {', '.join(differing)}: another version of labcdp or of its "
            "libraries made it, or it belongs to another session"
        )


def _numbers(values: dict[str, Any]) -> dict[str, Any]:
    """Keep what a replay has to repeat: all but the versions of the programs."""
    import json

    from ..json_text import results_json

    numbers: dict[str, Any] = json.loads(results_json(values))
    del numbers["versions"]
    return numbers


def _calibration_values(calibration: AnyCalibration) -> dict[str, Any]:
    from ..calibration import Calibration
    from ..evaluate import calibration_values

    values = calibration_values(calibration)
    if isinstance(calibration, Calibration):
        fit = calibration.responsivity
        values |= {"responsivity_random_rel": fit.random_rel, "reduced_chi_squared": fit.reduced_chi_squared}
    return {
        **values,
        "range_cd_m2": list(calibration.range_cd_m2),
        "patches": len(calibration.residuals),
        "held_out": {row.patch: row.residual_rel for row in calibration.held_out},
        "warnings": list(calibration.warnings),
    }


def show_calibration(calibration: AnyCalibration) -> None:
    """Tell a person what was fitted, and what to mind."""
    low, high = calibration.range_cd_m2
    patches = f"{len(calibration.residuals)} patches of {low:.3g} to {high:.3g} cd/m^2"
    say(f"{_fitted(calibration)}, from {patches}")
    for row in calibration.held_out:
        say(f"Held out: {row.patch}, camera over meter less one {row.residual_rel:+.2%}")
    left_out = [w for w in calibration.warnings if "left out there" in w]
    if left_out:
        plural = "1 patch is" if len(left_out) == 1 else f"{len(left_out)} patches are"
        say(f"{plural} clipped or too dark at some exposures and left out there")
    for warning in calibration.warnings:
        if warning not in left_out:
            say(f"Warning: {warning}")


def _fitted(calibration: AnyCalibration) -> str:
    from ..calibration import Calibration, expanded_half_width

    if isinstance(calibration, Calibration):
        fit = calibration.responsivity
        half_width = expanded_half_width(calibration.meter_scale.half_width_rel, fit.random_rel)
        alone = expanded_half_width(0.0, fit.random_rel)
        return (
            f"Responsivity {fit.responsivity_dn_s_cd_m2:.5g} DN s^-1 / (cd m^-2) +- {half_width:.2%} (95 %; fit alone "
            f"{alone:.2%})"
        )
    weights = zip(calibration.planes, calibration.weights, strict=True)
    return "Luminance = " + " ".join(f"{weight:+.3f} L({plane.state.plane})" for plane, weight in weights)


def show_evaluation(result: SessionEvaluation) -> None:
    """Print the tables, and what was simulated."""
    from ..report import contrast_table, summary_table
    from .terminal import print_table

    show_calibration(result.calibration)
    for warning in result.warnings:
        if warning not in result.calibration.warnings:
            say(f"Warning: {warning}")
    print_table("Luminance", *summary_table(result))
    if result.contrasts:
        print_table("Contrast detection probability", *contrast_table(result))
    if result.simulated:
        say(f"Simulated: {', '.join(result.simulated)}")
