"""Images, camera RAW files and raw dumps as frames or as floats."""

from .file_frame import FileDefaults, FileFrame
from .formats.raw import read_raw
from .image_file import IMAGE_SUFFIXES, read_image
from .picture.picture import Picture
from .picture.read import PictureOptions, frame_of_pixels, picture_paths, read_picture

__all__ = [
    "IMAGE_SUFFIXES",
    "FileDefaults",
    "FileFrame",
    "Picture",
    "PictureOptions",
    "frame_of_pixels",
    "picture_paths",
    "read_image",
    "read_picture",
    "read_raw",
]
