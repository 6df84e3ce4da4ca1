"""Images, camera RAW files and raw dumps as frames or as floats."""

from typing import TYPE_CHECKING, Any

from ..core.companding import Companding, shipped_curve, shipped_curves
from .frame import DUMP_SUFFIXES, IMAGE_SUFFIXES, FileFrame, frame_of_pixels, read_image
from .picture import Picture, PictureOptions
from .read import picture_paths, read_picture

if TYPE_CHECKING:
    from ..session.tables import load_curve
    from .raw import read_raw

__all__ = [
    "DUMP_SUFFIXES",
    "IMAGE_SUFFIXES",
    "Companding",
    "FileFrame",
    "Picture",
    "PictureOptions",
    "frame_of_pixels",
    "load_curve",
    "picture_paths",
    "read_image",
    "read_picture",
    "read_raw",
    "shipped_curve",
    "shipped_curves",
]


def __getattr__(name: str) -> Any:
    # Readers that most pictures do not need are imported when they are used.
    if name == "read_raw":
        from .raw import read_raw

        return read_raw
    if name == "load_curve":
        from ..session.tables import load_curve

        return load_curve
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
