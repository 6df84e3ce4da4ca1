"""Calibration: from DN to cd/m^2, by a luminance meter, with uncertainty.

`observe_dark` and `observe_patches` measure the frames, `fit` joins them with the meter's readings, `save` and `load`
keep the result. `Calibration.to_luminance` converts frames; `patch_luminance` gives one patch with its 95 % interval.
"""

from .calibrate import fit
from .dark import DarkModel
from .model import (
    Calibration,
    LensIdentity,
    PatchResidual,
    Provenance,
    ResponsivityFit,
    Setup,
)
from .noise import TemporalNoise
from .observations import CameraState, DarkObservation, PatchObservation, observe_dark, observe_patches
from .patch import PatchLuminance, patch_luminance
from .readings import MeterScale
from .store import load, save
from .uncertainty import coverage_probability, expanded_half_width

__all__ = [
    "Calibration",
    "CameraState",
    "DarkModel",
    "DarkObservation",
    "LensIdentity",
    "MeterScale",
    "PatchLuminance",
    "PatchObservation",
    "PatchResidual",
    "Provenance",
    "ResponsivityFit",
    "Setup",
    "TemporalNoise",
    "coverage_probability",
    "expanded_half_width",
    "fit",
    "load",
    "observe_dark",
    "observe_patches",
    "patch_luminance",
    "save",
]
