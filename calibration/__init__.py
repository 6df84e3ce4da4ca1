"""Calibration: conversion from DN to cd/m^2 with uncertainty, against a luminance meter.

`observe_dark` and `observe_patches` measure the frames, `fit` combines them with the meter's readings, `save` and
`load` keep the result. `Calibration.to_luminance` converts frames; `patch_luminance` gives one patch with its 95 %
interval.
"""

from .camera import common_errors
from .colour.conversion import colour_patch_luminance
from .colour.fit import fit_colour
from .colour.model import AnyCalibration, ColourCalibration
from .convert.patch import PatchLuminance, contrast_U, contrast_u, patch_luminance
from .fit_camera import fit
from .fit_records import ResponsivityFit
from .frames.observations import CameraState, DarkObservation, PatchObservation
from .frames.observe import observe_dark, observe_patches
from .model import Calibration, PatchResidual
from .record import load, load_any, save
from .sensor.dark import DarkModel
from .sensor.noise import GainSetting, TemporalNoise
from .sensor.response import ResponseCurve, response_from_bracket
from .setup import LensIdentity, MeterScale, Provenance, Setup
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
    "contrast_U",
    "contrast_u",
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
