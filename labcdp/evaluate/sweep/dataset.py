"""The result of a sweep as a labelled array."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .axis import Axis
from .plan import Sweep, of_scene

if TYPE_CHECKING:
    from xarray import Dataset

#: Variables of the result, with unit and description.
VARIABLES = {
    "cdp": ("1", "contrast detection probability"),
    "standard_error": ("1", "standard error of the CDP"),
    "below": ("1", "share of pairs with a lower contrast"),
    "above": ("1", "share of pairs with a higher contrast"),
    "mean_contrast": ("1", "mean contrast of the pairs with a dark value above 0"),
    "csnr": ("1", "mean over standard deviation of the contrast"),
    "snr_dark": ("1", "mean over standard deviation of the dark region's luminance"),
    "snr_bright": ("1", "mean over standard deviation of the bright region's luminance"),
    "snr_dark_standard_error": ("1", "standard error of the SNR of the dark region"),
    "snr_bright_standard_error": ("1", "standard error of the SNR of the bright region"),
    "saturated_share": ("1", "saturated share of the bright region"),
}

_UNITS = {"_cd_m2": "cd/m^2", "_s": "s", "_c": "degC", "_m": "m", "_db": "dB", "_e": "e-", "_e_s": "e-/s", "_dn": "DN"}


def labelled(sweep: Sweep, values: NDArray[np.float64]) -> Dataset:
    """Label the values of all cells, shape (cells, variables)."""
    from xarray import Dataset

    names = [axis.parameter for axis in sweep.axes]
    variables = {
        name: (names, values[:, column].reshape(sweep.shape), {"unit": unit, "long_name": long_name})
        for column, (name, (unit, long_name)) in enumerate(VARIABLES.items())
    }
    coordinates = {
        axis.parameter: ([axis.parameter], np.array(axis.values), {"unit": _unit(axis), "long_name": _words(axis)})
        for axis in sweep.axes
    }
    asked = float("nan") if sweep.contrast is None else sweep.contrast
    attributes: Mapping[str, Any] = {
        "title": f"{sweep.chain.name or 'chain'}: CDP behind {sweep.stage}",
        "contrast": _scene_contrast(sweep) if sweep.contrast is None else asked,
        "epsilon": sweep.epsilon,
        "method": "exact" if sweep.exact else "simulated",
        "stage": sweep.stage,
        "position": "optical axis" if sweep.exact else "whole frame",
        "seed": sweep.seed,
        "labcdp_version": version("labcdp"),
        "chain": sweep.chain.to_toml(),
    }
    return Dataset(variables, coordinates, attributes)


def _scene_contrast(sweep: Sweep) -> float:
    """Contrast of the scene if it is the same in all cells, else nan."""
    if any(of_scene(sweep.chain, axis.parameter) and axis.parameter != "scene.luminance_cd_m2" for axis in sweep.axes):
        return float("nan")
    return float(getattr(sweep.chain.scene, "contrast", float("nan")))


def _unit(axis: Axis) -> str:
    if not axis.numeric:
        return ""
    endings = [ending for ending in _UNITS if axis.parameter.endswith(ending)]
    return _UNITS[max(endings, key=len)] if endings else "1"


def _words(axis: Axis) -> str:
    table, _, key = axis.parameter.partition(".")
    for ending in sorted(_UNITS, key=len, reverse=True):
        if key.endswith(ending):
            key = key[: -len(ending)]
            break
    return (key if key == table else f"{table} {key}").replace("_", " ").strip()
