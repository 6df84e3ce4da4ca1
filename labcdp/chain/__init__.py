"""The imaging chain, simulated: scene, windscreen, optics and sensor, each with its inverse."""

from .imaging import ImagingChain as ImagingChain
from .optics import Optics as Optics
from .presets import manta_g505 as manta_g505
from .scene import Patch as Patch
from .scene import PatchScene as PatchScene
from .scene import luminance_map as luminance_map
from .scene import with_patches as with_patches
from .sensor import Sensor as Sensor
from .windscreen import Windscreen as Windscreen
