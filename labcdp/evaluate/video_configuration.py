"""What decides the results of a video, and what to mind about its conversion."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..calibration.store import file_sha256
from ..sources.video import VideoSource
from .light import PictureConversion
from .video_reference import ReferenceContrast
from .video_settings import VideoSettings

_RELATIVE = (
    "neither calibration nor camera specification: values are proportional to light, not luminance; contrasts hold as "
    "far as darkness is 0 and the values follow light{}"
)


def conversion_warnings(conversion: PictureConversion, source: VideoSource) -> list[str]:
    """Tell what to mind about the light of a video's frames."""
    if conversion.unit != "relative":
        return []
    hint = ""
    if conversion.options.encoding is None and any("Y'" in note for note in source.notes):
        hint = "; those of most cameras' videos follow the sRGB curve: give --encoding srgb if this one's do"
    return [_RELATIVE.format(hint)]


def video_configuration(settings: VideoSettings, reference: ReferenceContrast | None) -> dict[str, Any]:
    """All that decides the results, as values JSON can hold."""
    epsilon = settings.epsilon
    asked: Any = settings.reference
    if isinstance(asked, Path):
        assert reference is not None
        asked = {"sha256": reference.sha256, "by": settings.reference_by}
    return {
        "contrasts": list(settings.contrasts),
        "rois": [{"name": roi.name, "corners": [list(corner) for corner in roi.corners]} for roi in settings.rois],
        "method": settings.method if settings.rois else None,
        "epsilon": epsilon if isinstance(epsilon, float | int) else asdict(epsilon),
        "reference": asked,
        "selection": settings.selection.to_dict(),
        "calibration_sha256": None if settings.calibration is None else file_sha256(settings.calibration),
        "camera_sha256": None if settings.camera is None else file_sha256(settings.camera),
        "encoding": settings.encoding,
        "exposure_s": settings.exposure_s,
        "gain_db": settings.gain_db,
        "bit_depth": settings.bit_depth,
    }
