"""Commands compare and history: results of one kind side by side, and calibrations of cameras over time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..calibration import AnyCalibration, load_any
from ..calibration.record import CALIBRATION, MOST_BYTES, VERIFICATION, load_verification
from ..calibration.verify.history import histories
from ..calibration.verify.result import Verification
from ..core.disk import file_sha256, read_json, real_path
from ..core.errors import InputError
from ..core.result import InputFile
from ..evaluate.bench.history import history_files, history_result
from ..evaluate.compare.compare import LUMINANCES, Question, compare_subjects
from ..evaluate.compare.page import comparison_files
from ..evaluate.compare.result import compare_result
from ..evaluate.compare.subject import picture_settings
from ..evaluate.picture.settings import ImageSettings
from ..evaluate.requirement import Requirement
from .options import Changes, Contrasts, Results, Tolerance, end_by_requirement, one_or_all, require_apart
from .pictures.options import PictureLightOptions
from .simulation import Axes
from .terminal import progress_bar, say

#: Prefixes of labcdp's own file names, to recognise damaged files.
_OUR_NAMES = ("calibration", "verification")
_BROKEN = "broken"


@dataclass(frozen=True)
class QuestionOptions:
    """Options for what chains are asked.

    Parameters
    ----------
    over
        For chains: parameter and its values, as for labcdp sweep; may be repeated; default:
        scene.luminance_cd_m2=0.001:100000:121:log.
    contrast
        For chains and pictures: target contrasts: 100%, a list such as 50%,100%, or a range START:STOP:COUNT[:log]
        such as 10%:200%:20. May be repeated; default: contrast of each scene, measured contrast of each pair.
    epsilon
        For chains and pictures: relative tolerance of the contrast; default: 50%.
    roi
        For pictures: region file, .json from labcdp rois, or .roi or .zip from ImageJ.
    changes
        For chains: set a parameter in all of them, for example scene.contrast=30%; may be repeated.
    require
        For chains: TOML file with a requirement that each is judged by, instead of --over, --contrast and --epsilon.
    """

    over: Axes = ()
    contrast: Contrasts = None
    epsilon: Tolerance | None = None
    roi: Path | None = None
    changes: Changes = ()
    require: Path | None = None

    def chosen(self, light: PictureLightOptions) -> Question | ImageSettings | None:
        """Return what chains or, with regions, pictures are asked; None without an option for either.

        Raises
        ------
        InputError
            If there are options for chains beside regions, or options for pictures without.
        """
        given = {"--over": self.over or None, "--contrast": self.contrast, "--epsilon": self.epsilon, "--roi": self.roi}
        require_apart({"--require": self.require}, given)
        epsilon = 0.5 if self.epsilon is None else self.epsilon
        if self.roi is not None:
            if self.over or self.changes:
                raise InputError("--over and --set are options for chains, --roi is one for pictures: leave one out")
            return picture_settings(self.roi, light.converter(), light.inputs(), self.contrast, epsilon)
        of_light = [f"--{name.replace('_', '-')}" for name, value in vars(light).items() if value not in (None, False)]
        if of_light:
            raise InputError(f"{of_light[0]} is an option for pictures: give their regions with --roi, too")
        if self.require is not None:
            return Question.by(Requirement.load(self.require), dict(self.changes))
        if not (self.over or self.changes or (self.contrast, self.epsilon) != (None, None)):
            return None
        return Question(self.over or (LUMINANCES,), dict(self.changes), one_or_all(self.contrast), epsilon)


def compare(
    question: QuestionOptions,
    light: PictureLightOptions,
    results: Results,
    subjects: tuple[str, ...],
) -> None:
    """Compare chains, sessions, calibrations, characterisations, pictures or sweeps, side by side on one page.

    Chains are predicted without random numbers: CDP over the luminance, usable range and difference. Sessions are
    evaluated with their own calibrations, pictures as in labcdp image. Everything else is compared by its results:
    values with U, z and significance; common errors of a meter or calibration are not counted as independent.
    With --require, the exit status is 3 if a chain does not meet the requirement, 4 if it is undecided for one.

    Example: labcdp compare manta-g505 my-chain.toml --set scene.contrast=50%

    Parameters
    ----------
    subjects : A B...
        Chains (presets or files), maps of sweeps, sessions, calibrations, pictures (with --roi), or results of labcdp
        evaluate, image or characterise; files or folders of results. Each is compared with the first. A chain may be
        alone with --require.
    """
    chosen = question.chosen(light)
    with results.folder(subjects[0]) as folder:
        with progress_bar("Cells") as report:
            found = compare_subjects(subjects, chosen, report)
        result = compare_result(found)
        folder.add(comparison_files(found, result))
    results.show(result, folder)
    end_by_requirement({one.name: one.verdict for one in found.judged})


def history(results: Results, paths: tuple[Path, ...]) -> None:
    """List how responsivity, dark signal and gain change between calibrations.

    Each camera, lens, f-number and gain has its own table and plot. Writes a page, a spreadsheet and pictures.

    Parameters
    ----------
    paths : FOLDER_OR_FILE...
        Calibration and verification files, or folders to search for them.
    """
    with results.folder(paths[0]) as folder:
        calibrations, verifications = _read(paths)
        found = histories(calibrations, verifications)
        inputs = [InputFile.of("calibration", path) for path in calibrations]
        inputs += [InputFile.of("verification", path) for path in verifications]
        result = history_result(found, inputs)
        folder.add(history_files(found, result))
    results.show(result, folder)


def _read(paths: Sequence[Path]) -> tuple[dict[str, AnyCalibration], dict[str, Verification]]:
    calibrations: dict[str, AnyCalibration] = {}
    verifications: dict[str, Verification] = {}
    named = {real_path(path) for path in paths}
    read: dict[str, Path] = {}
    for path in _files(paths):
        try:
            same = read.setdefault(file_sha256(path, "a calibration"), path)
            if same is not path:
                say(f"Left out: {path} is a copy of {same}")
                continue
            if _format(path) == VERIFICATION:
                verifications[str(path)] = load_verification(path)
            else:
                calibrations[str(path)] = load_any(path)
        except InputError as error:
            if real_path(path) in named:
                raise
            say(f"Left out: {error}")
    if not calibrations and not verifications:
        raise InputError("none of the files can be read: give files or folders of calibrations")
    return calibrations, verifications


def _files(paths: Sequence[Path]) -> Iterable[Path]:
    """Files that were named, and those found in folders, each once."""
    files: dict[Path, Path] = {}
    for path in paths:
        found = [path]
        if path.is_dir():
            found = [p for p in sorted(path.rglob("*.json")) if _format(p) in (CALIBRATION, VERIFICATION, _BROKEN)]
            if not found:
                raise InputError(f"{path} contains no calibration: give a folder with results of labcdp calibrate")
        files |= {real_path(one): one for one in found}
    return files.values()


def _format(path: Path) -> object:
    """Return the format of a JSON file; None if labcdp did not write it."""
    try:
        document = read_json(path, "a calibration", MOST_BYTES)
    except InputError:
        return _BROKEN if path.stem.startswith(_OUR_NAMES) else None
    return document.get("format") if isinstance(document, dict) else None
