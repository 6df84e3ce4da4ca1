"""Estimate of a twin's parameters from session, calibration and characterisation."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, isfinite, nan, sqrt
from typing import Any

from ...calibration import Calibration, DarkModel
from ...calibration.emva.result import Characterisation
from ...calibration.frames.observations import CameraState
from ...calibration.sensor.dark_fit import TYPICAL_DOUBLING_C
from ...calibration.sensor.noise import find_gain
from ...calibration.uncertainty import scales_apart
from ...chain import Sensor
from ...core.errors import CalibrationError, naming
from ...core.frame import Frame
from ...core.quantity import Quantity
from ...core.result import Finding, info, warning
from ...core.vignetting import FlatField
from ...session import Session, SessionConfiguration
from ..bench.corrections import photons_per_cd_m2_s, pixel_area_m2
from ..bench.observe import ObservedSession
from .parameters import MOST_PRNU_REL, TwinParameters

#: Factor beyond the converter's range of a full well that was not observed, so that it clips nothing.
_BEYOND = 1.1
#: Assumed temperature of frames without one; the dark current is stated for it, so results do not depend on it.
_UNKNOWN_TEMPERATURE_C = 25.0


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
    if CameraState.of(frame).has_hand_overs:
        raise CalibrationError(
            "the frames are companded or have more than 16 bits, of several captures: twins are those of a single "
            "capture; state the captures in a chain (labcdp sweep)"
        )
    return frame


def twin_parameters(
    observed: ObservedSession, calibration: Calibration, characterisation: Characterisation
) -> TwinParameters:
    """Turn calibration and noise into the parameters of an imaging chain.

    Parameters
    ----------
    observed : ObservedSession
        What `observe_session` returned.
    calibration, found : Calibration, Characterisation
        Of this camera.

    Raises
    ------
    CalibrationError
        If the camera has colour filters, no quantum efficiency up to 1 gives the calibrated responsivity, or the gain
        was not calibrated.
    """
    frame, configuration = require_monochrome(observed.session), observed.configuration
    setting = calibration.settings[find_gain(calibration.settings, frame.gain_db)]
    noise, k = noise_of_characterisation(characterisation), characterisation.k_dn_per_e
    findings = [finding.within("characterisation") for finding in characterisation.findings]
    temperature_c = frame.temperature_c
    if temperature_c is None:
        temperature_c = setting.dark.temperature_c or _UNKNOWN_TEMPERATURE_C
        findings.append(info("twin-temperature-assumed", temperature_c=temperature_c))
    transmittance = configuration.lens.transmittance or 1.0
    responsivity = _responsivity(observed, calibration, setting.factor)
    common_rel = hypot(responsivity.u_known / responsivity.value, calibration.meter_scale.common_rel)
    area_m2 = pixel_area_m2(configuration.camera.pixel_pitch_m, frame.readout)
    efficiency = _efficiency(configuration, area_m2, responsivity.value, common_rel, k)
    if efficiency.value > transmittance:
        transmittance = 1.0
    if configuration.lens.transmittance is None:
        findings.append(info("twin-transmittance-unknown"))
    if calibration.response.kind != "linear":
        findings.append(info("twin-response-not-linear", response=calibration.response.kind))
    if noise["prnu_rel"].value > MOST_PRNU_REL:
        findings.append(warning("twin-prnu-limited", prnu_rel=noise["prnu_rel"].value, most_rel=MOST_PRNU_REL))
    doubling = characterisation.doubling_temperature_c
    if doubling is None:
        doubling = Quantity(TYPICAL_DOUBLING_C, nan, "K", "assumed, typical of silicon")
        findings.append(info("twin-doubling-assumed", doubling_k=TYPICAL_DOUBLING_C, temperature_c=temperature_c))
    return TwinParameters(
        **noise,
        dark=setting.dark,
        responsivity=responsivity,
        dark_current_e_s=_dark_current(setting.dark, temperature_c, k, findings),
        efficiency=efficiency,
        full_well_e=_full_well(frame, setting.dark, noise, characterisation, findings),
        doubling_temperature_c=doubling,
        temperature_c=temperature_c,
        transmittance=transmittance,
        bits=frame.bit_depth,
        pixel_pitch_m=sqrt(area_m2),
        gain_db=frame.gain_db,
        findings=tuple(findings),
        library=calibration.dark_library,
        flat_field=calibration.vignetting if isinstance(calibration.vignetting, FlatField) else None,
    )


def noise_of_characterisation(characterisation: Characterisation) -> dict[str, Any]:
    """Return K and the noise that a characterisation after EMVA 1288 states, as `TwinParameters` has them.

    Missing values are 0. So is a spread whose variance was less than that of its noise, which is stated as negative.
    """
    k = characterisation.k_dn_per_e

    def in_dn(quantity: Quantity | None, unit: str) -> Quantity:
        if quantity is None or not isfinite(quantity.value):
            return Quantity(0.0, 0.0, unit, "not known")
        # Measured in DN: the uncertainty of K entered with the conversion to electrons, and is removed again.
        u = sqrt(max(quantity.u_known**2 - (quantity.value * k.u_known / k.value) ** 2, 0.0))
        return Quantity(max(quantity.value, 0.0) * k.value, u * k.value, unit, quantity.note)

    prnu = characterisation.prnu_pixel_rel or characterisation.prnu_rel or Quantity(0.0, 0.0, "1", "not known")
    return {
        "k_dn_per_e": k,
        "read_noise_dn": in_dn(characterisation.dark_noise_e, "DN"),
        "prnu_rel": replace(prnu, value=max(prnu.value, 0.0)),
        "dsnu_dn": in_dn(characterisation.dsnu_pixel_e or characterisation.dsnu_e, "DN"),
        "row_dsnu_dn": in_dn(characterisation.dsnu_row_e, "DN"),
        "column_dsnu_dn": in_dn(characterisation.dsnu_column_e, "DN"),
        "dsnu_dn_s": in_dn(characterisation.dsnu_e_s, "DN/s"),
    }


def _dark_current(dark: DarkModel, temperature_c: float, k: Quantity, findings: list[Finding]) -> Quantity:
    if len(dark.exposures_s) == 1:
        findings.append(info("twin-dark-current-unknown"))
        return Quantity(0.0, nan, "e-/s", "not known: dark frames at one exposure")
    rate_dn_s = dark.mean_dn(1.0, temperature_c) - dark.offset_dn
    growth = rate_dn_s / dark.rate_dn_s if dark.rate_dn_s else 1.0
    rate = Quantity(max(rate_dn_s, 0.0), growth * sqrt(dark.rate_variance_dn2_s2), "DN/s")
    note = "growth of the dark signal over K" if rate_dn_s > 0 else "the dark signal does not grow with the exposure"
    return rate.over(k, "e-/s", note)


def _responsivity(observed: ObservedSession, calibration: Calibration, gain_factor: float) -> Quantity:
    """R with its uncertainty relative to the readings of this session; the scale of another meter does not cancel."""
    fit = calibration.responsivity
    scales = scales_apart(observed.meter_scale, calibration.meter_scale)
    rel = hypot(fit.random_rel, *(scale.common_rel for scale in scales))
    value = gain_factor * fit.responsivity_dn_s_cd_m2
    return Quantity(value, rel * value, "DN/(cd m^-2 s)", "calibration, without the scale error of the meter")


def _efficiency(session: SessionConfiguration, area_m2: float, r: float, common_rel: float, k: Quantity) -> Quantity:
    """Quantum efficiency times transmittance that give R with the configured lens, pitch and spectrum."""
    with naming("the twin needs the spectrum of the light", CalibrationError):
        photons = photons_per_cd_m2_s(session.source.spectrum, session.lens.f_number, 1.0, area_m2)
    ratio = Quantity(r / photons, common_rel * r / photons, "DN/photon")
    efficiency = ratio.over(k, "1", "from R and K by the configured lens, pixel pitch and spectrum")
    if efficiency.value > 1:
        raise CalibrationError(
            f"quantum efficiency times transmittance would be {efficiency.value:.3g}, more than 1: check the f-number "
            f"(f/{session.lens.f_number:g}), the pixel pitch ({session.camera.pixel_pitch_m * 1e6:g} µm) and the "
            f"spectrum ({session.source.spectrum}) of the session"
        )
    return efficiency


def _full_well(
    frame: Frame,
    dark: DarkModel,
    noise: dict[str, Quantity],
    characterisation: Characterisation,
    findings: list[Finding],
) -> Quantity:
    """Electrons at saturation; above the converter's range if the converter saturates first."""
    k = characterisation.k_dn_per_e.value
    last_dn = 2**frame.bit_depth - 1
    room_dn = frame.saturation_dn - dark.offset_dn
    if room_dn <= 0:
        raise CalibrationError(
            f"the dark signal of {dark.offset_dn:.4g} DN is not below saturation ({frame.saturation_dn:g} DN): check "
            "the dark frames"
        )
    if frame.saturation_dn < last_dn:
        # A sensor counts as saturated some standard deviations below its full well.
        parts = ("read_noise_dn", "dsnu_dn", "column_dsnu_dn", "row_dsnu_dn")
        spread_dn = hypot(*(noise[name].value for name in parts))
        full_e = (room_dn + Sensor.SPREADS_BELOW_FULL * spread_dn) / k
        return Quantity(full_e, nan, "e-", "from the saturation the frames state")
    if characterisation.saturation_limit == "full well" and isfinite(characterisation.full_well_e.value):
        return characterisation.full_well_e
    if characterisation.saturation_limit != "converter":  # Else the characterisation says so.
        findings.append(info("twin-full-well-lower-limit"))
    return Quantity(_BEYOND * room_dn / k, nan, "e-", "a lower limit: the converter ends first")
