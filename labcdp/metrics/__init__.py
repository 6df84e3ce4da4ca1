"""Contrast metrics: arrays of DN or cd/m^2 in, numbers out. Contrast is a fraction (1.0 is 100 %)."""

from typing import TYPE_CHECKING, Any

from .contrast import (
    ContrastDefinition,
    DetectionInterval,
    Epsilon,
    weber_contrast,
    weber_contrast_of_means,
)
from .correlation import variance_inflation
from .detection import cdp
from .distribution import Distribution, Region
from .matrix import cdp_matrix
from .neighbours.cdp import cdp_neighbours
from .result import Cdp
from .signal_to_noise import cnr, csnr, d_prime, snr, snr_10log10_db, snr_20log10_db
from .spread import ContrastDistribution, contrast_distribution, contrast_histogram
from .uncertainty import pixels_needed

if TYPE_CHECKING:
    from .colour import ColourSeparation, colour_separation
    from .modulation import Flicker, flicker
    from .ranges import DynamicRange, dynamic_range
    from .slanted_edge import EdgeSfr, Sfr, lens_mtf, mean_sfr, sfr
    from .stray_light import Flare, StrayLight, flare

__all__ = [
    "Cdp",
    "ColourSeparation",
    "ContrastDefinition",
    "ContrastDistribution",
    "DetectionInterval",
    "Distribution",
    "DynamicRange",
    "EdgeSfr",
    "Epsilon",
    "Flare",
    "Flicker",
    "Region",
    "Sfr",
    "StrayLight",
    "cdp",
    "cdp_matrix",
    "cdp_neighbours",
    "cnr",
    "colour_separation",
    "contrast_distribution",
    "contrast_histogram",
    "csnr",
    "d_prime",
    "dynamic_range",
    "flare",
    "flicker",
    "lens_mtf",
    "mean_sfr",
    "pixels_needed",
    "sfr",
    "snr",
    "snr_10log10_db",
    "snr_20log10_db",
    "variance_inflation",
    "weber_contrast",
    "weber_contrast_of_means",
]

#: Modules that evaluations of a pair do not need.
_LAZY = {
    "ColourSeparation": "colour",
    "DynamicRange": "ranges",
    "EdgeSfr": "slanted_edge",
    "Flicker": "modulation",
    "Flare": "stray_light",
    "Sfr": "slanted_edge",
    "StrayLight": "stray_light",
    "colour_separation": "colour",
    "dynamic_range": "ranges",
    "flicker": "modulation",
    "flare": "stray_light",
    "lens_mtf": "slanted_edge",
    "mean_sfr": "slanted_edge",
    "sfr": "slanted_edge",
}


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
