"""Contrast metrics: arrays of DN or cd/m^2 in, numbers out. Contrast is a fraction (1.0 is 100 %)."""

from .detection import CdpResult, cdp
from .distribution import Distribution, Region
from .spread import ContrastDistribution, contrast_distribution
from .weber import weber_contrast, weber_contrast_of_means

__all__ = [
    "CdpResult",
    "ContrastDistribution",
    "Distribution",
    "Region",
    "cdp",
    "contrast_distribution",
    "weber_contrast",
    "weber_contrast_of_means",
]
