"""Commands characterise, twin and verify: a camera after EMVA 1288, its simulated twin, its calibration checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from ..acquire.verify_plan import verification_configuration
from ..calibration import AnyCalibration, Calibration, load, load_any
from ..calibration.emva.data_set import characterise_data_set
from ..calibration.emva.index import INDEX_NAME, index_path
from ..calibration.emva.result import Characterisation
from ..calibration.record import SavedFile, save_verification
from ..calibration.verify.result import require_tolerance
from ..core.disk.files import shell_word
from ..core.errors import InputError
from ..core.result import InputFile
from ..evaluate.bench.certificate import verification_certificate
from ..evaluate.bench.session import mismatch, observe_calibrated
from ..evaluate.bench.session_result import session_input
from ..evaluate.bench.verification import verification_result, verify_session
from ..evaluate.camera.characterise import characterise_camera, characterise_session
from ..evaluate.camera.general import GeneralCharacterisation, general_files, general_result
from ..evaluate.camera.result import characterisation_files
from ..evaluate.camera.result import result as characterisation_result
from ..evaluate.twin.estimate import require_monochrome
from ..evaluate.twin.evaluate import TwinEvaluation, twin_session
from ..evaluate.twin.result import twin_files, twin_result
from ..metrics.contrast import TargetContrasts
from ..report.files import envelope_json
from ..session import MeterCertificate, Session, SessionConfiguration
from .bench.acquire import record
from .bench.options import DeviceOptions
from .commands import As
from .options import Certificate, Contrasts, Results, Tolerance, Without, one_or_all
from .terminal import progress_bar, progress_bars, say
from .values import fraction_of_percent


def characterise(results: Results, path: Path) -> None:
    """Measure a camera's gain, noise, dark current, non-uniformity and linearity after EMVA 1288.

    Of cameras with companded data or more than 16 bits, whose values are merged of captures, the characteristic curve,
    noise and SNR at the input after EMVA 1288 General.

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
    with results.folder(source) as folder:
        characterised, inputs, title = _characterised(path)
        if isinstance(characterised, GeneralCharacterisation):
            result = general_result(characterised, title, inputs)
            folder.add(general_files(characterised, result))
        else:
            result = characterisation_result(characterised, title, inputs)
            folder.add(characterisation_files(characterised, result))
    results.show(result, folder)


def _characterised(path: Path) -> tuple[Characterisation | GeneralCharacterisation, list[InputFile], str]:
    """Return what was found, what it was made from, and its title."""
    index = index_path(path)
    with progress_bar("Reading") as report:
        if index is not None:
            return characterise_data_set(index, report), [InputFile.of("index", index)], index.resolve().parent.name
        if not (path / "session.toml").exists():
            raise InputError(f"{path} contains neither a session nor {INDEX_NAME}: give a session or a data set")
        with Session.open(path) as session:
            return characterise_camera(session, report), [session_input(session)], session.configuration.name


def twin(
    results: Results,
    session: Path,
    *,
    calibration: Path | None = None,
    without: Without = (),
    contrast: Contrasts = None,
    epsilon: Tolerance = 0.5,
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
        Target contrasts in all pairs: 100%, a list such as 50%,100%, or a range START:STOP:COUNT[:log] such as
        10%:200%:20. May be repeated; default: contrast of each pair by the meter.
    """
    inputs = [] if calibration is None else [InputFile.of("calibration", calibration)]
    opened = Session.open(session)
    require_monochrome(opened)
    with results.folder(session) as folder:
        targets = one_or_all(contrast)
        evaluation = _twin(opened, calibration, without, targets, epsilon)
        options = {"contrast": targets, "epsilon": epsilon, "without": without}
        result = twin_result(evaluation, [session_input(opened), *inputs], options)
        folder.add(twin_files(evaluation, result))
    results.show(result, folder)
    say(f"Next: labcdp simulate {shell_word(folder.folder / 'chain.toml')}")


def _twin(
    session: Session, calibration: Path | None, without: Sequence[str], contrast: TargetContrasts, epsilon: float
) -> TwinEvaluation:
    loaded = None if calibration is None else load(calibration)
    with progress_bars() as bars:
        observed, calibrated = observe_calibrated(
            session, loaded, without, partial(bars.set, "reading"), beside=calibration
        )
        characterised = characterise_session(session, partial(bars.set, "characterising"))
        return twin_session(observed, calibrated, characterised, contrast, epsilon, partial(bars.set, "predicting"))


#: Exit status by verdict.
EXIT_STATUS = {"conform": 0, "not conform": 3, "undecided": 4}


def _tolerance(text: str, name: str) -> float:
    return require_tolerance(fraction_of_percent(text, name))


@dataclass(frozen=True)
class JudgementOptions:
    """Options for what is measured and when it conforms.

    Parameters
    ----------
    patch
        Patch to measure; may be repeated. Default: darkest, middle and brightest (grey ones, with colour filters); all
        patches of a recorded session.
    tolerance
        Largest conforming deviation of the camera from the meter, for example 3%; default: U (95 %).
    """

    patch: tuple[str, ...] = ()
    tolerance: Annotated[float | None, As(parse=_tolerance)] = None
    certificate: Certificate = None


def verify(
    judgement: JudgementOptions,
    devices: DeviceOptions,
    results: Results,
    calibration: Path,
    paths: tuple[Path, ...],
) -> None:
    """Check a calibration by measuring two or three patches again.

    A patch conforms if its deviation plus the uncertainty U of the deviation is within the tolerance, does not conform
    if the deviation exceeds the tolerance by more than U, and is undecided otherwise. Exit status: 0 conform, 3 not
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
            "device options cannot be used with a recorded session: leave them out, or also give a configuration"
        )
    with results.folder(session) as folder:
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
        file = SavedFile.of(calibration)
        verification = replace(verification, calibration_number=file.number)
        save_verification(verification, folder.path(path.name))
        inputs = (session_input(measured), InputFile.of("calibration", calibration))
        result = verification_result(verification, session.resolve().name, inputs)
        files = SavedFile.of(folder.path(path.name)), file
        certified = verification_certificate(observed, loaded, verification, *files)
        folder.add({"certificate.html": certified, "results.json": envelope_json(result).encode()})
    following = []
    if verification.verdict == "not conform":
        history = f"labcdp history {shell_word(path.parent)}"
        following.append(f"Next: labcdp acquire and labcdp calibrate, then {history}")
    results.show(result, folder, "certificate.html", *following)
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
            "the simulated camera has no colour filters, but the calibrated one has: measure with that camera, or "
            "import its pictures and give only that session's folder"
        )
    # Refused before anything is measured; the findings include a warning.
    mismatch(bench, calibration)
    wanted = verification_configuration(bench, calibration, patches)
    say(f"Measuring {', '.join(p.name for p in wanted.target.patches)} again")
    record(session, configuration, wanted, devices)
