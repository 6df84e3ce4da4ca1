"""What is checked before the first frame of a video: its folder, and its regions."""

from __future__ import annotations

import json
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from ...core.disk.journal import Row, recorded_head
from ...core.errors import InputError
from ...files.video.source import VideoSource
from ...metrics.regions.pair import require_apart
from .configuration import video_configuration
from .reference import ReferenceContrast, make_reference
from .settings import VideoSettings

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
