"""Regions of a picture: CDP of their pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.luminance import LuminanceMap
from ..core.result import Finding
from ..core.roi import Roi, regions_table
from ..metrics import Epsilon
from ..metrics.pair import PairResult, RegionResult, evaluate_pair
from .arguments import Contrasts, as_contrasts
from .variables import OF_CDP, cdp_values, columns, described

if TYPE_CHECKING:
    from xarray import Dataset

_OF_PAIR = ("measured_contrast", "u_measured_contrast", "csnr", "u_csnr")
_OF_REGION = ("mean", "u_mean", "std", "snr", "u_snr", "pixels", "saturated")


@dataclass(frozen=True, eq=False, repr=False)
class ImageRegions:
    """Regions of a picture; made by `Image.regions`.

    Parameters
    ----------
    name : str
        Name of the picture.
    luminance : LuminanceMap
        Its luminance.
    attributes : callable
        Makes the attributes of a dataset of tolerance and findings.
    rois : tuple of Roi
        The regions.
    pairs : tuple of (str, str)
        Names of the pairs that are evaluated.
    """

    name: str
    luminance: LuminanceMap
    attributes: Callable[[Epsilon, Sequence[Finding]], dict[str, Any]]
    rois: tuple[Roi, ...]
    pairs: tuple[tuple[str, str], ...]

    def cdp(self, contrasts: Contrasts | None = None, epsilon: Epsilon = 0.5) -> Dataset:
        """Compute the contrast detection probability of each pair.

        Parameters
        ----------
        contrasts : float or array_like of float or None
            Contrasts to be detected, fractions (1.0 is 100 %); None for the measured contrast of each pair.
        epsilon : float or DetectionInterval
            Their relative tolerance.

        Returns
        -------
        xarray.Dataset
            CDP with its 95 % interval and standard uncertainty over pair and contrast; measured contrast and CSNR
            over pair; mean and SNR over pair and side (bright, dark). Without the dimension of contrasts for a number
            or None; with None `contrast` is a coordinate of the pairs.

        Raises
        ------
        InputError
            If an argument cannot be used, or regions overlap or hold no light.
        """
        import xarray as xr

        asked = as_contrasts(contrasts, epsilon)
        rois = {roi.name: roi for roi in self.rois}
        found = [evaluate_pair(self.luminance, rois[a], rois[b], asked.values, epsilon) for a, b in self.pairs]
        sides = [(pair.bright_region, pair.dark_region) for pair in found]
        names = [[region.roi.name for region in pair] for pair in sides]
        of_contrasts = [
            [cdp_values(one.result, one.standard_uncertainty, one.confidence_interval) for one in pair.results] or [{}]
            for pair in found
        ]
        data = {
            **columns(("pair", "contrast"), of_contrasts, OF_CDP),
            **columns(("pair",), [_of_pair(pair) for pair in found], _OF_PAIR),
            **columns(("pair", "side"), [[_of_region(one) for one in pair] for pair in sides], _OF_REGION),
        }
        coordinates = {
            "pair": [f"{bright} / {dark}" for bright, dark in names],
            "side": ["bright", "dark"],
            "region": (("pair", "side"), names),
        }
        attributes = self.attributes(epsilon, [one for pair in found for one in pair.findings])
        dataset = xr.Dataset(data, coordinates, attributes)
        if asked.values is None:
            measured = dataset["measured_contrast"].values
            dataset = dataset.isel(contrast=0).assign_coords(contrast=("pair", measured))
        else:
            dataset = dataset.assign_coords(contrast=np.array(asked.values))
        return described(dataset.isel(contrast=0) if asked.scalar else dataset, attributes["unit"])

    def __repr__(self) -> str:
        return f"<labcdp.ImageRegions of {self.name}: regions: {len(self.rois)}, pairs: {len(self.pairs)}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return regions_table(self.rois, self.name)


def _of_pair(pair: PairResult) -> dict[str, float]:
    values = (pair.contrast.value, pair.contrast.standard_error, pair.csnr.value, pair.csnr.standard_error)
    return dict(zip(_OF_PAIR, values, strict=True))


def _of_region(region: RegionResult) -> dict[str, float]:
    saturated = region.invalid_shares.get("saturated", 0.0)
    ratio = (region.snr.value, region.snr.standard_error)
    values = (region.mean, region.standard_uncertainty, region.std, *ratio, region.n_pixels, saturated)
    return dict(zip(_OF_REGION, values, strict=True))
