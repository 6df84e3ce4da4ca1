"""Commands characterise and twin: a camera after EMVA 1288, and its simulated twin."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from shlex import quote

import typer

from ...calibration import load
from ...calibration.emva import INDEX_NAME, Characterisation, characterise_data_set, index_path
from ...core.errors import InputError
from ...core.result import InputFile
from ...evaluate.bench.calibrate import calibrate_session
from ...evaluate.bench.corrections import calibration_for, corrections_of
from ...evaluate.bench.observe import observe_session
from ...evaluate.bench.recorded import certificate_of
from ...evaluate.bench.session_result import session_input
from ...evaluate.camera.characterise import characterise_session
from ...evaluate.camera.result import result as characterisation_result
from ...evaluate.camera.result import write_characterisation
from ...evaluate.twin.estimate import require_monochrome
from ...evaluate.twin.evaluate import TwinEvaluation, twin_session
from ...evaluate.twin.page import write_twin
from ...evaluate.twin.result import twin_result
from ...session import Session
from ..options import Percent, Results, Without
from ..terminal import progress_bar, progress_bars, say


def characterise(context: typer.Context, results: Results, path: Path) -> None:
    """Measure a camera's gain, noise, dark current, non-uniformity and linearity after EMVA 1288.

    Uses the dark frames and patches of a session, or an EMVA 1288 data set: images and a text file whose lines state
    bits and size (n 12 640 480), exposure in ns and photons per pixel (b 40000 120), exposure of dark images (d 40000)
    and image files (i a.png).

    Parameters
    ----------
    path
        Folder of a recorded session, or text file or folder of an EMVA 1288 data set.
    """
    if not path.exists():
        raise InputError(f"{path} does not exist: give a session, or the index of a data set")
    source = path if path.is_dir() else path.resolve().parent
    with results.folder(context, source) as folder:
        characterised, inputs, title = _characterised(path)
        found = characterisation_result(characterised, title, inputs)
        write_characterisation(characterised, found, folder)
    results.show(found, folder)


def _characterised(path: Path) -> tuple[Characterisation, list[InputFile], str]:
    """Return what was found, what it was made from, and its title."""
    index = index_path(path)
    with progress_bar("Reading") as report:
        if index is not None:
            found = characterise_data_set(index, report)
            return found, [InputFile.of("index", index)], index.resolve().parent.name
        if not (path / "session.toml").exists():
            raise InputError(f"{path} contains neither a session nor {INDEX_NAME}: give a session or a data set")
        with Session.open(path) as session:
            found = characterise_session(session, report)
            return found, [session_input(session)], session.configuration.name


def twin(
    context: typer.Context,
    results: Results,
    session: Path,
    *,
    calibration: Path | None = None,
    without: Without = (),
    contrast: Percent | None = None,
    epsilon: Percent = 0.5,
) -> None:
    """Estimate a simulated twin of a session's camera and compare its CDP with the measured CDP.

    Estimates the camera's parameters, predicts frames and CDP of all pairs of patches from the meter readings, and
    lists for each pair whether prediction and measurement agree and which parameter matters. Writes chain.toml (for
    labcdp simulate), report.html, results.xlsx and results.json.

    Parameters
    ----------
    session
        Folder of the session.
    calibration
        Calibration file of this camera; default: calibrate with this session.
    contrast
        Contrast to detect in all pairs, for example 100%; default: contrast of each pair by the meter.
    epsilon
        Relative tolerance of the contrast.
    """
    inputs = [] if calibration is None else [InputFile.of("calibration", calibration)]
    opened = Session.open(session)
    require_monochrome(opened)
    with results.folder(context, session) as folder:
        evaluation = _twin(opened, calibration, without, contrast, epsilon)
        options = {"contrast": contrast, "epsilon": epsilon, "without": without}
        result = twin_result(evaluation, [session_input(opened), *inputs], options)
        write_twin(evaluation, result, folder)
    results.show(result, folder)
    say(f"Next: labcdp simulate {quote(str(folder.folder / 'chain.toml'))}")


def _twin(
    session: Session, calibration: Path | None, without: Sequence[str], contrast: float | None, epsilon: float
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
