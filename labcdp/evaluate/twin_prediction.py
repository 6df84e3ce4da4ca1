"""Luminance a twin predicts for the pixels of each patch, as exact distributions, and how its parameters move them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calibration.emva.result import Quantity
from ..chain import ExposureSettings
from ..chain.camera_model import CameraModel
from ..chain.value_table import value_table
from ..contrast import Distribution
from ..response import Response
from .twin_corrected import dark_kinds
from .twin_noise import CameraNoise, known
from .twin_parameters import TwinParameters

FloatArray = NDArray[np.float64]

#: Pixels whose fall-off differs by less than this, relative, are taken as one; no more than so many kinds of pixels.
_FALL_OFF_STEP, _MOST_KINDS = 0.001, 9
#: Nodes and weights of a normal distribution, exact up to its fourth moment.
_NODES = ((-sqrt(3), 1 / 6), (0.0, 2 / 3), (sqrt(3), 1 / 6))
#: Probabilities below this are left out.
_NEVER = 1e-13
#: Steps between DN at which the response is inverted.
_INVERSE_STEPS = 4096


@dataclass(frozen=True, eq=False)
class TwinRegion:
    """A patch as the twin is told of it.

    Parameters
    ----------
    name : str
        Name of the patch.
    luminance_cd_m2 : float
        Mean of the meter's readings.
    reading_rel : float
        Relative standard uncertainty of that for the light on this region: meter without its scale, and unevenness.
    unevenness_rel : float
        Relative standard deviation of slow changes of the light across the region.
    fall_off : ndarray of float, shape (n,)
        V of its pixels.
    darkness_dn : float
        Standard uncertainty of the mean darkness of this region against that of the sensor.
    flat_field_rel : float
        Relative standard uncertainty of the fall-off here against that elsewhere.
    """

    name: str
    luminance_cd_m2: float
    reading_rel: float
    unevenness_rel: float
    fall_off: FloatArray
    darkness_dn: float
    flat_field_rel: float

    @cached_property
    def kinds(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Kinds of pixels: their V, their light over the mean one, and how frequent each is."""
        low, high = float(self.fall_off.min()), float(self.fall_off.max())
        count = min(max(ceil((high - low) / (_FALL_OFF_STEP * high)), 1), _MOST_KINDS)
        parts = np.array_split(np.sort(self.fall_off), count)
        v = np.array([part.mean() for part in parts])
        share = np.array([part.size for part in parts]) / self.fall_off.size
        nodes = _NODES if self.unevenness_rel > 0 else ((0.0, 1.0),)
        light = np.array([1 + self.unevenness_rel * node for node, _ in nodes])
        frequency = np.array([weight for _, weight in nodes])
        return np.repeat(v, light.size), np.tile(light, v.size), np.outer(share, frequency).ravel()


#: Distributions with a parameter lower, and higher, by its name in plain words.
Predicted = Mapping[str, tuple[Distribution, Distribution]]


@dataclass(frozen=True, eq=False)
class RegionPrediction:
    """Luminance of the pixels of a patch by the twin.

    Parameters
    ----------
    best : Distribution
        With the parameters as they are.
    shifted : dict of str to (Distribution, Distribution)
        With one parameter a standard uncertainty lower, and higher, by its name.
    own : dict of str to (Distribution, Distribution)
        The same for what belongs to this patch alone.
    """

    best: Distribution
    shifted: Predicted
    own: Predicted


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
        Response of the camera; signals follow it, and luminance is made of them by it.

    Returns
    -------
    dict of str to RegionPrediction
        By name of the patch.

    Notes
    -----
    The mean DN above dark of a pixel is h^-1(R t V L), its distribution that of `labcdp.chain.dn_distribution`:
    temporal noise and the fixed patterns of all pixels. It is made luminance with the R and d(t) of the calibration,
    which stay as they are when a parameter is shifted: the effect of an error of the darkness is that on the luminance
    that was measured.
    """
    rel = known(twin.responsivity) / twin.responsivity.value
    factors = {("best", 0): [1.0] * len(regions)}
    for sign in (-1, 1):
        factors["responsivity", sign] = [1 + sign * rel] * len(regions)
        factors["reading", sign] = [1 + sign * region.reading_rel for region in regions]
    base = _luminances(twin, regions, exposure_s, response, list(factors.values()))
    light = dict(zip(factors, base, strict=True))
    camera = {
        (name, sign): _luminances(twin.with_noise(noise), regions, exposure_s, response, [[1.0] * len(regions)])[0]
        for name, sign, noise in _shifted_noise(twin.noise)
    }
    darkness_dn = twin.dark_standard_uncertainty_dn(exposure_s)
    result = {}
    for i, region in enumerate(regions):
        best = light["best", 0][i]
        per_dn = luminance_per_dn(twin, region, exposure_s, response)

        def moved(by_dn: float, best: Distribution = best, per_dn: float = per_dn) -> tuple[Distribution, Distribution]:
            return added(best, -by_dn * per_dn), added(best, by_dn * per_dn)

        names = dict.fromkeys(name for name, _ in camera)
        shifted = {name: (camera[name, -1][i], camera[name, 1][i]) for name in names}
        shifted["responsivity"] = light["responsivity", -1][i], light["responsivity", 1][i]
        shifted["darkness"] = moved(darkness_dn)
        own = {
            "meter reading of": (light["reading", -1][i], light["reading", 1][i]),
            "darkness at": moved(region.darkness_dn),
        }
        if region.flat_field_rel > 0:
            own["flat field at"] = scaled(best, -region.flat_field_rel), scaled(best, region.flat_field_rel)
        result[region.name] = RegionPrediction(best, shifted, own)
    return result


@dataclass(frozen=True)
class Mending:
    """A change of a twin, or of what it is told of its patches.

    Parameters
    ----------
    noise : dict of str to Quantity
        Changed fields of `CameraNoise`.
    dsnu_dn2 : dict of float to float
        Change of the variance of the dark pattern, by exposure.
    patch : str or None
        The patch whose light changes; None for all.
    light_rel, light_cd_m2 : float
        Relative change of its light, and what is added to it.
    darkness_dn : float
        Change of the mean darkness.
    """

    noise: Mapping[str, Quantity] = field(default_factory=dict)
    dsnu_dn2: Mapping[float, float] = field(default_factory=dict)
    patch: str | None = None
    light_rel: float = 0.0
    light_cd_m2: float = 0.0
    darkness_dn: float = 0.0


def predict_mended(
    twin: TwinParameters,
    regions: Sequence[TwinRegion],
    exposure_s: float,
    response: Response,
    mendings: Sequence[Mending],
) -> dict[str, Distribution]:
    """Predict the luminance of patches with a twin that was mended; R and d(t) make luminance of it as before."""
    factors = []
    for region in regions:
        factor = 1.0
        for one in mendings:
            if one.patch in (None, region.name):
                more = one.light_cd_m2 + one.darkness_dn * luminance_per_dn(twin, region, exposure_s, response)
                factor += one.light_rel + more / region.luminance_cd_m2
        factors.append(max(factor, 0.0))
    noise = {name: value for one in mendings for name, value in one.noise.items()}
    dsnu, more_dn2 = twin.noise.dsnu_dn, sum(one.dsnu_dn2.get(exposure_s, 0.0) for one in mendings)
    noise["dsnu_dn"] = replace(dsnu, value=sqrt(max(dsnu.value**2 + more_dn2, 0.0)))
    mended = twin.with_noise(replace(twin.noise, **noise))
    (found,) = _luminances(mended, regions, exposure_s, response, [factors])
    return {region.name: one for region, one in zip(regions, found, strict=True)}


def added(distribution: Distribution, luminance_cd_m2: float) -> Distribution:
    """Return a distribution moved by a luminance."""
    return distribution.map(lambda values: values + luminance_cd_m2)


def scaled(distribution: Distribution, error_rel: float) -> Distribution:
    """Return a distribution whose luminances are relatively larger."""
    return distribution.map(lambda values: values * (1 + error_rel))


def _shifted_noise(noise: CameraNoise) -> list[tuple[str, int, CameraNoise]]:
    """Return the noise with each quantity a standard uncertainty lower and higher; in DN, as it was measured."""
    shifted = []
    for sign in (-1, 1):
        for label, names in (
            ("system gain K", ("k_dn_per_e",)),
            ("read noise", ("read_noise_dn",)),
            ("PRNU", ("prnu_rel",)),
            ("DSNU", ("dsnu_dn", "dsnu_dn_s")),
        ):
            changes = {name: _moved(getattr(noise, name), sign) for name in names}
            shifted.append((label, sign, replace(noise, **changes)))
    return shifted


def _moved(quantity: Quantity, sign: int) -> Quantity:
    return replace(quantity, value=max(quantity.value + sign * known(quantity), 0.0))


def dn_above_dark(twin: TwinParameters, response: Response, linear_dn: ArrayLike) -> FloatArray:
    """Return h^-1, the DN above dark of a signal that is proportional to the light."""
    wanted = np.asarray(linear_dn, dtype=float)
    if response.kind == "linear":
        return wanted
    grid = np.linspace(0.0, 2.0**twin.bits, _INVERSE_STEPS)
    heights = response.linearise(grid)
    inside = np.interp(wanted, heights, grid)
    result: FloatArray = inside + np.maximum(wanted - heights[-1], 0) / float(response.slope(grid[-1]))
    return result


def luminance_per_dn(twin: TwinParameters, region: TwinRegion, exposure_s: float, response: Response) -> float:
    """Return the change of a region's luminance with its DN, in cd/m^2."""
    full = twin.responsivity.value * exposure_s * float(region.fall_off.mean())
    net_dn = dn_above_dark(twin, response, full * region.luminance_cd_m2)
    return float(response.slope(net_dn)) / full


def _luminances(
    twin: TwinParameters,
    regions: Sequence[TwinRegion],
    exposure_s: float,
    response: Response,
    factors: Sequence[Sequence[float]],
) -> list[list[Distribution]]:
    """Distributions of luminance, for each set of factors of the light one for each region."""
    r_t = twin.responsivity.value * exposure_s
    signal = [
        r_t * v * light * region.luminance_cd_m2 * factor
        for of_set in factors
        for region, factor in zip(regions, of_set, strict=True)
        for v, light, _ in [region.kinds]
    ]
    per_s = twin.noise.k_dn_per_e.value * exposure_s
    rates = dn_above_dark(twin, response, np.concatenate(signal)) / per_s
    sensor = twin.sensor((1, 1), exposure_s)
    settings = ExposureSettings((exposure_s,), temperature_c=twin.temperature_c)
    dn = np.arange(2.0**twin.bits) - twin.dark_dn(exposure_s)
    kinds = dark_kinds(twin)
    if kinds is None:
        seen = [(_dn_rows(CameraModel(sensor, settings), rates), response.linearise(dn) / r_t)]
    else:
        seen = []
        for frames_dn, taken_off_dn in kinds:
            one = replace(sensor, dsnu_e=0.0, black_level_dn=max(sensor.black_level_dn + frames_dn, 0.0))
            seen.append((_dn_rows(CameraModel(one, settings), rates), response.linearise(dn - taken_off_dn) / r_t))
    result, place = [], 0
    for of_set in factors:
        of_regions = []
        for region, _ in zip(regions, of_set, strict=True):
            v, _, share = region.kinds
            own = [(row, linear, i) for rows, linear in seen for i, row in enumerate(rows[place : place + v.size])]
            place += v.size
            values = np.concatenate([linear[first : first + p.size] / v[i] for (first, p), linear, i in own])
            weights = np.concatenate([p * share[i] / len(seen) for (_, p), _, i in own])
            distinct, which = np.unique(values, return_inverse=True)
            of_regions.append(Distribution(distinct, np.bincount(which, weights)))
        result.append(of_regions)
    return result


def _dn_rows(camera: CameraModel, rates_e_s: FloatArray) -> list[tuple[int, FloatArray]]:
    """First DN that occurs at each rate, and the probabilities from it on."""
    table = value_table(camera, rates_e_s)
    order = np.argsort(rates_e_s, kind="stable")
    rows: dict[int, tuple[int, FloatArray]] = {}
    for part, first, share, _ in table.blocks(rates_e_s[order]):
        for index, row in zip(order[part], np.maximum(share, 0.0), strict=True):
            occurring = np.flatnonzero(row > _NEVER)
            begin, end = int(occurring[0]), int(occurring[-1]) + 1
            rows[int(index)] = first + begin, row[begin:end]
    return [rows[i] for i in range(rates_e_s.size)]
