"""Regions of a video that follow their objects: CDP of their pairs, frame by frame."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any, Literal

from xarray import Dataset, concat

from ..core.errors import InputError, LabcdpError
from ..core.percent import plain_contrast
from ..core.result import Finding, error, unique
from ..core.roi import Roi, regions_table
from ..evaluate.video.dataset import restored
from ..evaluate.video.settings import Progress, VideoSettings
from ..files.video.selection import Selection
from ..tracking import method_among
from .arguments import Contrasts, PathArgument, Tolerance, as_contrasts, as_path
from .variables import described, noted


@dataclass(frozen=True, eq=False, repr=False)
class TrackedRegions:
    """Regions of a video that follow their objects; made by `Video.track`.

    Parameters
    ----------
    name : str
        Name of the video.
    evaluate : callable
        Evaluates the video in one pass with settings that have no conversion yet.
    rois : tuple of Roi
        The regions in the first frame.
    pairs : tuple of (str, str)
        Names of the pairs that are evaluated.
    method : str
        Tracking method of each region.
    selection : Selection
        Frames that are evaluated.
    """

    name: str
    evaluate: Callable[[Sequence[VideoSettings], Progress | None], list[Dataset | LabcdpError]]
    rois: tuple[Roi, ...]
    pairs: tuple[tuple[str, str], ...]
    method: str
    selection: Selection

    def cdp(
        self,
        contrasts: Contrasts | None = None,
        epsilon: Tolerance = 0.5,
        *,
        reference: float | Literal["first"] | PathArgument | None = None,
        reference_by: Literal["number", "time"] = "number",
        progress: Progress | None = None,
        colours: bool = False,
    ) -> Dataset:
        """Compute the contrast detection probability of each pair, frame by frame.

        Parameters
        ----------
        contrasts : float, str, array_like of them, or None
            Contrasts to be detected, fractions or percentages such as "50%"; None for the measured contrast of each
            pair in its first frame.
        epsilon : float or DetectionInterval
            Their relative tolerance.
        reference : float, 'first', path or None
            Contrast to compare each frame with: a measured one, that of the first frame, or the results (NetCDF) of
            another video.
        reference_by : {'number', 'time'}
            Whether its frames are matched by number or by time.
        progress : callable or None
            Called after each frame.
        colours : bool
            Whether to tell in each frame how well the colours of both regions can be told apart, too:
            ``colour_distance``, ``csp`` and ``colours_detected`` with their 95 % intervals, see
            `labcdp.colour_separation`.

        Returns
        -------
        xarray.Dataset
            CDP with its 95 % interval and standard uncertainty over frame, pair and contrast; measured contrast and
            CSNR over frame and pair; mean, SNR and tracking over frame, pair and side (bright, dark). Values are nan,
            with the reason as `note`, where a region is lost or a frame is broken. Without the dimension of contrasts
            for a number or None; with None `contrast` is a coordinate of the pairs.

        Raises
        ------
        InputError
            If an argument cannot be used, or no frame could be evaluated. A pair that has no result, such as one with a
            region that cannot be followed, is left out with a warning as long as others have one.
        """
        request = as_contrasts(contrasts, epsilon)
        reference = plain_contrast(reference, "reference")
        if isinstance(reference, bool) or reference_by not in ("number", "time"):
            raise InputError("reference is a contrast, 'first' or a path; reference_by is 'number' or 'time'")
        if reference is not None and reference != "first" and not isinstance(reference, int | float):
            reference = as_path(reference, "reference")
        known: Any = float(reference) if isinstance(reference, int | float) else reference
        targets = None if request.values is None else tuple(request.values)
        common = VideoSettings(
            targets,
            epsilon=request.epsilon,
            reference_by=reference_by,
            selection=self.selection,
            colours=colours,
        )
        settings = [self._settings_for(pair, common, known) for pair in self.pairs]
        results = list(zip(self.pairs, self.evaluate(settings, progress), strict=True))
        datasets = [
            _named_pair(pair_result, request.values is None)
            for _, pair_result in results
            if not isinstance(pair_result, LabcdpError)
        ]
        failed = [
            error("pair-failed", " / ".join(pair), reason=str(pair_result))
            for pair, pair_result in results
            if isinstance(pair_result, LabcdpError)
        ]
        dataset = _joined(datasets)
        dataset.attrs = _attributes([dataset.attrs for dataset in datasets], failed)
        return described(dataset.isel(contrast=0) if request.scalar else dataset, str(dataset.attrs["unit"]))

    def __repr__(self) -> str:
        counts = f"regions: {len(self.rois)}, pairs: {len(self.pairs)}"
        return f"<labcdp.TrackedRegions of {self.name}: {counts}, {self.method}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return regions_table(self.rois, self.name)

    def _settings_for(self, pair: tuple[str, str], common: VideoSettings, reference: Any) -> VideoSettings:
        """Return the settings for one pair."""
        named = {roi.name: roi for roi in self.rois}
        rois = named[pair[0]], named[pair[1]]
        method = method_among(self.method, list(named), pair)
        return replace(common, rois=rois, method=method, reference=reference)


def _joined(pairs: Sequence[Dataset]) -> Dataset:
    """Join the datasets of the pairs along the dimension ``pair``."""
    most = max(pair_data.sizes["corner"] for pair_data in pairs)
    padded = [pair_data.pad(corner=(0, most - pair_data.sizes["corner"])) for pair_data in pairs]
    dataset = concat(
        padded, "pair", data_vars="all", coords="different", compat="equals", join="exact", combine_attrs="override"
    )
    return dataset.transpose("frame", "pair", "contrast", "side", "corner", missing_dims="ignore")


def _attributes(attributes: Sequence[dict[str, Any]], failed: Sequence[Finding]) -> dict[str, Any]:
    """Return the common attributes, with the findings of all pairs."""
    merged = unique(
        [*failed, *(finding for attrs in attributes for finding in restored(json.loads(attrs["findings"])))]
    )
    kept = ("title", "file", "sha256", "method", "unit", "epsilon", "conversion")
    return {**{name: attributes[0][name] for name in kept}, **noted(merged), "labcdp_version": version("labcdp")}


def _named_pair(dataset: Dataset, measured: bool) -> Dataset:
    """Results of a pair with its name; with the measured contrast as a coordinate."""
    bright, dark = dataset["region"].values
    dataset = dataset.drop_vars("region").rename({"region": "side"})
    dataset = dataset.expand_dims(pair=[f"{bright} / {dark}"]).assign_coords(
        side=["bright", "dark"], region=(("pair", "side"), [[bright, dark]])
    )
    if not measured:
        return dataset
    return dataset.isel(contrast=0).assign_coords(contrast=("pair", dataset["contrast"].values))
