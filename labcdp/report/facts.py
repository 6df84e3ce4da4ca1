"""The calibration, and where everything comes from, as facts with names."""

from __future__ import annotations

from importlib.metadata import version
from math import hypot, sqrt
from typing import TYPE_CHECKING, NamedTuple

from ..calibration import expanded_half_width
from .digits import Z_95, exposures, fixed, printable, significant, with_half_width
from .wording import minute, recorded

if TYPE_CHECKING:
    from ..calibration import Calibration, GainSetting, LensIdentity
    from ..evaluate import SessionEvaluation
    from ..reading import MeterIdentity
    from ..session import LensConfiguration
    from ..vignetting import AnyVignetting

#: A chi^2 less probable than this, on either side, is worth a word.
_IMPROBABLE = 0.01


class Fact(NamedTuple):
    """A named value, as text.

    Parameters
    ----------
    name, value : str
        The value with its unit.
    """

    name: str
    value: str


def calibration_facts(calibration: Calibration) -> list[Fact]:
    """Tell the calibration: responsivity, darkness, noise, how well it fits and where it holds."""
    fit, dark, noise = calibration.responsivity, calibration.dark, calibration.noise
    r = fit.responsivity_dn_s_cd_m2
    half_width = r * expanded_half_width(calibration.meter_scale.half_width_rel, fit.random_rel)
    offset = with_half_width(dark.offset_dn, Z_95 * sqrt(dark.offset_variance_dn2))
    facts = [
        Fact("Model", _model(calibration)),
        *_response(calibration),
        Fact("Responsivity R", f"{with_half_width(r, half_width)} DN s⁻¹ / (cd m⁻²), 95 %"),
        Fact(
            "of which the fit alone",
            f"± {significant(100 * Z_95 * fit.random_rel, 2)} % (95 %); the rest is the meter's scale, "
            f"± {100 * calibration.meter_scale.half_width_rel:g} % (limits)",
        ),
        Fact("Goodness of fit", _goodness(calibration)),
        Fact("Test of a free intercept", _intercept(calibration)),
        Fact("Darkness d(t)", f"({offset}) DN at zero exposure{_dark_rate(calibration)}"),
        *_dark_temperature(calibration),
        Fact("Dark noise", f"{significant(noise.dark_noise_dn, 3)} DN (temporal, one pixel)"),
        Fact("Slow change of the darkness across the sensor", _slow_change(dark.nonuniformity_dn)),
        Fact("Overall system gain K", _gain(calibration)),
        *(
            Fact(f"Gain {gain.gain_db:g} dB", f"{_factor(gain)} times the responsivity; {_dark_of_gain(gain)}")
            for gain in calibration.gains
        ),
        Fact("Vignetting V(x, y)", _vignetting(calibration.vignetting, calibration.state.image_shape)),
        Fact("Calibrated luminance", _range(calibration)),
        Fact("Calibrated signal above dark", _signal_range(calibration)),
        Fact("Calibrated exposures", exposures(calibration.exposures_s)),
        Fact("Lens", lens_text(calibration.lens)),
        Fact("Luminance meter", meter_text(calibration.meter_scale.meter)),
        Fact("Light", f"{calibration.source_spectrum}; not valid for another spectrum without a V(λ) filter"),
        Fact("Readings taken", f"up to {minute(calibration.provenance.measured)}"),
    ]
    return _printable(facts)


def _model(calibration: Calibration) -> str:
    if calibration.response.kind == "linear":
        return "DN = d(t) + R t V(x, y) L, with exposure t and luminance L"
    return "h(DN - d(t)) = R t V(x, y) L, with exposure t, luminance L and the response h"


def _response(calibration: Calibration) -> list[Fact]:
    """Tell how far a response that is not linear bends; nothing of a linear one."""
    response, top = calibration.response, calibration.range_net_dn[1]
    if response.kind == "linear":
        return []
    bend = float(response.linearise(top)) / top - 1
    names = {"quadratic": "quadratic", "pchip": "monotone cubic (PCHIP)", "table": "table"}
    text = f"{names[response.kind]}; h differs from a straight line by {fixed(100 * bend, 2, sign=True)} %"
    return [Fact("Response h", f"{text} at the highest calibrated signal, {significant(top, 4)} DN above dark")]


def _dark_temperature(calibration: Calibration) -> list[Fact]:
    dark = calibration.dark
    if dark.temperature_c is None:
        return []
    doubling = dark.doubling_temperature_c
    grows = "" if doubling is None else f"; it doubles every {significant(doubling, 2)} °C"
    return [Fact("Temperature of the dark frames", f"{fixed(dark.temperature_c, 1)} °C{grows}")]


def _factor(gain: GainSetting) -> str:
    return with_half_width(gain.factor, Z_95 * gain.factor * gain.factor_random_rel)


def _dark_of_gain(gain: GainSetting) -> str:
    return (
        f"darkness {fixed(gain.dark.offset_dn, 2)} DN + {significant(gain.dark.rate_dn_s, 3)} DN/s t, "
        f"K {significant(gain.noise.k_dn_per_e, 3)} DN/e⁻, dark noise {significant(gain.noise.dark_noise_dn, 3)} DN"
    )


def _signal_range(calibration: Calibration) -> str:
    low, high = calibration.range_net_dn
    return f"{significant(low, 3)} to {significant(high, 4)} DN"


def _goodness(calibration: Calibration) -> str:
    from scipy.special import chdtrc

    fit = calibration.responsivity
    if fit.degrees_of_freedom == 0:
        return "not known: one patch only"
    chance = float(chdtrc(fit.degrees_of_freedom, fit.chi_squared))
    if chance < _IMPROBABLE:
        verdict = "the patches scatter more than their stated errors; the uncertainty was widened"
    elif chance > 1 - _IMPROBABLE:
        verdict = "the patches scatter less than their stated errors"
    else:
        verdict = "the patches scatter as their stated errors say"
    return (
        f"χ² = {significant(fit.chi_squared, 3)} with {fit.degrees_of_freedom} degrees of freedom "
        f"(reduced {significant(fit.reduced_chi_squared, 2)}): {verdict}"
    )


def _intercept(calibration: Calibration) -> str:
    fit = calibration.responsivity
    if fit.intercept_dn_s is None or fit.intercept_standard_uncertainty_dn_s is None:
        return "not possible: all patches have about the same luminance"
    half_width = Z_95 * fit.intercept_standard_uncertainty_dn_s
    verdict = (
        "none is needed, the line goes through zero"
        if abs(fit.intercept_dn_s) <= half_width
        else "the line misses zero; this points to stray light or a wrong darkness"
    )
    return f"{with_half_width(fit.intercept_dn_s, half_width)} DN/s (95 %): {verdict}"


def _dark_rate(calibration: Calibration) -> str:
    dark = calibration.dark
    if len(dark.exposures_s) == 1:
        return "; taken at one exposure, so its growth is not known"
    return f", growing by ({with_half_width(dark.rate_dn_s, Z_95 * sqrt(dark.rate_variance_dn2_s2))}) DN/s; 95 %"


def _slow_change(nonuniformity_dn: float) -> str:
    return f"{significant(nonuniformity_dn, 2)} DN (standard deviation)" if nonuniformity_dn > 0 else "not significant"


def _gain(calibration: Calibration) -> str:
    k = calibration.noise.k_dn_per_e
    return f"{significant(k, 3)} DN/e⁻, by photon transfer" if k > 0 else "not known: see the warnings"


def _vignetting(vignetting: AnyVignetting | None, shape: tuple[int, int]) -> str:
    from ..vignetting import Cos4Vignetting, RadialVignetting

    if vignetting is None:
        return "1: no fall-off was taken off"
    if isinstance(vignetting, Cos4Vignetting):
        # A sensor of one row as long as the diagonal ends as far from the axis as the corner.
        diagonal = round(hypot(shape[0] - 1, shape[1] - 1)) + 1
        corner = vignetting.relative_illuminance((1, diagonal))[0, 0]
        return (
            f"cos⁴ of the off-axis angle, by a focal length of {vignetting.focal_length_m * 1e3:g} mm and a pixel "
            f"pitch of {vignetting.pixel_pitch_m * 1e6:g} µm; {fixed(100 * corner, 1)} % in the corners"
        )
    lowest, highest = _extremes(vignetting, shape)
    slow = f"uncertain by {significant(100 * vignetting.slow_rel, 2)} % over the image (standard)"
    if isinstance(vignetting, RadialVignetting):
        return (
            f"1 {_signed(vignetting.a2)} r² {_signed(vignetting.a4)} r⁴ {_signed(vignetting.a6)} r⁶, with r = 1 in the "
            f"corners; down to {fixed(100 * lowest, 1)} %, {slow}"
        )
    return (
        f"flat field of every pixel from {vignetting.n_frames} frames, {fixed(100 * lowest, 1)} to "
        f"{fixed(100 * highest, 1)} %, {slow}"
    )


def _extremes(vignetting: AnyVignetting, shape: tuple[int, int]) -> tuple[float, float]:
    values = vignetting.relative_illuminance(shape)
    return float(values.min()), float(values.max())


def _signed(value: float) -> str:
    return f"{'-' if value < 0 else '+'} {significant(abs(value), 3)}"


def _range(calibration: Calibration) -> str:
    low, high = calibration.range_cd_m2
    return f"{significant(low, 3)} to {significant(high, 3)} cd/m²"


def lens_text(lens: LensIdentity | LensConfiguration) -> str:
    """Name a lens as a person would."""
    serial = f" ({lens.serial})" if lens.serial else ""
    return f"{lens.model}{serial}, focal length {lens.focal_length_m * 1e3:g} mm, f/{lens.f_number:g}"


def meter_text(meter: MeterIdentity) -> str:
    """Name a luminance meter as a person would."""
    return (
        f"{meter.model}, serial number {meter.serial}, calibrated {meter.calibration_date or '(date not known)'}"
        f"{', simulated' if meter.simulated else ''}"
    )


def provenance_facts(evaluation: SessionEvaluation) -> list[Fact]:
    """Tell where the numbers come from: devices, settings, inputs and programs."""
    observed, configuration = evaluation.observed, evaluation.observed.configuration
    calibration, state = evaluation.calibration, evaluation.calibration.state
    first, last = recorded(evaluation)
    meters = dict.fromkeys(meter_text(r.meter) for readings in observed.readings.values() for r in readings)
    height, width = state.image_shape
    facts = [
        Fact("Session", configuration.name),
        Fact("Operator", configuration.operator),
        Fact("Notes", configuration.notes),
        Fact("Target", configuration.target.name),
        Fact("Meter readings", f"{minute(first)} to {minute(last)}"),
        Fact("Camera", str(state.camera)),
        Fact(
            "Camera settings",
            f"{state.pixel_format}, {state.bit_depth} bit, {width} x {height} pixels, gain {state.gain_db:g} dB, "
            f"saturated from {state.saturation_dn:g} DN",
        ),
        Fact("Exposures", exposures({o.exposure_s for n in observed.names for o in observed.of_patch(n)})),
        Fact("Lens", lens_text(configuration.lens)),
        Fact("Luminance meter", "; ".join(meters)),
        Fact("Light", configuration.source.spectrum),
        Fact("SHA-256 of frames and readings", observed.input_sha256),
        Fact("SHA-256 of those of the calibration", calibration.provenance.input_sha256),
        Fact("Calibrated with", ", ".join(f"{name} {text}" for name, text in calibration.provenance.versions.items())),
        Fact("Report written by", f"labcdp {version('labcdp')}"),
    ]
    return _printable([fact for fact in facts if fact.value])


def _printable(facts: list[Fact]) -> list[Fact]:
    return [Fact(fact.name, printable(fact.value)) for fact in facts]
