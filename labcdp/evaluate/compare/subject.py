"""Subjects of a comparison: chains, maps of sweeps, calibrations and results, recognised by their files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from ...calibration import AnyCalibration, Calibration, ColourCalibration, load_any
from ...chain import Chain, preset_names, preset_text
from ...core.disk import parse_toml, read_json, shortened
from ...core.disk.files import SESSION_JOURNAL
from ...core.errors import InputError
from ...core.result import InputFile
from ...regions import read_region_file, rois_of
from ...report.files import SCHEMA, envelope, read_dataset
from ...session import Session
from ..bench.quantities import conditions
from ..bench.session import evaluate_session, observe_calibrated
from ..bench.session_result import session_result
from ..picture.converter import Converter
from ..picture.result import evaluate_picture, image_result
from ..picture.settings import ImageSettings
from ..sweep.maps.axes import check_map
from ..sweep.run import map_title

#: Kinds by the command whose results they are; the file next to results.json that holds them, if not that itself.
_OF_COMMAND = {
    "evaluate": ("session", ""),
    "demo": ("session", ""),
    "image": ("picture", ""),
    "characterise": ("characterisation", ""),
    "calibrate": ("calibration", "calibration.json"),
    "sweep": ("sweep", "map.nc"),
    "simulate": ("chain", "chain.toml"),
}
#: Settings of each picture, stated by its file or usual for its kind of file.
_OF_PICTURE = ("exposure_s", "encoding")
#: Suffixes of files that are no pictures.
_SUFFIXES = (".json", ".nc", ".toml")
_HINT = "give chains, maps of sweeps, sessions, calibrations, or the results of labcdp evaluate, image or characterise"


@dataclass(frozen=True, eq=False)
class Subject:
    """One of the things that are compared.

    Parameters
    ----------
    kind : str
        ``chain``, ``sweep``, ``session``, ``calibration``, ``characterisation`` or ``picture``.
    name : str
        Name in tables and figures.
    content : Chain, Dataset, Calibration or dict
        Its content; of session, characterisation and picture that of results.json.
    inputs : tuple of InputFile
        Its files.
    settings : mapping
        Settings it was made with, as nested values.
    simulated : bool
        Whether its data is simulated.
    """

    kind: str
    name: str
    content: Any
    inputs: tuple[InputFile, ...]
    settings: Mapping[str, Any]
    simulated: bool


def read_subjects(
    sources: Sequence[Any], pictures: ImageSettings | None = None, fewest: int = 2
) -> tuple[Subject, ...]:
    """Recognise and read what is compared.

    Parameters
    ----------
    sources : sequence
        Each a path or name of a preset, or a `Chain`, map, session, calibration or result. Results of several pictures
        are as many subjects.
    pictures : ImageSettings or None
        Settings of the evaluation of pictures.
    fewest : int
        Number of subjects that are needed: one that is judged by a requirement needs no other.

    Raises
    ------
    InputError
        If one cannot be read or is nothing that can be compared, if they are of different kinds, or too few.
    """
    # What takes long, once it is known that all can be compared.
    later = {number: kind for number, source in enumerate(sources) if (kind := _evaluated_kind(source, pictures))}
    read = {number: _read(source, pictures) for number, source in enumerate(sources) if number not in later}
    known: list[tuple[str, str]] = []
    for number, source in enumerate(sources):
        named = [(subject.kind, subject.name) for subject in read.get(number, ())]
        known += [(later[number], str(source))] if number in later else named
    kinds = dict(reversed(known))
    if len(kinds) > 1:
        (kind, a), (other_kind, b), *_ = reversed(kinds.items())
        raise InputError(f"{a} is a {kind}, but {b} is a {other_kind}: give several of the same kind")
    if len(known) < fewest:
        raise InputError("there is nothing to compare with: give at least two")
    read |= {number: _read(sources[number], pictures) for number in later}
    subjects = [subject for number in range(len(sources)) for subject in read[number]]
    return tuple(replace(subject, name=name) for subject, name in zip(subjects, _names(subjects), strict=True))


def _evaluated_kind(source: Any, pictures: ImageSettings | None) -> str:
    """Return the kind of a session or picture, which is evaluated before it is compared; empty for anything else."""
    if isinstance(source, Session) or (isinstance(source, str | Path) and (Path(source) / SESSION_JOURNAL).is_file()):
        return "session"
    if not isinstance(source, str | Path) or Path(source).suffix.lower() in _SUFFIXES or not Path(source).is_file():
        return ""
    if pictures is None:
        raise InputError(f"{source} is compared as a picture: give its regions, or {_HINT.removeprefix('give ')}")
    return "picture"


def _names(subjects: Sequence[Subject]) -> list[str]:
    """Last parts of the names, whole names where those are equal, and numbers where these are, too."""
    last = [Path(subject.name).name or subject.name for subject in subjects]
    names = last if len(set(last)) == len(last) else [subject.name for subject in subjects]
    return [f"{name} ({names[: n + 1].count(name)})" if names.count(name) > 1 else name for n, name in enumerate(names)]


def _map_name(attributes: Mapping[Any, Any]) -> str:
    """Return the title that somebody gave to a map, else the name of its chain."""
    name, title = attributes.get("chain_name", "map"), attributes.get("title", "map")
    return str(name if title == map_title(name, attributes.get("stage")) else title)


def _read(source: Any, pictures: ImageSettings | None) -> list[Subject]:
    if isinstance(source, str | Path):
        if Path(source).suffix.lower() not in _SUFFIXES and Path(source).is_file():
            assert pictures is not None
            return _picture(Path(source), pictures)
        return _file(str(source), Path(source))
    if isinstance(source, Chain):
        return [_chain(source.name or "chain", source, ())]
    if isinstance(source, Session):
        return _session(str(source.path.name), source)
    if hasattr(source, "data_vars"):
        return [_map(_map_name(source.attrs), source, ())]
    if isinstance(source, Calibration | ColourCalibration):
        return [_calibration("calibration", source, ())]
    if hasattr(source, "to_dict"):
        content = source.to_dict()
        return _results(str(content.get("title", "results")), Path(), content, ())
    raise InputError(f"{type(source).__name__} cannot be compared: {_HINT}")


def _file(text: str, path: Path) -> list[Subject]:
    if not path.exists() and text in preset_names():
        digest = sha256(preset_text(text).encode()).hexdigest()
        return [_chain(text, Chain.load(text), (InputFile("preset", text, digest),))]
    if not path.exists():
        raise InputError(f"{text} does not exist: {_HINT}")
    if (path / SESSION_JOURNAL).is_file():
        with Session.open(path) as session:
            return _session(text.rstrip("/"), session)
    results = path / "results.json"
    # Of files with a name that labcdp gives, the folder says more.
    is_default_name = path.name in ("results.json", "calibration.json", "map.nc", "chain.toml") and path.parent.name
    name = str(path.parent) if is_default_name else text.rstrip("/")
    match path.suffix.lower():
        case _ if results.is_file():
            return _document(name, results)
        case ".json":
            return _document(name, path)
        case ".nc":
            return [_map(name, read_dataset(path, "map"), (InputFile.of("map", path),))]
        case ".toml":
            return [_chain(name, Chain.load(path), (InputFile.of("chain", path),))]
    raise InputError(f"{text} cannot be compared: {_HINT}")


def _picture(path: Path, settings: ImageSettings) -> list[Subject]:
    """Evaluate a picture, as `labcdp image` does."""
    picture, _, _ = evaluate_picture(settings, path, pages=False, surface=False)
    result = image_result([picture], settings)
    return _results(str(path), path, envelope(result), result.inputs)


def _document(name: str, path: Path) -> list[Subject]:
    content = read_json(path, "results or a calibration of labcdp")
    if isinstance(content, dict) and content.get("format") == "labcdp-calibration":
        return [_calibration(name, load_any(path), (InputFile.of("calibration", path),))]
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError(f"{path} holds no results of labcdp: {_HINT}")
    return _results(name, path, content, (InputFile.of("results", path),))


def _results(name: str, path: Path, content: dict[str, Any], inputs: tuple[InputFile, ...]) -> list[Subject]:
    command = str(content.get("kind"))
    if command not in _OF_COMMAND:
        raise InputError(f"{name} holds results of labcdp {shortened(command)}, which cannot be compared: {_HINT}")
    kind, file = _OF_COMMAND[command]
    if file:
        return _file(str(path.parent / file), path.parent / file)
    try:
        settings, simulated = dict(content["configuration"]), bool(content["simulated"])
        if kind != "picture":
            return [Subject(kind, name, content, inputs, settings, simulated)]
        rows = content["tables"]["pictures"]["rows"]
        names = [str(row["picture"]) for row in rows] if len(rows) > 1 else [name]
        settings_of_rows = [settings | {key: row[key] for key in _OF_PICTURE if key in row} for row in rows]
        return [
            Subject(kind, row_name, {**content, "number": number}, inputs, settings, simulated)
            for number, (row_name, settings) in enumerate(zip(names, settings_of_rows, strict=True), start=1)
        ]
    except (LookupError, TypeError, ValueError, AttributeError):
        raise InputError(damaged(name)) from None


def damaged(name: str) -> str:
    """Return the error for results in which values of their command are missing."""
    return f"the results {name} are damaged or were written by another version of labcdp: evaluate again"


def _session(name: str, session: Session) -> list[Subject]:
    """Evaluate a session with its own calibration."""
    result = session_result(evaluate_session(*observe_calibrated(session)))
    return _results(name, session.path, envelope(result), result.inputs)


def _chain(name: str, chain: Chain, inputs: tuple[InputFile, ...]) -> Subject:
    return Subject("chain", name, chain, inputs, chain.document, True)


def _map(name: str, dataset: Any, inputs: tuple[InputFile, ...]) -> Subject:
    check_map(dataset)
    text = str(dataset.attrs.get("chain", ""))
    request = {key: dataset.attrs[key] for key in ("contrast", "epsilon", "stage", "method") if key in dataset.attrs}
    return Subject("sweep", name, dataset, inputs, {**request, **parse_toml(text)}, True)


def _calibration(name: str, calibration: AnyCalibration, inputs: tuple[InputFile, ...]) -> Subject:
    return Subject(
        "calibration", name, calibration, inputs, dict(conditions(calibration)), calibration.state.camera.simulated
    )


def picture_settings(
    regions: Path,
    converter: Converter,
    inputs: Sequence[InputFile],
    contrasts: tuple[float, ...] | None = None,
    epsilon: float = 0.5,
) -> ImageSettings:
    """Return the settings for pictures of one region file; the other parameters are those of `ImageSettings`."""
    shapes, image_size, file = read_region_file(regions)
    return ImageSettings(
        contrasts, epsilon, rois_of(shapes), converter=converter, image_size=image_size, inputs=(file, *inputs)
    )
