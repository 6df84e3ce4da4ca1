"""Regions of interest: shapes, files, detection, and checks."""

from .boards.checkerboard import detect_checkerboard
from .boards.step_chart import detect_step_chart
from .checks import check_region
from .coincidence import new_shapes
from .geometry import inset, require_simple
from .region_file import REGION_SUFFIXES, image_size_of, load_regions, save_regions
from .region_json import ImageSize
from .shapes import EllipseShape, GridShape, PolygonShape, RectangleShape, Shape, rois_of

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
    "image_size_of",
    "inset",
    "load_regions",
    "new_shapes",
    "require_simple",
    "rois_of",
    "save_regions",
]
