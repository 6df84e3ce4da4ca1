"""A patch by the meter, by guessed parameters, and by the calibrated camera."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

from ...calibration import AnyCalibration, PatchLuminance
from ...calibration.colour.conversion import luminance_of_planes
from ...calibration.errors.expanded import expanded_rel
from ...calibration.meter import MeterScale
from ...calibration.readings import combine_readings
from ...chain.optics import axial_illuminance_per_cd_m2
from ...core.errors import CalibrationError
from ...core.roi import Roi
from ...core.spectral.photometry import photon_radiance_per_cd_m2
from ...metrics.regions.limits import LimitVerdict, limit_verdict
from .corrections import pixel_area_m2
from .observe import ObservedSession


@dataclass(frozen=True)
class PatchRow:
    """A patch by the meter, by guessed parameters, and by the calibrated camera.

    Parameters
    ----------
    region : Roi
        Where it is in the image.
    measured_cd_m2, measured_random_rel : float
        Mean of the meter's readings, and its relative standard uncertainty without the scale.
    meter : MeterScale
        The meter, and the error its readings have in common.
    n_readings : int
        Number of readings.
    calculated_cd_m2 : float or None
        From guessed camera parameters; None without a guess.
    calibrated : PatchLuminance
        By the calibrated camera.
    limits_cd_m2 : (float, float) or None
        Lowest and highest permitted luminance, if the plan has limits.
    """

    region: Roi
    measured_cd_m2: float
    measured_random_rel: float
    meter: MeterScale
    n_readings: int
    calculated_cd_m2: float | None
    calibrated: PatchLuminance
    limits_cd_m2: tuple[float, float] | None = None

    @property
    def limit_verdict(self) -> LimitVerdict | None:
        """Whether the luminance by the camera is within its limits; None without limits."""
        if self.limits_cd_m2 is None:
            return None
        luminance = self.calibrated.luminance_cd_m2
        return limit_verdict(luminance, self.calibrated.half_width_95_rel * luminance, self.limits_cd_m2)

    @property
    def measured_rel(self) -> float:
        """Relative standard uncertainty of the meter's value, the scale included."""
        return hypot(self.measured_random_rel, self.meter.common_rel)

    @property
    def measured_half_width_95_rel(self) -> float:
        """Relative U (95 %) of the meter's value, the scale included."""
        return expanded_rel([self.meter], self.measured_random_rel)

    @property
    def deviation_rel(self) -> float:
        """Relative deviation of the camera from the meter."""
        return self.calibrated.luminance_cd_m2 / self.measured_cd_m2 - 1


def patch_row(name: str, observed: ObservedSession, calibration: AnyCalibration) -> PatchRow:
    """Evaluate a patch; raises CalibrationError if it reads 0, or is saturated or black at every exposure."""
    measured, _ = combine_readings(name, observed.readings.get(name, []))
    if measured.luminance_cd_m2 == 0:
        raise CalibrationError(
            f"patch {name!r} reads 0 cd/m², below the meter's range: leave it out with --without {name!r}"
        )
    patch = next(p for p in observed.configuration.target.patches if p.name == name)
    return PatchRow(
        region=patch.region(),
        limits_cd_m2=patch.limits_cd_m2,
        measured_cd_m2=measured.luminance_cd_m2,
        measured_random_rel=measured.random_cd_m2 / measured.luminance_cd_m2,
        meter=observed.meter_scale,
        n_readings=measured.n_readings,
        calculated_cd_m2=_calculated_cd_m2(observed, name),
        calibrated=luminance_of_planes(
            calibration, {plane or "": seen.patches[name] for plane, seen in observed.planes.items()}
        ),
    )


def _calculated_cd_m2(observed: ObservedSession, name: str) -> float | None:
    """Luminance by guessed parameters of the camera, without any uncertainty to state; None without them.

    The electrons of a pixel are L t QE p^2 tau pi / (4 N^2) times the photons per cd/m^2 of the spectrum (the 2018
    thesis' equation 3.1 and its sensor, solved for the luminance; the thesis' program multiplies where it must divide).
    """
    guess = observed.configuration.guess
    # A guess is of one responsivity: for colour filters it says nothing.
    if guess is None or None not in observed.planes:
        return None
    unsaturated = [o for o in observed.patches[name] if o.saturated_share == 0]
    if not unsaturated:
        return None
    o = max(unsaturated, key=lambda o: o.exposure_s)
    illuminance = axial_illuminance_per_cd_m2(guess.f_number, guess.transmittance, magnification=0.0)
    photons_s_m2 = photon_radiance_per_cd_m2(observed.configuration.source.spectrum) * illuminance
    # K is taken to be for 0 dB.
    k_dn_per_e = guess.k_dn_per_e * 10 ** (o.state.gain_db / 20)
    area_m2 = pixel_area_m2(guess.pixel_pitch_m, o.state.readout)
    responsivity = photons_s_m2 * area_m2 * guess.quantum_efficiency * k_dn_per_e
    return o.net_dn(guess.dark_dn) / (responsivity * o.exposure_s)
