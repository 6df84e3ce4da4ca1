"""The imaging chain, simulated: scene, windscreen, optics, sensor, HDR merge and tone curve, each with its inverse."""

from .captures import CaptureSettings, ColourPlane, Photodiode
from .chain import Chain, ChainRun
from .hdr import Hdr
from .imaging import ImagingChain
from .isp import PiecewiseLinear, ToneCurve
from .lamp import CaptureTime, PredictedFlicker, PulsedLamp
from .optics import Optics, Windscreen
from .predict.camera import CameraModel
from .registry import preset_names, preset_text, register
from .scene.charts import Checkerboard, StepChart
from .scene.image import ImageScene
from .scene.lamp import LampScene
from .scene.scene import Flat, Level, Patch, PatchScene, Scene, luminance_map, with_patches
from .scene.spectra import RegionSpectrum
from .sensor import Sensor
from .signal import Capture, Context, ExposureSettings, SensorModel, Signal, Stage
from .thesis import ThesisSensor, ThesisWindscreen

register("scene", Flat, "flat")
register("scene", Checkerboard, "checkerboard")
register("scene", StepChart, "step-chart")
register("scene", PatchScene, "patches")
register("scene", ImageScene, "image")
register("scene", LampScene, "lamp")
register("windscreen", Windscreen)
register("windscreen", ThesisWindscreen, "thesis-2018")
register("optics", Optics)
register("exposure", ExposureSettings)
register("sensor", Sensor, "emva1288")
register("sensor", ThesisSensor, "thesis-2018")
register("hdr", Hdr)
register("isp", ToneCurve)
register("isp", PiecewiseLinear, "pwl")

__all__ = [
    "CameraModel",
    "Capture",
    "CaptureSettings",
    "CaptureTime",
    "Chain",
    "ChainRun",
    "Checkerboard",
    "ColourPlane",
    "Context",
    "ExposureSettings",
    "Flat",
    "Hdr",
    "ImageScene",
    "ImagingChain",
    "LampScene",
    "Level",
    "Optics",
    "Patch",
    "PatchScene",
    "Photodiode",
    "PiecewiseLinear",
    "PredictedFlicker",
    "PulsedLamp",
    "RegionSpectrum",
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
