"""Regions of a picture: CDP of their pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from xarray import Dataset

from ..core.errors import InputError
from ..core.luminance import LuminanceMap
from ..core.result import Finding
from ..core.roi import Roi, regions_table
from ..metrics import Epsilon
from ..metrics.pair import evaluate_pair
from .arguments import Contrasts, Tolerance, as_contrasts
from .variables import at_contrasts, cdp_variables, described, pair_variables

if TYPE_CHECKING:
    from ..evaluate.colour.measure import Colours


@dataclass(frozen=True, eq=False, repr=False)
class ImageRegions:
    """Regions of a picture; made by `Image.regions`.

    Parameters
    ----------
    name : str
        Name of the picture.
    luminance : LuminanceMap
        Its luminance.
    unit : str
        Unit of that.
    attributes : callable
        Makes the attributes of a dataset of tolerance, findings and pairs.
    rois : tuple of Roi
        The regions.
    pairs : tuple of (str, str)
        Names of the pairs that are evaluated.
    colours : callable
        Makes the colours of the picture.
    """

    name: str
    luminance: LuminanceMap
    unit: str
    attributes: Callable[[Epsilon, Sequence[Finding], Sequence[tuple[Roi, Roi]]], dict[str, Any]]
    rois: tuple[Roi, ...]
    pairs: tuple[tuple[str, str], ...]
    colours: Callable[[], Colours]

    def cdp(self, contrasts: Contrasts | None = None, epsilon: Tolerance = 0.5) -> Dataset:
        """Compute the contrast detection probability of each pair.

        Parameters
        ----------
        contrasts : float, str, array_like of them, or None
            Contrasts to be detected, fractions or percentages such as "50%"; None for the measured contrast of each
            pair.
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
        request = as_contrasts(contrasts, epsilon)
        rois = {roi.name: roi for roi in self.rois}
        pairs = [
            evaluate_pair(self.luminance, rois[a], rois[b], request.values, request.epsilon) for a, b in self.pairs
        ]
        data = pair_variables(pairs, self.unit) | cdp_variables(
            ("pair", "contrast"), [list(pair.cdp) or (None,) for pair in pairs]
        )
        coordinates = {"pair": [pair.name for pair in pairs], "side": ["bright", "dark"], "region": data.pop("region")}
        regions = [(pair.bright_region.roi, pair.dark_region.roi) for pair in pairs]
        attributes = self.attributes(request.epsilon, [finding for pair in pairs for finding in pair.findings], regions)
        measured = ("pair", [pair.contrast.value for pair in pairs])
        return described(at_contrasts(Dataset(data, coordinates, attributes), request, measured))

    def colour_separation(self, epsilon: float | str = 0.5) -> Dataset:
        """Tell how well the colours of both regions of each pair can be told apart.

        Parameters
        ----------
        epsilon : float or str
            Relative tolerance of the difference of chromaticity, above 0 and up to 1, or a percentage.

        Returns
        -------
        xarray.Dataset
            Over pair: the Mahalanobis distance ``colour_distance``, the colour separation probability ``csp`` and
            ``csp_counted``, and ``colours_detected``, the share of the pairs of pixels that keep the difference, each
            with its 95 % interval and standard uncertainty; see `labcdp.colour_separation`.

        Raises
        ------
        InputError
            If the picture is grey, or a region is too small.
        """
        from ..evaluate.colour.measure import colour_dataset, measure_colours

        tolerance = as_contrasts(None, epsilon).epsilon
        if not isinstance(tolerance, int | float):
            raise InputError("epsilon has two ends: give one number for the colours of regions")
        pairs = measure_colours(self.colours(), self.rois, self.pairs, tolerance)
        findings = [finding for pair in pairs for finding in pair.separation.findings]
        attributes = self.attributes(tolerance, findings, ()) | {"title": "colour separation of a picture"}
        return described(colour_dataset(pairs, attributes))

    def __repr__(self) -> str:
        return f"<labcdp.ImageRegions of {self.name}: regions: {len(self.rois)}, pairs: {len(self.pairs)}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return regions_table(self.rois, self.name)
