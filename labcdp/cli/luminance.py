"""Command luminance: frames of a calibrated camera as a luminance map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ..errors import InputError
from .picture_options import seconds
from .terminal import JSON_OPTION, print_json, say

if TYPE_CHECKING:
    from ..calibration.bracket import Bracket
    from ..calibration.store import AnyCalibration
    from ..evaluate.light import PictureConversion
    from ..frame import Frame
    from ..session import FrameRecord, Session

#: What the reasons are called for a person.
_REASONS = {
    "SATURATED": "saturated",
    "BELOW_BLACK": "below the black",
    "OUTSIDE_CALIBRATED": "outside the calibrated range",
    "DEFECT": "defect",
    "INCONSISTENT": "different between the exposures",
}


@dataclass(frozen=True)
class _Selected:
    """Frames to convert, and what is known about them beside."""

    frames: Sequence[Frame]
    names: Sequence[str]
    warnings: tuple[str, ...]


def luminance(
    calibration: Path = typer.Argument(help="Calibration file, as labcdp calibrate saved it."),
    files: list[Path] = typer.Argument(
        metavar="SESSION | FILE...",
        help="Folder of a recorded session; or frames of one still scene: TIFF files that labcdp recorded, camera RAW, "
        "or other pictures that say their exposure.",
    ),
    output: Path = typer.Option(
        ..., "--output", "-o", help="File to write: .tif or .exr (float images), or .npz (everything, for labcdp)."
    ),
    frame: list[int] = typer.Option(
        [], "--frame", help="Number of a frame of the session; may be given several times. Default: all light frames."
    ),
    exposure: list[str] = typer.Option(
        [], "--exposure", help="Only this exposure, for example 8ms; may be given several times. Default: all."
    ),
    patch: str | None = typer.Option(None, help="Of a session with patches one by one: the patch that was shown."),
    preview: Path | None = typer.Option(None, help="PNG file for a picture in false colours with a scale."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Convert frames to luminance in cd/m^2 with its uncertainty.

    All chosen frames are taken as one still scene: several exposures are joined to one map (HDR), for each pixel with
    the weights that leave the least noise and without saturated pixels. What moved in between is flagged.
    """
    from ..calibration.bracket import bracket_luminance
    from ..calibration.store import file_sha256, load_any
    from ..sources.luminance_file import SUFFIXES, metadata, save_luminance

    if output.suffix.lower() not in SUFFIXES:
        raise InputError(f"--output {output} has no known end: give a name that ends in {', '.join(SUFFIXES)}")
    loaded = load_any(calibration)
    selected = _selected(files, frame, exposure, patch, calibration, loaded)
    result = bracket_luminance(loaded, selected.frames)
    warnings = [*selected.warnings, *_temperature_warnings(loaded, selected.frames)]
    about = {
        "calibration": {
            "file": calibration.name,
            "sha256": file_sha256(calibration),
            "camera": str(loaded.state.camera),
            "source_spectrum": loaded.source_spectrum,
            "range_cd_m2": list(loaded.range_cd_m2),
        },
        "frames": list(selected.names),
        "exposures_s": list(result.exposures_s),
        "gain_db": selected.frames[0].gain_db,
        "time": min(one.timestamp for one in selected.frames).isoformat(),
    }
    save_luminance(result.map, output, about)
    written = [output]
    if preview is not None:
        written.append(_preview(result, preview, selected, loaded.state.camera.simulated))
    values = {**metadata(result.map, about), **_statistics(result), "warnings": [*warnings, *result.warnings]}
    if as_json:
        print_json({"written": [str(path) for path in written], **values})
    else:
        _show(values)
        say(f"Written: {', '.join(str(path) for path in written)}")


def _temperature_warnings(loaded: AnyCalibration, frames: Sequence[Frame]) -> list[str]:
    from ..calibration import Calibration

    planes = (loaded,) if isinstance(loaded, Calibration) else loaded.planes
    darks = [plane.setting(frames[0].gain_db).dark for plane in planes]
    taken = [(one.exposure_s, one.temperature_c) for one in frames]
    return list(dict.fromkeys(warning for dark in darks for warning in dark.temperature_warnings(taken)))


def _selected(
    files: Sequence[Path],
    numbers: Sequence[int],
    exposures: Sequence[str],
    patch: str | None,
    calibration: Path,
    loaded: AnyCalibration,
) -> _Selected:
    folders = [path for path in files if path.is_dir()]
    if folders and len(files) > 1:
        raise InputError(f"{folders[0]} is a folder and not alone: give one session, or files of frames")
    if folders:
        return _of_session(folders[0], numbers, exposures, patch, loaded)
    if numbers or patch is not None:
        raise InputError("--frame and --patch choose among the frames of a session: give its folder, or leave them out")
    from ..evaluate.light import calibrated_conversion

    conversion = calibrated_conversion(loaded, calibration.name)
    read = [(str(path), *_of_file(path, conversion)) for path in files]
    kept = [one for one in read if _wanted(one[1].exposure_s, exposures)]
    if not kept:
        there = _exposures([frame for _, frame, _ in read])
        raise InputError(f"no file has the exposure {' or '.join(exposures)}: {there} are there")
    warnings = dict.fromkeys(warning for _, _, found in kept for warning in found)
    return _Selected([frame for _, frame, _ in kept], [name for name, _, _ in kept], tuple(warnings))


def _of_session(
    path: Path, numbers: Sequence[int], exposures: Sequence[str], patch: str | None, loaded: AnyCalibration
) -> _Selected:
    from ..evaluate.session import mismatch
    from ..session import Session

    session = Session.open(path)
    records = session.frames("light")
    if numbers:
        records = [record for record in session.frames() if record.number in numbers]
        missing = sorted(set(numbers) - {record.number for record in records})
        if missing:
            raise InputError(f"the session has no frame {missing[0]}: its frames are {_numbers(session)}")
    if patch is not None:
        records = [record for record in records if record.patch == patch]
        if not records:
            raise InputError(f"the session has no frame of patch {patch!r} alone: leave --patch out")
    chosen = [record for record in records if _wanted(record.exposure_s, exposures)]
    if not chosen:
        raise InputError(
            f"the session has no such frame at {' or '.join(exposures)}: it has {_exposures(records)}"
            if records
            else f"{path} has no light frames: go on with the acquisition"
        )
    shown = sorted({str(record.patch) for record in chosen})
    if len(shown) > 1:
        raise InputError(
            f"the frames show different patches ({', '.join(shown)}): choose one with --patch, for example --patch "
            f"{shown[0]!r}"
        )
    return _Selected(
        [session.load(record) for record in chosen],
        [record.file.name for record in chosen],
        tuple(mismatch(session.configuration, loaded)),
    )


def _of_file(path: Path, conversion: PictureConversion) -> tuple[Frame, tuple[str, ...]]:
    """Read a frame from a file, and what to mind about it."""
    from ..sources import read_picture

    picture = read_picture(path, conversion.options)
    frame = conversion.frame_of(picture)
    if not picture.exposure_known:
        raise InputError(
            f"{path} does not say its exposure time: give frames that labcdp recorded or camera RAW, or this picture "
            "alone to labcdp image --exposure"
        )
    return frame, conversion.warnings(picture)


def _wanted(exposure_s: float, exposures: Sequence[str]) -> bool:
    # Cameras apply an exposure in steps of their own.
    return not exposures or any(isclose(exposure_s, seconds(text, "--exposure"), rel_tol=0.01) for text in exposures)


def _exposures(frames: Sequence[Frame] | Sequence[FrameRecord]) -> str:
    return ", ".join(f"{1e3 * t:g}ms" for t in sorted({one.exposure_s for one in frames}))


def _numbers(session: Session) -> str:
    numbers = [record.number for record in session.frames()]
    return f"{min(numbers)} to {max(numbers)}" if numbers else "none"


def _statistics(result: Bracket) -> dict[str, Any]:
    import numpy as np

    seen = result.map
    values = seen.luminance_cd_m2[seen.valid]
    n_used, counts = np.unique(result.n_used, return_counts=True)
    return {
        "mean_cd_m2": float(values.mean(dtype=float)) if values.size else None,
        "min_cd_m2": float(values.min()) if values.size else None,
        "max_cd_m2": float(values.max()) if values.size else None,
        "valid_share": float(seen.valid.mean()),
        "share_by_frames_used": {str(n): float(c / seen.valid.size) for n, c in zip(n_used, counts, strict=True)},
        "inconsistent_share": result.inconsistent_share,
    }


def _preview(result: Bracket, path: Path, selected: _Selected, simulated: bool) -> Path:
    from ..report.luminance_picture import luminance_picture
    from ..session.files import write_whole

    if path.suffix.lower() != ".png":
        raise InputError(f"--preview is {path}: give a name that ends in .png")
    title = "Luminance, " + ", ".join(f"{1e3 * t:g} ms" for t in sorted(set(result.exposures_s)))
    try:
        write_whole(path.parent, path.name, luminance_picture(result.map, title, simulated))
    except OSError as error:
        raise InputError(f"--preview {path} cannot be written ({error.strerror or error}): give another") from error
    return path


def _show(values: dict[str, Any]) -> None:
    from ..report.digits import share_percent

    frames = values["frames"]
    exposures = ", ".join(f"{1e3 * t:g} ms" for t in sorted(set(values["exposures_s"])))
    say(f"{len(frames)} frame{'s' if len(frames) > 1 else ''} at {exposures}")
    if values["mean_cd_m2"] is None:
        say("No pixel is valid")
    else:
        say(
            f"Luminance of the valid pixels: {values['min_cd_m2']:.4g} to {values['max_cd_m2']:.4g} cd/m^2, mean "
            f"{values['mean_cd_m2']:.4g} cd/m^2"
        )
        say(
            f"Standard uncertainty of a pixel (median): random {values['median_random_rel']:.2%}, common to all pixels "
            f"{values['median_common_rel']:.2%}"
        )
    reasons = ", ".join(f"{share_percent(share)} {_REASONS[name]}" for name, share in values["invalid_share"].items())
    say(f"{share_percent(values['valid_share'])} of the pixels are valid" + (f"; {reasons}" if reasons else ""))
    for warning in values["warnings"]:
        say(f"Warning: {warning}")
