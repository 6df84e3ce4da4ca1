"""Contrast metrics: arrays of DN or cd/m^2 in, numbers out. Contrast is a fraction (1.0 is 100 %)."""

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
from .dynamic_range import DynamicRange, dynamic_range
from .matrix import cdp_matrix
from .neighbours.cdp import cdp_neighbours
from .result import Cdp
from .signal_to_noise import cnr, csnr, d_prime, snr, snr_10log10_db, snr_20log10_db
from .spread import ContrastDistribution, contrast_distribution, contrast_histogram
from .uncertainty import pixels_needed

__all__ = [
    "Cdp",
    "ContrastDefinition",
    "ContrastDistribution",
    "DetectionInterval",
    "Distribution",
    "DynamicRange",
    "Epsilon",
    "Region",
    "cdp",
    "cdp_matrix",
    "cdp_neighbours",
    "cnr",
    "contrast_distribution",
    "contrast_histogram",
    "csnr",
    "d_prime",
    "dynamic_range",
    "pixels_needed",
    "snr",
    "snr_10log10_db",
    "snr_20log10_db",
    "variance_inflation",
    "weber_contrast",
    "weber_contrast_of_means",
]
