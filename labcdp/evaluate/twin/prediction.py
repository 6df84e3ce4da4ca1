"""Predicted luminance of the pixels of each patch as exact distributions, and its sensitivity to the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from ...chain import ExposureSettings
from ...chain.predict.camera import CameraModel
from ...chain.predict.value_table import value_table
from ...core.dn import Response
from ...core.quantity import Quantity
from ...metrics import Distribution
from .parameters import TwinParameters, dark_kinds

FloatArray = NDArray[np.float64]

#: Pixels whose vignetting differs by less than this, relative, are grouped; and the largest number of groups.
_VIGNETTING_STEP, _MOST_KINDS = 0.001, 9
#: Nodes and weights of a normal distribution, exact up to its fourth moment.
_NODES = ((-sqrt(3), 1 / 6), (0.0, 2 / 3), (sqrt(3), 1 / 6))
#: Probabilities below this are left out.
_NEVER = 1e-13


@dataclass(frozen=True, eq=False)
class TwinRegion:
    """A patch as input of the twin.

    Parameters
    ----------
    name : str
        Name of the patch.
    luminance_cd_m2 : float
        Mean of the meter's readings.
    reading_rel : float
        Relative standard uncertainty of it as the luminance of this region: meter without its scale, and
        non-uniformity.
    nonuniformity_rel : float
        Relative standard deviation of slow changes of the light across the region.
    vignetting : ndarray of float, shape (n,)
        V of its pixels.
    darkness_dn : float
        Standard uncertainty of the mean dark signal of this region relative to that of the sensor.
    flat_field_rel : float
        Relative standard uncertainty of the vignetting here relative to that elsewhere.
    """

    name: str
    luminance_cd_m2: float
    reading_rel: float
    nonuniformity_rel: float
    vignetting: FloatArray
    darkness_dn: float
    flat_field_rel: float

    @cached_property
    def kinds(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Groups of pixels: V, relative luminance, and frequency of each."""
        low, high = float(self.vignetting.min()), float(self.vignetting.max())
        count = min(max(ceil((high - low) / (_VIGNETTING_STEP * high)), 1), _MOST_KINDS)
        parts = np.array_split(np.sort(self.vignetting), count)
        v = np.array([part.mean() for part in parts])
        share = np.array([part.size for part in parts]) / self.vignetting.size
        nodes = _NODES if self.nonuniformity_rel > 0 else ((0.0, 1.0),)
        light = np.array([1 + self.nonuniformity_rel * node for node, _ in nodes])
        frequency = np.array([weight for _, weight in nodes])
        return np.repeat(v, light.size), np.tile(light, v.size), np.outer(share, frequency).ravel()


#: A distribution with a parameter lowered and raised by a standard uncertainty.
Shifted = tuple[Distribution, Distribution]


@dataclass(frozen=True, eq=False)
class RegionPrediction:
    """Luminance of the pixels of a patch by the twin.

    Parameters
    ----------
    best : Distribution
        Distribution with the nominal parameters.
    shifted : dict of str to (Distribution, Distribution)
        Distributions with one parameter lowered and raised by a standard uncertainty, by its name; a name with that of
        the patch is of this patch only.
    """

    best: Distribution
    shifted: Mapping[str, Shifted]


def predict_regions(
    twin: TwinParameters, regions: Sequence[TwinRegion], exposure_s: float, response: Response
) -> dict[str, RegionPrediction]:
    """Predict the luminance of the pixels of patches, as a frame of one exposure would show it.

    Parameters
    ----------
    twin : TwinParameters
        The camera.
    regions : sequence of TwinRegion
        The patches.
    exposure_s : float
        Exposure of the frame.
    response : Response
        Response of the camera, used to predict signals and to convert them to luminance.

    Returns
    -------
    dict of str to RegionPrediction
        By name of the patch.

    Notes
    -----
    The mean DN above dark of a pixel is h^-1(R t V L), its distribution that of `labcdp.chain.predict.prediction`:
    temporal noise and the fixed patterns of all pixels. It is converted to luminance with the R and d(t) of the
    calibration, which are not shifted with a parameter: the effect of an error of the dark signal is that on the
    measured luminance.
    """
    rel = twin.responsivity.u_known / twin.responsivity.value
    same = [1.0] * len(regions)
    light = [same]
    for sign in (-1, 1):
        light += [[1 + sign * rel] * len(regions), [1 + sign * region.reading_rel for region in regions]]
    best, *moved = _luminances(twin, regions, exposure_s, response, light)
    noise_shifts = {
        name: [_luminances(_shifted(twin, names, sign), regions, exposure_s, response, [same])[0] for sign in (-1, 1)]
        for name, names in _SHIFTED.items()
    }
    darkness_dn = twin.dark_standard_uncertainty_dn(exposure_s)
    result = {}
    for i, (region, best_region) in enumerate(zip(regions, best, strict=True)):
        full = twin.responsivity.value * exposure_s * float(region.vignetting.mean())
        per_dn = float(response.slope(response.inverse(full * region.luminance_cd_m2))) / full
        shifted = {name: (both[0][i], both[1][i]) for name, both in noise_shifts.items()}
        shifted["responsivity"] = moved[0][i], moved[2][i]
        shifted[f"meter reading of {region.name}"] = moved[1][i], moved[3][i]
        shifted["dark signal"] = added(best_region, darkness_dn * per_dn)
        shifted[f"dark signal at {region.name}"] = added(best_region, region.darkness_dn * per_dn)
        if region.flat_field_rel > 0:
            shifted[f"flat field at {region.name}"] = scaled(best_region, region.flat_field_rel)
        result[region.name] = RegionPrediction(best_region, shifted)
    return result


def added(distribution: Distribution, luminance_cd_m2: float) -> Shifted:
    """Return a distribution shifted down and up by a luminance."""
    return distribution.map(lambda values: values - luminance_cd_m2), distribution.map(
        lambda values: values + luminance_cd_m2
    )


def scaled(distribution: Distribution, error_rel: float) -> Shifted:
    """Return a distribution with its luminances scaled down and up."""
    return distribution.map(lambda values: values * (1 - error_rel)), distribution.map(
        lambda values: values * (1 + error_rel)
    )


#: Parameters that are shifted together, by their common name.
_SHIFTED = {
    "system gain K": ("k_dn_per_e",),
    "read noise": ("read_noise_dn",),
    "PRNU": ("prnu_rel",),
    "DSNU": ("dsnu_dn", "dsnu_dn_s"),
}


def _shifted(twin: TwinParameters, names: Sequence[str], sign: int) -> TwinParameters:
    """Return the twin with some of its noise a standard uncertainty lower or higher; in DN, as it was measured."""
    old: dict[str, Quantity] = {name: getattr(twin, name) for name in names}
    return twin.with_noise(**{name: replace(q, value=max(q.value + sign * q.u_known, 0.0)) for name, q in old.items()})


def _luminances(
    twin: TwinParameters,
    regions: Sequence[TwinRegion],
    exposure_s: float,
    response: Response,
    factors: Sequence[Sequence[float]],
) -> list[list[Distribution]]:
    """Distributions of luminance of each region, for each set of factors of the light."""
    r_t = twin.responsivity.value * exposure_s
    signal = [
        r_t * v * light * region.luminance_cd_m2 * factor
        for set_factors in factors
        for region, factor in zip(regions, set_factors, strict=True)
        for v, light, _ in [region.kinds]
    ]
    per_s = twin.k_dn_per_e.value * exposure_s
    rates = response.inverse(np.concatenate(signal)) / per_s
    sensor = twin.sensor((1, 1), exposure_s)
    settings = ExposureSettings((exposure_s,), temperature_c=twin.temperature_c)
    dn = np.arange(2.0**twin.bits) - twin.dark_dn(exposure_s)
    kinds = [
        (replace(sensor, dsnu_e=0.0, black_level_dn=max(sensor.black_level_dn + frames_dn, 0.0)), taken_off_dn)
        for frames_dn, taken_off_dn in dark_kinds(twin)
    ]
    seen = [
        (_dn_rows(CameraModel(variant, settings), rates), response.linearise(dn - taken_off_dn) / r_t)
        for variant, taken_off_dn in kinds or [(sensor, 0.0)]
    ]
    result, first_row = [], 0
    for set_factors in factors:
        distributions = []
        for region, _ in zip(regions, set_factors, strict=True):
            v, _, share = region.kinds
            rows_here = [
                (row, linear, i) for rows, linear in seen for i, row in enumerate(rows[first_row : first_row + v.size])
            ]
            first_row += v.size
            values = np.concatenate([linear[first : first + p.size] / v[i] for (first, p), linear, i in rows_here])
            weights = np.concatenate([p * share[i] / len(seen) for (_, p), _, i in rows_here])
            distinct, which = np.unique(values, return_inverse=True)
            distributions.append(Distribution(distinct, np.bincount(which, weights)))
        result.append(distributions)
    return result


def _dn_rows(camera: CameraModel, rates_e_s: FloatArray) -> list[tuple[int, FloatArray]]:
    """First DN at each rate, and the probabilities from it on."""
    table = value_table(camera, rates_e_s)
    rows: dict[int, tuple[int, FloatArray]] = {}
    for chosen, first, share, _ in table.blocks(rates_e_s):
        for index, row in zip(chosen, np.maximum(share, 0.0), strict=True):
            occurring = np.flatnonzero(row > _NEVER)
            begin, end = int(occurring[0]), int(occurring[-1]) + 1
            rows[int(index)] = first + begin, row[begin:end]
    return [rows[i] for i in range(rates_e_s.size)]
