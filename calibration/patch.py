"""Luminance of a patch by the calibrated camera, with its 95 % interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

from ..errors import CalibrationError
from .model import Calibration
from .observations import PatchObservation
from .signal import combine, usable
from .uncertainty import expanded_half_width


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
        Relative standard uncertainty by this patch's frames: noise, pixels, darkness.
    fit_rel : float
        Relative standard uncertainty of the responsivity without the meter's scale; the same for all patches.
    scale_half_width_rel : float
        Half width of the meter's scale error (rectangular); the same for all patches.
    exposures_s : tuple of float
        Exposures that were used.
    warnings : tuple of str
        Exposures left out, and a luminance outside the calibrated range.
    """

    patch: str
    luminance_cd_m2: float
    random_rel: float
    fit_rel: float
    scale_half_width_rel: float
    exposures_s: tuple[float, ...]
    warnings: tuple[str, ...]

    @property
    def common_rel(self) -> float:
        """Relative standard uncertainty shared with all patches: fit and scale."""
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
    """Luminance of one patch from its observations at one or more exposures.

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
        calibration.state.require(o.state, "the calibration", name)
        if o.vignetting != calibration.vignetting:
            raise CalibrationError(
                f"{name} was observed with vignetting {o.vignetting}, the calibration has {calibration.vignetting}: "
                "observe it with the calibration's"
            )
    kept, warnings = usable(observations, calibration.dark, calibration.noise)
    if not kept:
        raise CalibrationError(f"no exposure gives the luminance of a patch: {'; '.join(warnings)}")
    signal = combine(kept, calibration.dark, calibration.noise)
    luminance_cd_m2 = signal.rate_dn_s / calibration.responsivity.responsivity_dn_s_cd_m2
    variance = signal.variance_dn2_s2 + calibration.dark.propagate(*signal.dark_sensitivity)
    random_rel = hypot(sqrt(variance) / signal.rate_dn_s, signal.fixed_pattern_rel)
    low, high = calibration.range_cd_m2
    margin = 3 * random_rel * luminance_cd_m2
    if luminance_cd_m2 < low - margin or luminance_cd_m2 > high + margin:
        warnings.append(
            f"patch {names[0]!r} has {luminance_cd_m2:.4g} cd/m^2, the calibrated range is {low:.4g} to {high:.4g} "
            "cd/m^2: calibrate with a patch as bright or as dark"
        )
    return PatchLuminance(
        patch=names[0],
        luminance_cd_m2=luminance_cd_m2,
        random_rel=random_rel,
        fit_rel=calibration.responsivity.random_rel,
        scale_half_width_rel=calibration.meter_scale.half_width_rel,
        exposures_s=signal.exposures_s,
        warnings=tuple(warnings),
    )
