"""Images, camera RAW files and raw dumps as frames or as floats."""

from .file_frame import IMAGE_SUFFIXES, FileDefaults, FileFrame, read_image
from .picture.picture import Picture
from .picture.read import PictureOptions, frame_of_pixels, picture_paths, read_picture
from .raw import read_raw

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
