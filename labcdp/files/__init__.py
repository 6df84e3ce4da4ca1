"""Images, camera RAW files and raw dumps as frames or as floats."""

from .frame import IMAGE_SUFFIXES as IMAGE_SUFFIXES
from .frame import FileFrame as FileFrame
from .frame import frame_of_pixels as frame_of_pixels
from .frame import read_image as read_image
from .picture import Picture as Picture
from .raw import read_raw as read_raw
from .read import PictureOptions as PictureOptions
from .read import picture_paths as picture_paths
from .read import read_picture as read_picture
