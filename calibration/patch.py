"""Luminance of a patch by the calibrated camera, with its 95 % interval, and the contrast of two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from ..errors import CalibrationError
from ..luminance import CommonError
from .common_errors import common_errors
from .model import Calibration
from .observations import PatchObservation
from .place import fall_off_errors, slow_rel
from .signal import net_signal, temperature_warnings, usable
from .uncertainty import expanded_half_width

#: Part of the calibrated signal range that a signal may exceed it by without notice.
_RANGE_MARGIN = 0.05


@dataclass(frozen=True)
class PatchLuminance:
    """Calibrated luminance of a patch.

    Parameters
    ----------
    patch : str
        Name of the patch.
    luminance_cd_m2 : float
        Best value.
    random_rel : float
        Relative standard uncertainty by this patch alone: noise, pixels, uneven darkness, what the measured fall-off
        leaves at its place, and the scatter of the calibration's patches that nothing explains.
    common : tuple of CommonError
        Errors that the patches of one calibration share, as signed numbers; see `labcdp.calibration.common_errors`.
    exposures_s : tuple of float
        Exposures that were used.
    warnings : tuple of str
        Exposures left out, a temperature that the dark frames do not cover, and a luminance or signal outside the
        calibrated range.
    """

    patch: str
    luminance_cd_m2: float
    random_rel: float
    common: tuple[CommonError, ...]
    exposures_s: tuple[float, ...]
    warnings: tuple[str, ...]

    @property
    def fit_rel(self) -> float:
        """Relative standard uncertainty by the shared errors without the meter's scale: fit, darkness, exposure."""
        return sqrt(sum(float(e.relative) ** 2 for e in self.common if not e.rectangular))

    @property
    def scale_half_width_rel(self) -> float:
        """Half width of the meter's scale error (rectangular); the same for all patches."""
        return sqrt(3) * sum(abs(float(e.relative)) for e in self.common if e.rectangular)

    @property
    def common_rel(self) -> float:
        """Relative standard uncertainty by all shared errors."""
        return hypot(self.fit_rel, self.scale_half_width_rel / sqrt(3))

    @property
    def half_width_95_rel(self) -> float:
        """Half width of the 95 % interval, relative: rectangular scale and normal rest combined."""
        return expanded_half_width(self.scale_half_width_rel, hypot(self.random_rel, self.fit_rel))

    @property
    def interval_95_cd_m2(self) -> tuple[float, float]:
        """Ends of the 95 % interval."""
        half_width = self.half_width_95_rel * self.luminance_cd_m2
        return self.luminance_cd_m2 - half_width, self.luminance_cd_m2 + half_width


def patch_luminance(calibration: Calibration, observations: Sequence[PatchObservation]) -> PatchLuminance:
    """Luminance of one patch from its observations at one or more exposures and gains.

    Parameters
    ----------
    calibration : Calibration
        Of the same camera and settings.
    observations : sequence of PatchObservation
        Of one patch, observed with the calibration's vignetting.

    Raises
    ------
    CalibrationError
        If there is no observation, observations are of several patches, of another camera, setting or
        vignetting, or the patch is clipped or black at every exposure.
    """
    names = sorted({o.patch for o in observations})
    if len(names) != 1:
        raise CalibrationError(f"observations are of patches {names}: give those of one patch at a time")
    for o in observations:
        name = f"patch {o.patch!r} at {o.exposure_s:g} s"
        calibration.require(o.state, name)
        if o.vignetting != calibration.vignetting:
            raise CalibrationError(
                f"{name} was observed with vignetting {o.vignetting}, the calibration has {calibration.vignetting}: "
                "observe it with the calibration's"
            )
    kept, _, warnings = usable(observations, calibration.settings)
    if not kept:
        warnings += temperature_warnings(observations, calibration.settings)
        raise CalibrationError(f"no exposure gives the luminance of a patch: {'; '.join(warnings)}")
    return _combined(calibration, kept, warnings)


def contrast_uncertainty(bright: PatchLuminance, dark: PatchLuminance) -> float:
    """Return the standard uncertainty of the Weber contrast K = L_bright / L_dark - 1 of two patches.

    u = (1 + K) sqrt(r_b^2 + r_d^2 + sum (c_b - c_d)^2) with the random parts r and the signed common parts c (JCGM
    100:2008, 5.2.2, for errors that are fully correlated each). The meter's scale cancels exactly.

    Parameters
    ----------
    bright, dark : PatchLuminance
        By one calibration.
    """
    a, b = _by_name(bright.common), _by_name(dark.common)
    left = [a.get(name, 0.0) - b.get(name, 0.0) for name in sorted(a.keys() | b.keys())]
    ratio = bright.luminance_cd_m2 / dark.luminance_cd_m2
    return ratio * sqrt(bright.random_rel**2 + dark.random_rel**2 + sum(value**2 for value in left))


def _combined(
    calibration: Calibration, observations: Sequence[PatchObservation], warnings: list[str]
) -> PatchLuminance:
    observations = _within_the_response(calibration, observations)
    signals = [net_signal(o, calibration.settings) for o in observations]
    net = np.array([s.net_dn for s in signals])
    r = calibration.responsivity.responsivity_dn_s_cd_m2
    scale = np.array([s.scale_per_s / (r * calibration.settings[s.gain_index].factor) for s in signals])
    each = scale * calibration.response.linearise(net)
    slope = scale * calibration.response.slope(net)
    weight = 1 / (slope**2 * np.array([s.variance_dn2 for s in signals]))
    weight /= weight.sum()
    luminance = float(weight @ each)
    of_each_dn2 = np.array([s.noise_variance_dn2 for s in signals]) + calibration.responsivity.scatter_dn**2
    noise = float((weight * slope) ** 2 @ of_each_dn2)
    # Neither the uneven darkness nor the pixels' sensitivity average over the exposures.
    uneven = float(weight @ (slope * np.array([s.dark_nonuniformity_dn for s in signals])))
    pixels = float((weight * each / luminance) @ np.array([s.pixels_rel for s in signals]))
    of_place = hypot(slow_rel(calibration.vignetting), calibration.responsivity.scatter_rel)
    random_rel = sqrt((noise + uneven**2) / luminance**2 + pixels**2 + of_place**2)
    shared: dict[str, CommonError] = {}
    for o, n, share in zip(observations, net, weight * each / luminance, strict=True):
        errors = common_errors(calibration, n, o.exposure_s, o.state.gain_db, o.temperature_c)
        for number, error in enumerate(errors):
            exposure = error.source == "exposure time"
            source = f"exposure time {o.exposure_s:g} s" if exposure else error.source
            key = source if exposure else f"{number}"
            so_far = float(shared[key].relative) if key in shared else 0.0
            shared[key] = CommonError(source, so_far + float(share * error.relative), error.rectangular)
    patch = observations[0].patch
    by_place = fall_off_errors(calibration.vignetting, calibration.state.image_shape, [observations[0].centre_px])
    return PatchLuminance(
        patch=patch,
        luminance_cd_m2=luminance,
        random_rel=random_rel,
        common=(*shared.values(), *(CommonError("flat field", float(error)) for (error,) in by_place)),
        exposures_s=tuple(sorted({o.exposure_s for o in observations})),
        warnings=(
            *warnings,
            *temperature_warnings(observations, calibration.settings),
            *_outside(calibration, patch, luminance, random_rel, float(net.max())),
        ),
    )


def _within_the_response(
    calibration: Calibration, observations: Sequence[PatchObservation]
) -> Sequence[PatchObservation]:
    """Leave out signals a bent response was not fitted to, if there are others."""
    if calibration.response.kind == "linear":
        return observations
    highest = calibration.range_net_dn[1] * (1 + _RANGE_MARGIN)
    inside = [o for o in observations if net_signal(o, calibration.settings).net_dn <= highest]
    return inside or observations


def _outside(
    calibration: Calibration, patch: str, luminance_cd_m2: float, random_rel: float, net_dn: float
) -> list[str]:
    warnings = []
    low, high = calibration.range_cd_m2
    margin = 3 * random_rel * luminance_cd_m2
    if luminance_cd_m2 < low - margin or luminance_cd_m2 > high + margin:
        warnings.append(
            f"patch {patch!r} has {luminance_cd_m2:.4g} cd/m^2, the calibrated range is {low:.4g} to {high:.4g} "
            "cd/m^2: calibrate with a patch as bright or as dark"
        )
    elif net_dn > calibration.range_net_dn[1] * (1 + _RANGE_MARGIN):
        warnings.append(
            f"patch {patch!r} is {net_dn:.4g} DN above dark, the calibration rests on signals up to "
            f"{calibration.range_net_dn[1]:.4g} DN: use a shorter exposure, or calibrate with a brighter patch"
        )
    return warnings


def _by_name(common: Sequence[CommonError]) -> dict[str, float]:
    """Values by source, numbered where several have the same source."""
    values: dict[str, float] = {}
    for error in common:
        number = 0
        while f"{error.source} {number}" in values:
            number += 1
        values[f"{error.source} {number}"] = float(error.relative)
    return values
