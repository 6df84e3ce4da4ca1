"""Contrast metrics: arrays of DN or cd/m^2 in, numbers out. Contrast is a fraction (1.0 is 100 %)."""

from .arrays_cdp import cdp
from .contrast import (
    ContrastDefinition,
    DetectionInterval,
    Epsilon,
    contrast_range,
    michelson_contrast,
    weber_contrast,
    weber_contrast_of_means,
)
from .correlated_cdp import cdp_correlated
from .correlation import variance_inflation
from .detection import CalibratedCdp, cdp_range, cdp_with_common_errors
from .distribution import Distribution, Region
from .neighbours.cdp import cdp_neighbours, cdp_neighbours_range, cdp_rectangle
from .result import CdpResult, DetectionProbability, DetectionResult, Interval, NeighbourCdp
from .signal_to_noise import Estimate, cnr, csnr, d_prime, snr, snr_10log10_db, snr_20log10_db
from .spread import ContrastDistribution, contrast_distribution, contrast_histogram, contrast_quantile
from .uncertainty import pixels_needed

__all__ = [
    "CalibratedCdp",
    "CdpResult",
    "ContrastDefinition",
    "ContrastDistribution",
    "DetectionInterval",
    "DetectionProbability",
    "DetectionResult",
    "Distribution",
    "Epsilon",
    "Estimate",
    "Interval",
    "NeighbourCdp",
    "Region",
    "cdp",
    "cdp_correlated",
    "cdp_neighbours",
    "cdp_neighbours_range",
    "cdp_range",
    "cdp_rectangle",
    "cdp_with_common_errors",
    "cnr",
    "contrast_distribution",
    "contrast_histogram",
    "contrast_quantile",
    "contrast_range",
    "csnr",
    "d_prime",
    "michelson_contrast",
    "pixels_needed",
    "snr",
    "snr_10log10_db",
    "snr_20log10_db",
    "variance_inflation",
    "weber_contrast",
    "weber_contrast_of_means",
]
