"""What decides the results of a video, and findings about its conversion."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...calibration.record.store import file_sha256
from ...core.finding import Finding, info, warning
from ...core.result import InputFile
from ...files.video.source import VideoSource
from ..picture.light.converters import Calibrated
from ..picture.light.picture import PictureConversion
from .reference import ReferenceContrast
from .settings import VideoSettings


def conversion_findings(conversion: PictureConversion, source: VideoSource) -> tuple[Finding, ...]:
    """Return what there is to know about the luminance of a video's frames."""
    found = [info("relative-luminance")] if conversion.unit == "relative" else []
    if source.encoding != "linear" or any(one.code == "srgb-colour-to-grey" for one in source.findings):
        calibrated = isinstance(conversion.converter, Calibrated)
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
        "calibration_sha256": None if settings.calibration is None else file_sha256(settings.calibration),
        "camera_sha256": None if settings.camera is None else InputFile.of("camera", settings.camera).sha256,
        "encoding": settings.encoding,
        "exposure_s": settings.exposure_s,
        "gain_db": settings.gain_db,
        "bit_depth": settings.bit_depth,
        "damaged": settings.damaged,
    }
