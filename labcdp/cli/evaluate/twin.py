"""Command twin: a camera's simulated twin, compared with the camera."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from shlex import quote

import typer

from ...calibration import load
from ...core.result import InputFile
from ...evaluate.bench.calibrate import calibrate_session
from ...evaluate.bench.corrections import calibration_for, corrections_of
from ...evaluate.bench.observe import observe_session
from ...evaluate.bench.recorded import certificate_of
from ...evaluate.bench.session_result import session_input
from ...evaluate.camera.characterise import characterise_session
from ...evaluate.twin.estimate import require_monochrome
from ...evaluate.twin.evaluate import TwinEvaluation, twin_session
from ...evaluate.twin.page import write_twin
from ...evaluate.twin.result import twin_result
from ...session import Session
from ..output import Results
from ..terminal import fraction_of_percent, progress_bars, say


def twin(
    context: typer.Context,
    results: Results,
    session: Path = typer.Argument(help="Folder of the session."),
    calibration: Path | None = typer.Option(
        None, help="Calibration file of this camera; default: calibrate with this session."
    ),
    without: list[str] = typer.Option([], "--without", help="Patch to leave out; may be repeated."),
    contrast: str | None = typer.Option(
        None, help="Contrast to detect in all pairs, for example 100%; default: contrast of each pair by the meter."
    ),
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast."),
) -> None:
    """Estimate a simulated twin of a session's camera and compare its CDP with the measured CDP.

    Estimates the camera's parameters, predicts frames and CDP of all pairs of patches from the meter readings, and
    lists for each pair whether prediction and measurement agree and which parameter matters. Writes chain.toml (for
    labcdp simulate), report.html, results.xlsx and results.json.
    """
    target = None if contrast is None else fraction_of_percent(contrast, "--contrast")
    tolerance = fraction_of_percent(epsilon, "--epsilon")
    inputs = [] if calibration is None else [InputFile.of("calibration", calibration)]
    opened = Session.open(session)
    require_monochrome(opened)
    with results.folder(context, session) as folder:
        evaluation = _evaluated(opened, calibration, without, target, tolerance)
        options = {"contrast": target, "epsilon": tolerance, "without": without}
        result = twin_result(evaluation, [session_input(opened), *inputs], options)
        write_twin(evaluation, result, folder)
    results.show(result, folder)
    say(f"Next: labcdp simulate {quote(str(folder.folder / 'chain.toml'))}")


def _evaluated(
    session: Session, calibration: Path | None, without: list[str], contrast: float | None, epsilon: float
) -> TwinEvaluation:
    loaded = None if calibration is None else calibration_for(session, load(calibration))
    corrections = None if loaded is None else corrections_of(loaded)
    with progress_bars() as bars:
        certificate = None if loaded is None else certificate_of(loaded, session)
        observed = observe_session(session, without, partial(bars.update, "reading"), corrections, certificate)
        calibrated = calibrate_session(observed) if loaded is None else loaded
        found = characterise_session(session, partial(bars.update, "characterising"))
        predicting = partial(bars.update, "predicting")
        return twin_session(session, observed, calibrated, found, contrast, epsilon, predicting)
