"""Regions of interest: shapes, files, detection, and checks."""

from .checkerboard import detect_checkerboard as detect_checkerboard
from .checks import check_region as check_region
from .geometry import inset as inset
from .geometry import require_simple as require_simple
from .proposals import new_shapes as new_shapes
from .region_file import REGION_SUFFIXES as REGION_SUFFIXES
from .region_file import ImageSize as ImageSize
from .region_file import image_size_of as image_size_of
from .region_file import load_regions as load_regions
from .region_file import save_regions as save_regions
from .shapes import EllipseShape as EllipseShape
from .shapes import GridShape as GridShape
from .shapes import PolygonShape as PolygonShape
from .shapes import RectangleShape as RectangleShape
from .shapes import Shape as Shape
from .shapes import rois_of as rois_of
from .step_chart import detect_step_chart as detect_step_chart
