"""Regions of interest: shapes, files, detection, and checks."""

from .checkerboard import detect_checkerboard
from .checks import check_region
from .geometry import inset, require_simple
from .proposals import new_shapes
from .region_file import (
    REGION_SUFFIXES,
    ImageSize,
    load_regions,
    read_region_file,
    require_on_image,
    save_regions,
)
from .shapes import EllipseShape, GridShape, PolygonShape, RectangleShape, Shape, rois_of
from .step_chart import detect_step_chart

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
