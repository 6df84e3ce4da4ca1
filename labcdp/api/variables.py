"""Variables of the datasets of pictures, videos and sessions: unit and meaning, in one place."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.result import Finding
from ..metrics import DetectionResult
from ..report.text import finding_text

if TYPE_CHECKING:
    from xarray import Dataset

#: Unit and meaning; the unit "luminance" stands for that of the picture.
_VARIABLES = {
    "cdp": ("1", "contrast detection probability (CDP)"),
    "u_cdp": ("1", "standard uncertainty of the CDP"),
    "cdp_low": ("1", "lower end of the 95 % interval of the CDP"),
    "cdp_high": ("1", "upper end of the 95 % interval of the CDP"),
    "below": ("1", "share of pairs of pixels with a lower contrast"),
    "above": ("1", "share of pairs of pixels with a higher contrast"),
    "undefined": ("1", "share of pairs of pixels in which none is above 0, part of below"),
    "measured_contrast": ("1", "Weber contrast of the regions' means"),
    "u_measured_contrast": ("1", "standard uncertainty of the measured contrast"),
    "meter_contrast": ("1", "Weber contrast by the luminance meter"),
    "u_meter_contrast": ("1", "standard uncertainty of the contrast by the luminance meter"),
    "csnr": ("1", "contrast signal-to-noise ratio"),
    "u_csnr": ("1", "standard uncertainty of the contrast signal-to-noise ratio"),
    "reference_contrast": ("1", "contrast the frame is compared with"),
    "reference_cdp": ("1", "CDP of the reference contrast"),
    "reference_cdp_low": ("1", "lower end of its 95 % interval"),
    "reference_cdp_high": ("1", "upper end of its 95 % interval"),
    "mean": ("luminance", "mean of the region"),
    "u_mean": ("luminance", "standard uncertainty of the mean"),
    "std": ("luminance", "standard deviation of the region's pixels"),
    "snr": ("1", "mean over standard deviation of the region"),
    "u_snr": ("1", "standard uncertainty of the signal-to-noise ratio"),
    "pixels": ("1", "number of pixels of the region"),
    "saturated": ("1", "share of saturated pixels of the region"),
    "quality": ("1", "quality of the tracking, 0 to 1"),
    "lost": ("1", "whether the region was lost"),
    "centre_x": ("pixel", "middle of the region, to the right"),
    "centre_y": ("pixel", "middle of the region, down"),
    "corner_x": ("pixel", "corners of the region, to the right"),
    "corner_y": ("pixel", "corners of the region, down"),
    "luminance": ("luminance", "luminance"),
    "u_luminance": ("luminance", "standard uncertainty of the luminance that differs from pixel to pixel"),
    "invalid": ("1", "flags why a pixel is not valid, 0 where it is (labcdp.core.luminance.Invalid)"),
    "exposure_s": ("s", "exposure time of the frame"),
    "epsilon": ("1", "relative tolerance of the contrast"),
    "meter_luminance": ("cd/m^2", "mean of the luminance meter's readings"),
    "meter_U": ("cd/m^2", "its expanded uncertainty U (95 %)"),
    "camera_luminance": ("cd/m^2", "luminance by the calibrated camera"),
    "camera_low": ("cd/m^2", "lower end of its 95 % interval"),
    "camera_high": ("cd/m^2", "upper end of its 95 % interval"),
    "deviation": ("1", "deviation of the camera from the meter, as a fraction"),
    "contrast": ("1", "Weber contrast to be detected, as a fraction (1.0 is 100 %)"),
    "pair": ("", "bright region / dark region"),
    "side": ("", "bright or dark region of the pair"),
    "region": ("", "name of the region"),
    "note": ("", "why a value is missing, or a warning about it"),
    "findings": ("", "the notes with code, subject and values, as JSON"),
    "frame": ("", "number of the frame, from 0"),
    "time_s": ("s", "time since the first frame"),
}


def described(dataset: Dataset, unit: str = "cd/m^2") -> Dataset:
    """Return the dataset with unit and meaning as attributes of each variable that is known.

    Parameters
    ----------
    dataset : xarray.Dataset
        Variables by their names.
    unit : str
        Unit of the luminances.
    """
    from . import accessor as accessor  # registers it

    names: list[Hashable] = [*dataset.variables]
    for name in names:
        if name in _VARIABLES:
            units, meaning = _VARIABLES[str(name)]
            units = unit if units == "luminance" else units
            dataset[name].attrs = {"long_name": meaning} | ({"units": units} if units else {})
    return dataset


#: Variables of a CDP: of `cdp_values`.
OF_CDP = ("cdp", "u_cdp", "cdp_low", "cdp_high", "below", "above", "undefined")


def columns(dims: tuple[str, ...], rows: Sequence[Any], names: Sequence[str]) -> dict[str, Any]:
    """Return variables over dimensions from mappings of names to numbers; nan where one lacks a name.

    Parameters
    ----------
    dims : tuple of str
        Names of the dimensions.
    rows : sequence
        Mappings, or sequences of such for two dimensions.
    names : sequence of str
        Names of the variables.
    """
    table = np.array(rows, dtype=object).reshape((0,) * len(dims) if not len(rows) else np.shape(rows))
    return {name: (dims, np.array([row.get(name, nan) for row in table.flat]).reshape(table.shape)) for name in names}


def cdp_values(result: DetectionResult, u: float, interval: tuple[float, float]) -> dict[str, float]:
    """Return CDP with uncertainty and shares, by the names of variables."""
    return dict(zip(OF_CDP, (result.cdp, u, *interval, result.below, result.above, result.undefined), strict=True))


def noted(findings: Sequence[Finding]) -> dict[str, str]:
    """Return findings as attributes of a dataset."""
    return {
        "notes": "\n".join(finding_text(one) for one in findings if one.severity == "info"),
        "warnings": "\n".join(finding_text(one) for one in findings if one.severity != "info"),
    }
