"""What is checked before the first frame of a video: its folder, and its regions."""

from __future__ import annotations

import json
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from ..errors import InputError
from ..sources.video import VideoSource
from .video_configuration import video_configuration
from .video_journal import Row, recorded_head
from .video_pair import require_apart
from .video_reference import ReferenceContrast, make_reference
from .video_settings import VideoSettings

#: Format of the journal, and packages on which results depend to the last bit.
_FORMAT = 1
_PACKAGES = ("labcdp", "numpy", "numba", "scipy", "opencv-contrib-python-headless")


def require_same_evaluation(folders: Iterable[Path], settings: VideoSettings) -> None:
    """Refuse folders for the videos of an archive that hold results of other settings, before any of them is touched.

    Raises
    ------
    InputError
        If one does.
    """
    head = json.loads(json.dumps(evaluation_head(settings, make_reference(settings))))
    for folder in folders:
        recorded = recorded_head(folder)
        if recorded is not None and any(recorded.get(name) != value for name, value in head.items()):
            raise InputError(
                f"{folder} holds the results of another evaluation: give another folder with --output, or remove "
                f"{folder.parent}"
            )


def evaluation_head(settings: VideoSettings, reference: ReferenceContrast | None) -> Row:
    """Return all that decides the results beside the video, as the journal keeps it."""
    return {"format": _FORMAT, "settings": video_configuration(settings, reference), "versions": package_versions()}


def package_versions() -> dict[str, str]:
    """Return the versions of the packages on which results depend to the last bit."""
    return {name: version(name) for name in _PACKAGES}


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
    require_apart(settings.rois, source.shape)
