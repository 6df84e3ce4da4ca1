"""Images and camera RAW files as frames."""

from .file_frame import FileDefaults, FileFrame
from .image_file import IMAGE_SUFFIXES, read_image
from .raw import read_raw

__all__ = ["IMAGE_SUFFIXES", "FileDefaults", "FileFrame", "read_image", "read_raw"]
