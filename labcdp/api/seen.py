"""Contrasts that a requirement judges, from the datasets of pictures, videos and sessions."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

import numpy as np
from xarray import Dataset

from ..core.errors import InputError
from ..evaluate.judgement import SeenContrast
from ..evaluate.requirement import Requirement
from ..metrics.region import SATURATED_SHARE


def seen_in(dataset: Dataset, requirement: Requirement) -> Iterator[SeenContrast]:
    """Yield the pairs of a dataset, of a video in each frame, at the contrast of a requirement.

    Raises
    ------
    InputError
        If it has no pairs, or another contrast or tolerance.
    """
    if "pair" not in dataset.dims or "cdp" not in dataset:
        raise InputError("the dataset has no CDP of pairs of regions: give one of pictures, videos or sessions")
    selected = _at_contrast(dataset, requirement)
    epsilon = (
        selected["epsilon"].values if "epsilon" in selected else np.array(selected.attrs.get("epsilon"), dtype=object)
    )
    if any(tolerance != requirement.epsilon for tolerance in epsilon.ravel().tolist()):
        raise InputError(f"the tolerance of the dataset is not {requirement.epsilon:g}: evaluate with that")
    rows = selected if "frame" in selected.dims else selected.expand_dims(frame=[-1])
    for frame in rows["frame"].values.tolist():
        for name in rows["pair"].values.tolist():
            yield _seen_contrast(rows.sel(frame=frame, pair=name), str(name), "" if frame < 0 else f"frame {frame}")


def _at_contrast(dataset: Dataset, requirement: Requirement) -> Dataset:
    contrasts = np.atleast_1d(dataset["contrast"].values)
    at = np.flatnonzero(np.isclose(contrasts, requirement.contrast, rtol=1e-9))
    # Contrasts as measured are those of the pairs.
    if at.size < (1 if "contrast" in dataset.dims else contrasts.size):
        raise InputError(f"the dataset has no CDP of a contrast of {requirement.contrast:g}: evaluate it with that")
    return dataset.isel(contrast=int(at[0])) if "contrast" in dataset.dims else dataset


def _seen_contrast(pair: Dataset, name: str, where: str) -> SeenContrast:
    """Return the measured contrast and CDP of a pair, with the luminance of its darker region or patch."""
    means = pair["mean"].values if "mean" in pair else pair["camera_luminance"].sel(patch=pair["region"].values).values
    known = pair.attrs.get("unit") == "cd/m^2" and bool(np.isfinite(means).any())
    saturated = "saturated" in pair and bool((pair["saturated"].values > SATURATED_SHARE).any())
    measured = float(pair["measured_contrast"]) if "measured_contrast" in pair else nan
    cdp, low, high = (float(pair[key]) for key in ("cdp", "cdp_low", "cdp_high"))
    scene = float(pair["meter_contrast"]) if "meter_contrast" in pair else None
    return SeenContrast(
        name, where, float(np.nanmin(means)) if known else None, measured, saturated, cdp, (low, high), scene
    )
