"""A frame of a video as the image to draw on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import InputError, LabcdpError
from ...core.result import unique, warning
from ...report.text import finding_text
from .page_image import PageImage

if TYPE_CHECKING:
    from ...core.frame import Frame
    from ...evaluate.picture.conversion import PictureConversion
    from ...files.video.selection import Position
    from ...files.video.source import VideoSource


def is_video(path: Path) -> bool:
    """Whether a path is treated as a video: a folder of images, a session, or a file with a video suffix."""
    from ...files.video.open import VIDEO_SUFFIXES

    return path.is_dir() or path.suffix.lower() in VIDEO_SUFFIXES


def video_image(path: Path, at: Position, conversion: PictureConversion) -> PageImage:
    """Convert a frame of a video as in an evaluation.

    Parameters
    ----------
    path : Path
        Video file, folder of numbered images, or recorded session.
    at : Position
        Which frame; for a time, the first one at or after it.
    conversion : PictureConversion
        Conversion from DN to light, with camera settings missing in the video.

    Raises
    ------
    InputError
        If the video cannot be opened, the frame does not exist or is lost, or a required exposure is unknown.
    CalibrationError
        If the calibration is for another camera.
    """
    from ...evaluate.video.evaluate import conversion_findings, opened_video

    source, conversion = opened_video(path, conversion)
    number, frame = _frame(source, at)
    return PageImage(
        name=f"{path.name or path.resolve().name}, frame {number}",
        values=frame.dn,
        is_dn=True,
        colour_filter=frame.colour_filter,
        light=conversion.convert(frame),
        unit=conversion.unit,
        simulated=frame.camera.simulated,
        findings=unique((*source.findings, *conversion_findings(conversion, source))),
    )


def _frame(source: VideoSource, at: Position) -> tuple[int, Frame]:
    """Return the selected frame and its number."""
    last = -1
    for entry in source.entries():
        last = entry.number
        if not at.reached(entry.number, entry.time_s):
            continue
        fault = entry.fault
        if fault is None:
            try:
                return entry.number, entry.load()
            except LabcdpError as error:
                fault = warning("frame-broken", reason=str(error))
        raise InputError(f"frame {entry.number} of {source.path}: {finding_text(fault)}; choose another with --frame")
    raise InputError(f"{source.path} has {last + 1} frames, 0 to {last}, and none at {at}: choose another with --frame")
