"""A frame of a video as the image to draw on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, LabcdpError
from .page_image import PageImage

if TYPE_CHECKING:
    from ..evaluate.light import PictureConversion
    from ..frame import Frame
    from ..sources.picture import PictureOptions
    from ..sources.video import VideoSource
    from ..sources.video_selection import Position


def is_video(path: Path) -> bool:
    """Whether a path is taken for a video: a folder, of images or a session, or a file with a video's ending."""
    from ..sources.video import VIDEO_SUFFIXES

    return path.is_dir() or path.suffix.lower() in VIDEO_SUFFIXES


def video_image(path: Path, at: Position, conversion: PictureConversion, options: PictureOptions) -> PageImage:
    """Convert a frame of a video, as it is evaluated.

    Parameters
    ----------
    path : Path
        Video file, folder of numbered images, or recorded session.
    at : Position
        Which frame; of a time, the first one at it or after it.
    conversion : PictureConversion
        From DN to light.
    options : PictureOptions
        What the video does not say.

    Raises
    ------
    InputError
        If the video cannot be opened, has no such frame, or that is lost; if it does not say its exposure where that
        is needed.
    CalibrationError
        If it is not of the camera the calibration is for.
    """
    from ..evaluate.video_configuration import conversion_warnings
    from ..sources.video import open_video

    source = open_video(path, options)
    if conversion.unit == "cd/m^2" and options.exposure_s is None and not source.exposure_stated:
        raise InputError(f"{path} does not say its exposure time: give it with --exposure")
    number, frame = _frame(source, at)
    return PageImage(
        name=f"{path.name or path.resolve().name}, frame {number}",
        values=frame.dn,
        is_dn=True,
        colour_filter=frame.colour_filter,
        luminance=conversion.convert(frame),
        unit=conversion.unit,
        warnings=tuple(dict.fromkeys((*source.notes, *source.warnings, *conversion_warnings(conversion, source)))),
    )


def _frame(source: VideoSource, at: Position) -> tuple[int, Frame]:
    """Return the frame at a place, and its number."""
    last = -1
    for entry in source.entries():
        last = entry.number
        if not at.reached(entry.number, entry.time_s):
            continue
        fault = entry.fault
        if not fault:
            try:
                return entry.number, entry.load()
            except LabcdpError as error:
                fault = f"is broken: {error}"
        raise InputError(f"frame {entry.number} of {source.path} {fault}: choose another with --frame")
    raise InputError(f"{source.path} has {last + 1} frames, 0 to {last}, and none at {at}: choose another with --frame")
