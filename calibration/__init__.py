"""Calibration: from DN to cd/m^2, by a luminance meter, with uncertainty.

`observe_dark` and `observe_patches` measure the frames, `fit` joins them with the meter's readings, `save` and `load`
keep the result. `Calibration.to_luminance` converts frames; `patch_luminance` gives one patch with its 95 % interval.
"""

from .calibrate import fit
from .colour import ColourCalibration
from .colour_conversion import colour_patch_luminance
from .colour_fit import fit_colour
from .common_errors import common_errors
from .dark import DarkModel
from .gains import GainSetting
from .model import Calibration, PatchResidual, ResponsivityFit
from .noise import TemporalNoise
from .observations import CameraState, DarkObservation, PatchObservation
from .observe import observe_dark, observe_patches
from .patch import PatchLuminance, contrast_uncertainty, patch_luminance
from .readings import MeterScale
from .response_curve import ResponseCurve, response_from_bracket
from .setup import LensIdentity, Provenance, Setup
from .store import AnyCalibration, load, load_any, save
from .uncertainty import coverage_probability, expanded_half_width

__all__ = [
    "AnyCalibration",
    "Calibration",
    "CameraState",
    "ColourCalibration",
    "DarkModel",
    "DarkObservation",
    "GainSetting",
    "LensIdentity",
    "MeterScale",
    "PatchLuminance",
    "PatchObservation",
    "PatchResidual",
    "Provenance",
    "ResponseCurve",
    "ResponsivityFit",
    "Setup",
    "TemporalNoise",
    "colour_patch_luminance",
    "common_errors",
    "contrast_uncertainty",
    "coverage_probability",
    "expanded_half_width",
    "fit",
    "fit_colour",
    "load",
    "load_any",
    "observe_dark",
    "observe_patches",
    "patch_luminance",
    "response_from_bracket",
    "save",
]
