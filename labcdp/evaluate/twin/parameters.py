"""Parameters of a camera's twin, from a session, with standard uncertainties."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot, isfinite, nan, sqrt

from ...calibration import Calibration, DarkModel
from ...calibration.emva.result import Characterisation, Quantity
from ...calibration.gains import index_of_gain
from ...calibration.rounding import mean_before_rounding
from ...chain import Optics, Sensor
from ...core.errors import CalibrationError, InputError
from ...core.finding import Finding, info
from ...core.frame import Frame
from ...core.spectral.photometry import photon_radiance_per_cd_m2
from ...session import Session, SessionConfiguration
from ..bench.corrections import pixel_area_m2
from ..bench.observe import ObservedSession
from .noise import CameraNoise, known, noise_of_characterisation

#: Factor beyond the converter's range of a full well that was not observed, so that it clips nothing.
_BEYOND = 1.1
#: Doubling of the dark current in kelvin where it was not measured: typical of silicon near room temperature.
_TYPICAL_DOUBLING_K = 8.0
#: Assumed temperature of frames without one; the dark current is stated for it, so results do not depend on it.
_UNKNOWN_TEMPERATURE_C = 25.0


@dataclass(frozen=True)
class TwinParameters:
    """Parameters of a camera for an imaging chain, at the gain of the session.

    Parameters
    ----------
    noise : CameraNoise
        System gain, noise and non-uniformity.
    dark : DarkModel
        d(t), the mean dark signal.
    responsivity : Quantity
        R, DN s^-1 / (cd m^-2) on the optical axis. Its uncertainty is relative to the session's meter, whose scale
        error is common to R and the readings and cancels.
    dark_current_e_s : Quantity
        Mean dark current at `temperature_c`; 0 if the dark signal does not grow with the exposure.
    efficiency, full_well_e, doubling_temperature_c : Quantity
        Quantum efficiency times transmittance of the lens (electrons per photon that reaches the lens); full well in
        electrons (the note says if it is only a lower bound); difference of temperature that doubles the dark current.
    temperature_c : float
        Temperature of the sensor.
    transmittance : float
        The part of `efficiency` assigned to the lens.
    bits, pixel_pitch_m, gain_db : int, float, float
        Bits of the converter, distance of pixel centres, and gain of the session.
    findings : tuple of Finding
        What the twin cannot represent, or assumes.
    pattern_taken_off_dn : float
        Standard deviation of a dark pattern that is subtracted from the frames; 0 if none is.
    """

    noise: CameraNoise
    dark: DarkModel
    responsivity: Quantity
    dark_current_e_s: Quantity
    efficiency: Quantity
    full_well_e: Quantity
    doubling_temperature_c: Quantity
    temperature_c: float
    transmittance: float
    bits: int
    pixel_pitch_m: float
    gain_db: float
    findings: tuple[Finding, ...]
    pattern_taken_off_dn: float = 0.0

    def dark_dn(self, exposure_s: float) -> float:
        """Mean dark signal at the temperature of the twin."""
        return self.dark.mean_dn(exposure_s, self.temperature_c)

    def dark_standard_uncertainty_dn(self, exposure_s: float) -> float:
        """Return the standard uncertainty of `dark_dn`."""
        return sqrt(self.dark.variance_dn2(exposure_s, self.temperature_c))

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """All parameters with uncertainties, in electrons and at the session's gain, by their names in a chain file."""
        noise, k = self.noise, self.noise.k_dn_per_e.value

        def in_electrons(name: str, unit: str) -> Quantity:
            found: Quantity = getattr(noise, name)
            rel_of_k = found.value * known(noise.k_dn_per_e) / k
            return Quantity(found.value / k, hypot(known(found), rel_of_k) / k, unit, found.note)

        offset = self.dark.offset_dn, sqrt(self.dark.offset_variance_dn2)
        return {
            "k_dn_per_e": noise.k_dn_per_e,
            "read_noise_e": in_electrons("read_noise_dn", "e-"),
            "black_level_dn": Quantity(*offset, "DN", "dark frames at zero exposure"),
            "dark_current_e_s": self.dark_current_e_s,
            "doubling_temperature_c": self.doubling_temperature_c,
            "prnu_rel": noise.prnu_rel,
            "dsnu_e": in_electrons("dsnu_dn", "e-"),
            "column_dsnu_e": in_electrons("column_dsnu_dn", "e-"),
            "row_dsnu_e": in_electrons("row_dsnu_dn", "e-"),
            "dsnu_e_s": in_electrons("dsnu_dn_s", "e-/s"),
            "full_well_e": self.full_well_e,
            "quantum efficiency x transmittance": self.efficiency,
            "responsivity": self.responsivity,
        }

    def sensor(self, shape: tuple[int, int], exposure_s: float | None = None) -> Sensor:
        """Return the sensor; its K at 0 dB is K at the session's gain.

        Parameters
        ----------
        shape : (int, int)
            Height and width in pixels.
        exposure_s : float or None
            Exposure at which the mean dark signal equals that of the calibration, whatever the dark current; None for
            the dark signal at zero exposure.
        """
        noise, k = self.noise, self.noise.k_dn_per_e.value
        current_e_s = self.dark_current_e_s.value
        t = 0.0 if exposure_s is None else exposure_s
        lines = (noise.row_dsnu_dn, noise.column_dsnu_dn, noise.read_noise_dn)
        dsnu_dn = self.pattern_taken_off_dn or noise.dsnu_dn.value
        spread_dn2 = (
            dsnu_dn**2
            + sum(part.value**2 for part in lines)
            + (noise.dsnu_dn_s.value * t) ** 2
            + k * k * current_e_s * t
        )
        black_dn = mean_before_rounding(self.dark_dn(t), spread_dn2) - k * current_e_s * t
        height, width = shape
        return Sensor(
            pixel_pitch_m=self.pixel_pitch_m,
            width=width,
            height=height,
            quantum_efficiency=self.efficiency.value / self.transmittance,
            full_well_e=self.full_well_e.value,
            k_dn_per_e=k,
            read_noise_e=noise.read_noise_dn.value / k,
            dark_current_e_s=current_e_s,
            bits=self.bits,
            black_level_dn=min(max(black_dn, 0.0), 2.0**self.bits - 1),
            reference_temperature_c=self.temperature_c,
            doubling_temperature_c=self.doubling_temperature_c.value,
            prnu_rel=min(noise.prnu_rel.value, 0.1),
            dsnu_e=noise.dsnu_dn.value / k,
            column_dsnu_e=noise.column_dsnu_dn.value / k,
            row_dsnu_e=noise.row_dsnu_dn.value / k,
            # A dark current that varies between pixels has a mean above 0.
            dsnu_e_s=noise.dsnu_dn_s.value / k if current_e_s > 0 else 0.0,
        )

    def with_noise(self, noise: CameraNoise) -> TwinParameters:
        """Return the twin with other noise; mean dark signal and signal in DN are unchanged."""
        k, before = noise.k_dn_per_e.value, self.noise.k_dn_per_e.value
        current = replace(self.dark_current_e_s, value=self.dark_current_e_s.value * before / k)
        full_well = replace(self.full_well_e, value=self.full_well_e.value * before / k)
        return replace(self, noise=noise, dark_current_e_s=current, full_well_e=full_well)


def require_monochrome(session: Session) -> Frame:
    """Return the first light frame of a session; raises CalibrationError without one, or for colour filters."""
    records = session.frames("light")
    if not records:
        raise CalibrationError("the session has no light frames: go on with the acquisition")
    frame = session.load(records[0])
    if frame.colour_filter is not None or frame.plane is not None:
        raise CalibrationError(
            f"the camera has a colour filter ({frame.colour_filter or frame.plane}): twins of colour cameras are not "
            "supported, record the session with a monochrome camera"
        )
    return frame


def twin_parameters(
    session: Session, observed: ObservedSession, calibration: Calibration, found: Characterisation
) -> TwinParameters:
    """Turn calibration and noise into the parameters of an imaging chain.

    Parameters
    ----------
    session, observed : Session, ObservedSession
        To read frames from, and what `observe_session` returned.
    calibration, found : Calibration, Characterisation
        Of this camera.

    Raises
    ------
    CalibrationError
        If the camera has colour filters, no quantum efficiency up to 1 gives the calibrated responsivity, or the gain
        was not calibrated.
    """
    frame = require_monochrome(session)
    configuration = observed.configuration
    setting = calibration.settings[index_of_gain(calibration.settings, frame.gain_db)]
    noise = noise_of_characterisation(found)
    findings = [one.within("characterisation") for one in found.findings]
    temperature_c = frame.temperature_c
    if temperature_c is None:
        temperature_c = setting.dark.temperature_c or _UNKNOWN_TEMPERATURE_C
        findings.append(info("twin-temperature-assumed", temperature_c=temperature_c))
    current = _dark_current(setting.dark, temperature_c, noise.k_dn_per_e, findings)
    transmittance = configuration.lens.transmittance or 1.0
    responsivity = _responsivity(observed, calibration, setting.factor)
    common_rel = hypot(known(responsivity) / responsivity.value, calibration.meter_scale.common_rel)
    area_m2 = pixel_area_m2(configuration.camera.pixel_pitch_m, frame.readout)
    efficiency = _efficiency(configuration, area_m2, responsivity.value, common_rel, noise.k_dn_per_e)
    if efficiency.value > transmittance:
        transmittance = 1.0
    if configuration.lens.transmittance is None:
        findings.append(info("twin-transmittance-unknown"))
    if calibration.response.kind != "linear":
        findings.append(info("twin-response-not-linear", response=calibration.response.kind))
    doubling = found.doubling_temperature_c
    if doubling is None:
        doubling = Quantity(_TYPICAL_DOUBLING_K, nan, "K", "assumed, typical of silicon")
        findings.append(info("twin-doubling-assumed", doubling_k=_TYPICAL_DOUBLING_K, temperature_c=temperature_c))
    return TwinParameters(
        noise=noise,
        dark=setting.dark,
        responsivity=responsivity,
        dark_current_e_s=current,
        efficiency=efficiency,
        full_well_e=_full_well(frame, setting.dark, noise, found, findings),
        doubling_temperature_c=doubling,
        temperature_c=temperature_c,
        transmittance=transmittance,
        bits=frame.bit_depth,
        pixel_pitch_m=sqrt(area_m2),
        gain_db=frame.gain_db,
        findings=tuple(findings),
    )


def _dark_current(dark: DarkModel, temperature_c: float, k: Quantity, findings: list[Finding]) -> Quantity:
    if len(dark.exposures_s) == 1:
        findings.append(info("twin-dark-current-unknown"))
        return Quantity(0.0, nan, "e-/s", "not known: dark frames at one exposure")
    rate_dn_s = dark.mean_dn(1.0, temperature_c) - dark.offset_dn
    value = max(rate_dn_s, 0.0) / k.value
    growth = rate_dn_s / dark.rate_dn_s if dark.rate_dn_s else 1.0
    uncertainty = hypot(growth * sqrt(dark.rate_variance_dn2_s2), value * known(k)) / k.value
    note = "growth of the darkness over K" if rate_dn_s > 0 else "the darkness does not grow with the exposure"
    return Quantity(value, uncertainty, "e-/s", note)


def _responsivity(observed: ObservedSession, calibration: Calibration, gain_factor: float) -> Quantity:
    """R with its uncertainty relative to the readings of this session; the scale of another meter does not cancel."""
    fit = calibration.responsivity
    rel = fit.random_rel
    if not observed.meter_scale.is_as_in(calibration.meter_scale):
        rel = hypot(rel, calibration.meter_scale.common_rel, observed.meter_scale.common_rel)
    value = gain_factor * fit.responsivity_dn_s_cd_m2
    return Quantity(value, rel * value, "DN/(cd m^-2 s)", "calibration, without the scale error of the meter")


def _efficiency(session: SessionConfiguration, area_m2: float, r: float, common_rel: float, k: Quantity) -> Quantity:
    """Quantum efficiency times transmittance that give R with the configured lens, pitch and spectrum."""
    optics = Optics(f_number=session.lens.f_number, transmittance=1.0)
    try:
        photons_per_lx_s = photon_radiance_per_cd_m2(session.source.spectrum) * area_m2
    except InputError as error:
        raise CalibrationError(f"the twin needs the spectrum of the light: {error}") from error
    value = r / (k.value * optics.axial_illuminance_per_cd_m2 * photons_per_lx_s)
    if value > 1:
        raise CalibrationError(
            f"quantum efficiency times transmittance would be {value:.3g}, more than 1: check the f-number "
            f"(f/{session.lens.f_number:g}), the pixel pitch ({session.camera.pixel_pitch_m * 1e6:g} um) and the "
            f"spectrum ({session.source.spectrum}) of the session"
        )
    rel = hypot(common_rel, known(k) / k.value)
    return Quantity(value, value * rel, "1", "from R and K by the configured lens, pixel pitch and spectrum")


def _full_well(
    frame: Frame, dark: DarkModel, noise: CameraNoise, found: Characterisation, findings: list[Finding]
) -> Quantity:
    """Electrons at saturation; above the converter's range if the converter saturates first."""
    k = noise.k_dn_per_e.value
    last_dn = 2**frame.bit_depth - 1
    room_dn = frame.saturation_dn - dark.offset_dn
    if room_dn <= 0:
        raise CalibrationError(
            f"the darkness of {dark.offset_dn:.4g} DN is not below saturation ({frame.saturation_dn:g} DN): check the "
            "dark frames"
        )
    if frame.saturation_dn < last_dn:
        # A sensor counts as saturated some standard deviations below its full well.
        parts = (noise.read_noise_dn, noise.dsnu_dn, noise.column_dsnu_dn, noise.row_dsnu_dn)
        spread_dn = hypot(*(part.value for part in parts))
        full_e = (room_dn + Sensor.SPREADS_BELOW_FULL * spread_dn) / k
        return Quantity(full_e, nan, "e-", "from the saturation the frames state")
    if found.saturation_limit == "full well" and isfinite(found.full_well_e.value):
        return found.full_well_e
    if found.saturation_limit != "converter":  # Else the characterisation says so.
        findings.append(info("twin-full-well-lower-limit"))
    return Quantity(_BEYOND * room_dn / k, nan, "e-", "a lower limit: the converter ends first")
