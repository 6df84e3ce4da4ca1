"""Images, camera RAW files and raw dumps as frames or as floats."""

from .file_frame import FileDefaults, FileFrame
from .image_file import IMAGE_SUFFIXES, read_image
from .picture import Picture, PictureOptions, frame_of_pixels, picture_paths, read_picture
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
