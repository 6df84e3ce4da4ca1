"""Regions of interest: shapes, files, detection, and checks."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .region_file import (
    REGION_SUFFIXES,
    ImageSize,
    load_regions,
    read_region_file,
    require_on_image,
    save_regions,
)
from .shapes import EllipseShape, GridShape, PolygonShape, RectangleShape, Shape, rois_of

if TYPE_CHECKING:
    from .checkerboard import detect_checkerboard
    from .checks import check_region
    from .geometry import inset, require_simple
    from .proposals import new_shapes
    from .step_chart import detect_step_chart

#: What draws and detects regions is imported when it is used: evaluations do not need it.
_MODULES = {
    "check_region": "checks",
    "detect_checkerboard": "checkerboard",
    "detect_step_chart": "step_chart",
    "inset": "geometry",
    "new_shapes": "proposals",
    "require_simple": "geometry",
}

__all__ = [
    "REGION_SUFFIXES",
    "EllipseShape",
    "GridShape",
    "ImageSize",
    "PolygonShape",
    "RectangleShape",
    "Shape",
    "check_region",
    "detect_checkerboard",
    "detect_step_chart",
    "inset",
    "load_regions",
    "new_shapes",
    "read_region_file",
    "require_on_image",
    "require_simple",
    "rois_of",
    "save_regions",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f".{_MODULES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
