"""Command luminance: frames of a calibrated camera as a luminance map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, isclose
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ..calibration.bracket import Bracket, bracket_luminance
from ..calibration.colour.model import AnyCalibration
from ..calibration.record import calibration_sha256, load_any
from ..calibration.uncertainty import expanded_half_width
from ..core.errors import InputError
from ..core.frame import Frame
from ..core.result import Finding, InputFile, NamedValue, Result, quantity_table, unique
from ..evaluate.bench.observe import calibration_for_frames
from ..evaluate.bench.session import mismatch
from ..evaluate.bench.session_result import session_input
from ..evaluate.picture.converter import Converter, calibrated_converter
from ..files import read_picture
from ..files.luminance_file import SUFFIXES, metadata, save_luminance
from ..output import write_file
from ..report.maps import luminance_picture
from ..report.text import exposures
from ..session import Session
from .commands import As
from .options import Force, Temperature, output_file
from .terminal import print_result
from .values import parse_seconds

#: Names of the reasons.
_REASONS = {
    "SATURATED": "saturated",
    "BELOW_BLACK": "below the black",
    "OUTSIDE_CALIBRATED": "outside the calibrated range",
    "DEFECT": "defect",
}


@dataclass(frozen=True)
class _Selected:
    """Frames to convert, with their calibration, names, findings and inputs."""

    calibration: AnyCalibration
    frames: Sequence[Frame]
    names: Sequence[str]
    findings: tuple[Finding, ...]
    inputs: tuple[InputFile, ...]


def _each_in_s(texts: Sequence[str], name: str) -> tuple[float, ...]:
    return tuple(parse_seconds(text, name) for text in texts)


@dataclass(frozen=True)
class ChosenFrames:
    """Options for which frames are converted.

    Parameters
    ----------
    frame
        Number of a frame of the session; may be repeated. Default: all light frames.
    exposure
        Only this exposure, for example 8ms; may be repeated. Default: all.
    patch
        Patch to convert, if the session shows one patch at a time.
    temperature
        Temperature of the camera in degrees Celsius of files that do not state it, for example 31.5. Without it, the
        dark signal is less certain.
    """

    frame: tuple[int, ...] = ()
    exposure: Annotated[tuple[float, ...], As(names=("--only-exposure",), parse=_each_in_s, many=True)] = ()
    patch: str | None = None
    temperature: Temperature | None = None

    def wanted(self, exposure_s: float) -> bool:
        """Whether frames of an exposure are converted; cameras apply an exposure in steps of their own."""
        return not self.exposure or any(isclose(exposure_s, chosen_s, rel_tol=0.01) for chosen_s in self.exposure)


@dataclass(frozen=True)
class WrittenFiles:
    """Options for the files that are written.

    Parameters
    ----------
    output
        File to write: .tif or .exr (float images), or .npz (everything, for labcdp).
    preview
        PNG file for a false-colour picture with a scale.
    """

    output: Annotated[Path, As(names=("--output", "-o"))]
    preview: Path | None = None
    force: Force = False

    def require_writable(self) -> None:
        """Check the files before any work; raises InputError."""
        for path, name, suffixes in ((self.output, "--output", SUFFIXES), (self.preview, "--preview", (".png",))):
            if path is not None:
                if path.suffix.lower() not in suffixes:
                    raise InputError(f"{name} is {path}: give a name that ends in {', '.join(suffixes)}")
                output_file(path, self.force, name)


def luminance(
    chosen: ChosenFrames,
    written: WrittenFiles,
    calibration: Path,
    files: tuple[Path, ...],
) -> None:
    """Convert frames to luminance in cd/m² with its uncertainty.

    All frames must show the same still scene. Several exposures are merged into one map (HDR), with weights for the
    least noise and without saturated pixels. Pixels that differ between the exposures are flagged.

    Parameters
    ----------
    calibration
        Calibration file written by labcdp calibrate.
    files : SESSION | FILE...
        Folder of a recorded session; or frames of one still scene: TIFF files that labcdp recorded, camera RAW, or
        other pictures that state their exposure.
    """
    written.require_writable()
    loaded = load_any(calibration)
    selected = _selected(files, chosen, calibration, loaded)
    result = bracket_luminance(selected.calibration, selected.frames)
    about = {
        "calibration": {
            "file": calibration.name,
            "sha256": calibration_sha256(calibration),
            "camera": str(loaded.state.camera),
            "source_spectrum": loaded.source_spectrum,
            "range_cd_m2": list(loaded.range_cd_m2),
        },
        "frames": list(selected.names),
        "exposures_s": list(result.exposures_s),
        "gain_db": selected.frames[0].gain_db,
        "time": min(frame.timestamp for frame in selected.frames).isoformat(),
    }
    paths, picture = [written.output], b""
    if written.preview is not None:
        title = f"Luminance, {exposures(set(result.exposures_s))}"
        picture = luminance_picture(result.map, title, loaded.state.camera.simulated, loaded.range_cd_m2)
    save_luminance(result.map, written.output, about, force=written.force)
    if written.preview is not None:
        write_file(written.preview, picture, force=written.force)
        paths.append(written.preview)
    shown = _result(result, selected, metadata(result.map, about), calibration, written.output)
    print_result(shown, f"Written: {', '.join(map(str, paths))}")


def _result(
    bracket: Bracket,
    selected: _Selected,
    about: Mapping[str, Any],
    path: Path,
    output: Path,
) -> Result:
    n, calibration = len(selected.frames), selected.calibration
    title = f"Luminance of {n} frame{'s' if n > 1 else ''} at {exposures(set(bracket.exposures_s))}"
    taken, gain_db = [(frame.exposure_s, frame.temperature_c) for frame in selected.frames], selected.frames[0].gain_db
    darks = [plane.setting(gain_db).dark for plane in calibration.planes]
    warmer = [f for dark in darks for f in dark.temperature_findings(taken) + dark.unknown_temperature_findings(taken)]
    return Result(
        "luminance",
        str(output),
        (quantity_table("luminance", title, _quantities(bracket, about)),),
        unique([*selected.findings, *warmer, *bracket.findings]),
        (InputFile.of("calibration", path), *selected.inputs),
        about,
        simulated=calibration.state.camera.simulated,
    )


def _selected(files: Sequence[Path], chosen: ChosenFrames, calibration: Path, loaded: AnyCalibration) -> _Selected:
    folders = [path for path in files if path.is_dir()]
    if folders and len(files) > 1:
        raise InputError(f"{folders[0]} is a folder: give it alone, or give files of frames")
    if folders and chosen.temperature is not None:
        raise InputError("--temperature is of files: frames of a session have theirs; leave it out")
    if folders:
        return _of_session(folders[0], chosen, loaded)
    if chosen.frame or chosen.patch is not None:
        raise InputError("--frame and --patch select frames of a session: give its folder, or leave them out")
    converter = calibrated_converter(loaded, calibration.name).given(temperature_c=chosen.temperature)
    read = [(str(path), *_of_file(path, converter)) for path in files]
    kept = [row for row in read if chosen.wanted(row[1].exposure_s)]
    if not kept:
        there = _in_ms(sorted({frame.exposure_s for _, frame, _ in read}))
        raise InputError(
            f"none of the files has the exposure {_in_ms(chosen.exposure, ' or ')}: the files have {there}"
        )
    names = [name for name, _, _ in kept]
    findings = unique(finding for _, _, of_file in kept for finding in of_file)
    inputs = tuple(InputFile.of("picture", name) for name in names)
    return _Selected(loaded, [frame for _, frame, _ in kept], names, findings, inputs)


def _of_session(path: Path, chosen: ChosenFrames, loaded: AnyCalibration) -> _Selected:
    session = Session.open(path)
    records = session.frames("light")
    if chosen.frame:
        records = [record for record in session.frames() if record.number in chosen.frame]
        missing = sorted(set(chosen.frame) - {record.number for record in records})
        if missing:
            numbers = [record.number for record in session.frames()]
            there = f"{min(numbers)} to {max(numbers)}" if numbers else "none"
            raise InputError(f"the session has no frame {missing[0]}: its frames are {there}")
    if chosen.patch is not None:
        records = [record for record in records if record.patch == chosen.patch]
        if not records:
            raise InputError(f"the session has no frame of patch {chosen.patch!r} alone: leave --patch out")
    kept = [record for record in records if chosen.wanted(record.exposure_s)]
    if not kept:
        raise InputError(
            f"the session has no such frame at {_in_ms(chosen.exposure, ' or ')}: it has "
            f"{_in_ms(sorted({record.exposure_s for record in records}))}"
            if records
            else f"{path} has no light frames: resume the acquisition"
        )
    shown = sorted({str(record.patch) for record in kept})
    if len(shown) > 1:
        raise InputError(
            f"the frames show different patches ({', '.join(shown)}): choose one with --patch, for example --patch "
            f"{shown[0]!r}"
        )
    calibration, of_session = calibration_for_frames(session, loaded)
    return _Selected(
        calibration,
        [session.load(record) for record in kept],
        [record.file.name for record in kept],
        (*mismatch(session.configuration, loaded), *of_session),
        (session_input(session),),
    )


def _of_file(path: Path, converter: Converter) -> tuple[Frame, tuple[Finding, ...]]:
    """Read a frame from a file, and what a user should know about it."""
    picture = read_picture(path, converter.options)
    frame = converter.frame_of(picture)
    if not picture.exposure_known:
        raise InputError(
            f"{path} does not state its exposure time: use frames recorded by labcdp or camera RAW, or labcdp image "
            "--exposure"
        )
    return frame, converter.findings(picture)


def _in_ms(exposures_s: Iterable[float], between: str = ", ") -> str:
    return between.join(f"{1e3 * exposure_s:g}ms" for exposure_s in exposures_s)


def _expanded(u_rel: float | None) -> float | None:
    """U (95 %) of a standard uncertainty of many parts."""
    return None if u_rel is None else expanded_half_width(0.0, u_rel)


def _quantities(result: Bracket, values: Mapping[str, Any]) -> list[NamedValue]:
    seen = result.map
    lit = seen.luminance_cd_m2[seen.valid]
    n_used, counts = np.unique(result.n_used, return_counts=True)
    random_rel, common_rel = values["median_random_rel"], values["median_common_rel"]
    u_rel, middle = hypot(random_rel or 0.0, common_rel or 0.0), float(np.median(lit)) if lit.size else None
    n_pixels, invalid, shares = seen.valid.size, values["invalid_share"], "share of the pixels"
    return [
        NamedValue("mean", float(lit.mean(dtype=float)) if lit.size else None, "cd/m²", "of the valid pixels"),
        NamedValue("lowest", float(lit.min()) if lit.size else None, "cd/m²", "of the valid pixels"),
        NamedValue("highest", float(lit.max()) if lit.size else None, "cd/m²", "of the valid pixels"),
        NamedValue(
            "a pixel", middle, "cd/m²", "median of the valid pixels", None if middle is None else middle * u_rel
        ),
        NamedValue("U of a pixel, independent", _expanded(random_rel), "%", "median of the valid pixels"),
        NamedValue("U of a pixel, common", _expanded(common_rel), "%", "median; the same error in all pixels"),
        NamedValue("valid pixels", float(seen.valid.mean()), "%", shares),
        *(NamedValue(text, invalid[name], "%", shares) for name, text in _REASONS.items() if name in invalid),
        *(
            NamedValue(f"pixels from {n} frames", count / n_pixels, "%", shares)
            for n, count in zip(n_used.tolist(), counts.tolist(), strict=True)
        ),
        NamedValue("inconsistent pixels", result.inconsistent_share, "%", "different between the exposures"),
    ]
