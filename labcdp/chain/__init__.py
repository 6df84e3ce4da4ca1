"""The imaging chain, simulated: scene, windscreen, optics, sensor, HDR merge and tone curve, each with its inverse."""

from .camera_model import CameraModel
from .capture import Capture, SensorModel
from .chain import Chain, ChainRun
from .exposure import ExposureSettings
from .file.registry import register
from .hdr.exposures import Hdr
from .imaging import ImagingChain
from .isp import ToneCurve
from .optics import Optics
from .presets import preset_names, preset_text
from .scene.checkerboard import Checkerboard
from .scene.flat import Flat, Level, PatchScene, Scene, StepChart
from .scene.image import ImageScene
from .scene.patches import Patch, luminance_map, with_patches
from .sensor.emva import Sensor
from .sensor.thesis import ThesisSensor
from .signal import Context, Signal, Stage
from .windscreen import ThesisWindscreen, Windscreen

register("scene", Flat, "flat")
register("scene", Checkerboard, "checkerboard")
register("scene", StepChart, "step-chart")
register("scene", PatchScene, "patches")
register("scene", ImageScene, "image")
register("windscreen", Windscreen)
register("windscreen", ThesisWindscreen, "thesis-2018")
register("optics", Optics)
register("sensor", Sensor, "emva1288")
register("sensor", ThesisSensor, "thesis-2018")
register("isp", ToneCurve)

__all__ = [
    "CameraModel",
    "Capture",
    "Chain",
    "ChainRun",
    "Checkerboard",
    "Context",
    "ExposureSettings",
    "Flat",
    "Hdr",
    "ImageScene",
    "ImagingChain",
    "Level",
    "Optics",
    "Patch",
    "PatchScene",
    "Scene",
    "Sensor",
    "SensorModel",
    "Signal",
    "Stage",
    "StepChart",
    "ThesisSensor",
    "ThesisWindscreen",
    "ToneCurve",
    "Windscreen",
    "luminance_map",
    "preset_names",
    "preset_text",
    "register",
    "with_patches",
]
