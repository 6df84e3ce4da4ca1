"""Images, camera RAW files and raw dumps as frames or as floats."""

from .frame import IMAGE_SUFFIXES, FileFrame, frame_of_pixels, read_image
from .picture import Picture
from .raw import read_raw
from .read import PictureOptions, picture_paths, read_picture

__all__ = [
    "IMAGE_SUFFIXES",
    "FileFrame",
    "Picture",
    "PictureOptions",
    "frame_of_pixels",
    "picture_paths",
    "read_image",
    "read_picture",
    "read_raw",
]
