"""The imaging chain, simulated: scene, windscreen, optics, sensor, HDR merge and tone curve, each with its inverse."""

from .chain import Chain as Chain
from .chain import ChainRun as ChainRun
from .hdr import Hdr as Hdr
from .imaging import ImagingChain as ImagingChain
from .isp import ToneCurve as ToneCurve
from .optics import Optics as Optics
from .optics import Windscreen as Windscreen
from .predict.camera import CameraModel as CameraModel
from .registry import preset_names as preset_names
from .registry import preset_text as preset_text
from .registry import register as register
from .scene.charts import Checkerboard as Checkerboard
from .scene.charts import StepChart as StepChart
from .scene.image import ImageScene as ImageScene
from .scene.scene import Flat as Flat
from .scene.scene import Level as Level
from .scene.scene import Patch as Patch
from .scene.scene import PatchScene as PatchScene
from .scene.scene import Scene as Scene
from .scene.scene import luminance_map as luminance_map
from .scene.scene import with_patches as with_patches
from .sensor import Sensor as Sensor
from .signal import Capture as Capture
from .signal import Context as Context
from .signal import ExposureSettings as ExposureSettings
from .signal import SensorModel as SensorModel
from .signal import Signal as Signal
from .signal import Stage as Stage
from .thesis import ThesisSensor as ThesisSensor
from .thesis import ThesisWindscreen as ThesisWindscreen

register("scene", Flat, "flat")
register("scene", Checkerboard, "checkerboard")
register("scene", StepChart, "step-chart")
register("scene", PatchScene, "patches")
register("scene", ImageScene, "image")
register("windscreen", Windscreen)
register("windscreen", ThesisWindscreen, "thesis-2018")
register("optics", Optics)
register("exposure", ExposureSettings)
register("sensor", Sensor, "emva1288")
register("sensor", ThesisSensor, "thesis-2018")
register("hdr", Hdr)
register("isp", ToneCurve)
