"""What is checked before the first frame of a video: its folder, and its regions."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ...calibration.record import calibration_sha256
from ...core.disk.journal import Row, recorded_head
from ...core.errors import InputError
from ...core.result import Finding, InputFile, info, warning
from ...files.video.open import open_video
from ...files.video.source import VideoSource
from ...metrics.pair import require_apart
from ..picture.conversion import Calibrated, PictureConversion
from .settings import ReferenceContrast, VideoSettings, make_reference

#: Name of the journal in the folder of the results.
JOURNAL = "video.jsonl"
#: Format of the journal, and packages on which results depend to the last bit.
_FORMAT = 2
_PACKAGES = ("labcdp", "numpy", "numba", "scipy", "av", "opencv-contrib-python-headless")


def require_same_evaluation(folders: Iterable[Path], settings: VideoSettings) -> None:
    """Refuse folders for the videos of an archive that hold results of other settings, before any of them is touched.

    Raises
    ------
    InputError
        If one does.
    """
    head = json.loads(json.dumps(evaluation_head(settings, make_reference(settings))))
    for folder in folders:
        recorded = recorded_head(folder / JOURNAL)
        if recorded is not None and any(recorded.get(name) != value for name, value in head.items()):
            raise InputError(
                f"{folder} holds the results of another evaluation: give another folder with --output, or remove "
                f"{folder.parent}"
            )


def evaluation_head(settings: VideoSettings, reference: ReferenceContrast | None) -> Row:
    """Return all inputs of the results other than the video, as in the journal."""
    return {"format": _FORMAT, "settings": video_configuration(settings, reference), "versions": package_versions()}


def package_versions() -> dict[str, str]:
    """Return the versions of the packages on which results depend to the last bit."""
    return {name: version(name) for name in _PACKAGES}


def opened_video(path: Path, conversion: PictureConversion) -> tuple[VideoSource, PictureConversion]:
    """Open a video, with the conversion of its frames.

    Raises
    ------
    InputError
        If it cannot be opened, or does not state an exposure that is needed.
    """
    source = open_video(path, conversion.options)
    if conversion.unit == "cd/m^2" and conversion.options.exposure_s is None and not source.exposure_stated:
        raise InputError(f"{path} does not state its exposure time: give it with --exposure")
    return source, replace(conversion, options=replace(conversion.options, encoding=source.encoding))


def require_regions(source: VideoSource, settings: VideoSettings) -> None:
    """Refuse regions that cannot be those of any frame, before the first one."""
    if not settings.rois:
        return
    height, width = source.shape
    drawn_on = settings.image_size
    if drawn_on is not None and drawn_on != (width, height):
        raise InputError(
            f"the regions belong to an image of {drawn_on[0]} x {drawn_on[1]} pixels, {source.path} has {width} x "
            f"{height}: draw them in its first frame"
        )
    first, second = ((roi, roi.window(source.shape), roi.mask(source.shape)) for roi in settings.rois)
    require_apart(first, second)


def conversion_findings(conversion: PictureConversion, source: VideoSource) -> tuple[Finding, ...]:
    """Return what there is to know about the luminance of a video's frames."""
    found = [info("relative-luminance")] if conversion.unit == "relative" else []
    if source.encoding != "linear" or any(one.code == "srgb-colour-to-grey" for one in source.findings):
        calibrated = isinstance(conversion, Calibrated)
        found.append(warning("srgb-taken-as-dn" if calibrated else "srgb-assumed"))
    return tuple(found)


def video_configuration(settings: VideoSettings, reference: ReferenceContrast | None) -> dict[str, Any]:
    """All that decides the results, as values JSON can hold."""
    epsilon = settings.epsilon
    asked: Any = settings.reference
    if isinstance(asked, Path):
        assert reference is not None
        asked = {"sha256": reference.sha256, "by": settings.reference_by}
    return {
        "contrasts": None if settings.contrasts is None else list(settings.contrasts),
        "rois": [{"name": roi.name, "corners": [list(corner) for corner in roi.corners]} for roi in settings.rois],
        "method": settings.method if settings.rois else None,
        "epsilon": epsilon if isinstance(epsilon, float | int) else asdict(epsilon),
        "reference": asked,
        "selection": settings.selection.to_dict(),
        "calibration_sha256": None if settings.calibration is None else calibration_sha256(settings.calibration),
        "camera_sha256": None if settings.camera is None else InputFile.of("camera", settings.camera).sha256,
        "encoding": settings.encoding,
        "exposure_s": settings.exposure_s,
        "gain_db": settings.gain_db,
        "bit_depth": settings.bit_depth,
        "damaged": settings.damaged,
    }
