"""A calibration as named quantities, and the conditions it is valid for."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from math import hypot, inf, sqrt

from ...calibration import AnyCalibration, Calibration, CameraState, LensIdentity
from ...calibration.colour.model import ColourCalibration
from ...calibration.setup import MeterScale
from ...calibration.uncertainty import expanded_rel
from ...core.reading import MeterIdentity
from ...core.result import NamedValue
from ...core.vignetting import Cos4Vignetting, RadialVignetting
from ...report.layout import page_text
from ...report.text import exposures, minute, percent, significant
from ...session import LensConfiguration

#: Unit of a responsivity.
RESPONSIVITY = "DN s⁻¹ / (cd m⁻²)"


def response_name(kind: str) -> str:
    """Return the name of a kind of response."""
    return "monotone cubic (PCHIP)" if kind == "pchip" else kind


def range_text(calibration: AnyCalibration) -> str:
    """Return the calibrated range of luminance, the same wherever it is stated."""
    low, high = calibration.range_cd_m2
    return f"{significant(low, 4)} to {significant(high, 4)} cd/m²"


def quantities(calibration: AnyCalibration) -> list[NamedValue]:
    """Return the numbers of a calibration that are not those of a patch or plane."""
    low, high = calibration.range_cd_m2
    limits = [
        NamedValue("lowest calibrated luminance", low, "cd/m²", "of the patches, from meter or camera"),
        NamedValue("highest calibrated luminance", high, "cd/m²", "of the patches, from meter or camera"),
        NamedValue("shortest calibrated exposure", 1e3 * calibration.exposures_s[0], "ms"),
        NamedValue("longest calibrated exposure", 1e3 * calibration.exposures_s[-1], "ms"),
        _meter(calibration.meter_scale),
    ]
    if isinstance(calibration, Calibration):
        return [*_fit_quantities(calibration), *_dark_quantities(calibration), *_gain_quantities(calibration), *limits]
    return [*_combination_quantities(calibration), *limits]


def _meter(scale: MeterScale) -> NamedValue:
    if scale.certificate is None:
        return NamedValue(
            "limits of the meter's scale error", scale.limits_rel, "%", "rectangular, ± by the data sheet"
        )
    meaning = f"certificate {scale.certificate.number}, k = {scale.certificate.coverage_factor:g}"
    return NamedValue("U of the meter's scale", scale.certificate.expanded_uncertainty_rel, "%", meaning)


def responsivity(calibration: Calibration) -> NamedValue:
    """Return the responsivity with the uncertainty of fit and meter scale."""
    fit = calibration.responsivity
    r = fit.responsivity_dn_s_cd_m2
    expanded = r * expanded_rel([calibration.meter_scale], fit.random_rel, fit.dof or inf)
    u = r * hypot(calibration.meter_scale.common_rel, fit.random_rel)
    return NamedValue("responsivity R", r, RESPONSIVITY, "fit and meter scale", u, expanded)


def _fit_quantities(calibration: Calibration) -> Iterator[NamedValue]:
    from scipy.special import chdtrc

    fit, (low_dn, high_dn) = calibration.responsivity, calibration.range_net_dn
    yield responsivity(calibration)
    yield NamedValue(
        "U of R without the meter's scale", expanded_rel((), fit.random_rel, fit.dof or inf), "%", "of the fit alone"
    )
    yield NamedValue("χ² of the fit", fit.chi_squared, "", "of patches and exposures, with their stated errors")
    yield NamedValue("degrees of freedom", fit.degrees_of_freedom)
    if fit.degrees_of_freedom > 0:
        yield NamedValue("reduced χ²", fit.chi_squared / fit.degrees_of_freedom)
        p_value = float(chdtrc(fit.degrees_of_freedom, fit.chi_squared))
        yield NamedValue("p-value of χ²", p_value, "", "probability of more scatter by chance")
    intercept, u = fit.intercept_dn_s, fit.intercept_standard_uncertainty_dn_s
    yield NamedValue("intercept, as a test", intercept, "DN/s", "0 is expected: the line passes through zero", u)
    if calibration.response.kind != "linear":
        bend = float(calibration.response.linearise(high_dn)) / high_dn - 1
        yield NamedValue("non-linearity of the response", bend, "%", "deviation from a line at the highest signal")
    yield NamedValue("lowest calibrated signal", low_dn, "DN", "above the dark signal")
    yield NamedValue("highest calibrated signal", high_dn, "DN", "above the dark signal")
    k = calibration.noise.k_dn_per_e
    yield NamedValue("overall system gain K", k if k > 0 else None, "DN/e⁻", "by photon transfer")


def _dark_quantities(calibration: Calibration) -> Iterator[NamedValue]:
    dark = calibration.dark
    u = sqrt(dark.offset_variance_dn2)
    yield NamedValue("dark offset", dark.offset_dn, "DN", "mean dark signal at exposure time 0", u)
    if len(dark.exposures_s) > 1:
        u = sqrt(dark.rate_variance_dn2_s2)
        yield NamedValue("dark rate", dark.rate_dn_s, "DN/s", "growth of the dark signal with exposure time", u)
    yield NamedValue("dark noise", calibration.noise.dark_noise_dn, "DN", "temporal, of one pixel")
    yield NamedValue("dark non-uniformity", dark.nonuniformity_dn, "DN", "slow change across the sensor")
    if dark.temperature_c is not None:
        yield NamedValue("temperature of the dark frames", dark.temperature_c, "°C")
    if dark.doubling_temperature_c is not None:
        yield NamedValue("doubling temperature", dark.doubling_temperature_c, "°C", "of the dark rate")


def _gain_quantities(calibration: Calibration) -> Iterator[NamedValue]:
    for gain in calibration.gains:
        at, dark, of = f"at {gain.gain_db:g} dB", gain.dark, f"over that at {calibration.state.gain_db:g} dB"
        yield NamedValue(f"responsivity factor {at}", gain.factor, "", of, gain.factor * gain.factor_random_rel)
        yield NamedValue(f"dark offset {at}", dark.offset_dn, "DN", "", sqrt(dark.offset_variance_dn2))
        yield NamedValue(f"dark rate {at}", dark.rate_dn_s, "DN/s", "", sqrt(dark.rate_variance_dn2_s2))
        yield NamedValue(f"dark noise {at}", gain.noise.dark_noise_dn, "DN")
        yield NamedValue(f"K {at}", gain.noise.k_dn_per_e, "DN/e⁻")


def _combination_quantities(calibration: ColourCalibration) -> Iterator[NamedValue]:
    meaning = "u of a patch whose colours differ as much as their mean"
    yield NamedValue("deviation by colour", calibration.spectral_rel, "%", meaning)
    yield NamedValue("scatter between patches", calibration.scatter_rel, "%", "that nothing else explains")
    yield NamedValue(
        "f1' of the combination", calibration.f1_prime, "%", "mismatch of its spectral sensitivity and V(λ)"
    )


def conditions(calibration: AnyCalibration) -> list[tuple[str, str]]:
    """Return devices, settings and light of a calibration, and where it comes from."""
    state, provenance = calibration.state, calibration.provenance
    height, width = state.image_shape
    if isinstance(calibration, Calibration):
        gains = sorted([state.gain_db, *(gain.gain_db for gain in calibration.gains)])
        of_model = [("model", _model(calibration)), ("vignetting V(x, y)", _vignetting(calibration))]
    else:
        gains, of_model = [state.gain_db], [("model", "L = Σ w L over the colour planes")]
    return [
        *of_model,
        ("camera", str(state.camera)),
        ("pixel format", f"{pixels_text(state)}, {width} x {height} pixels"),
        ("black level", f"{_black_level(state)}; saturated from {state.saturation_dn:g} DN"),
        ("gain", ", ".join(f"{gain:g} dB" for gain in gains)),
        ("calibrated exposures", exposures(calibration.exposures_s)),
        ("lens", lens_text(calibration.lens)),
        ("luminance meter", meter_text(calibration.meter_scale.meter)),
        ("traceability", traceability(calibration.meter_scale, provenance.measured)),
        ("light", f"{calibration.source_spectrum}; not valid for another spectrum without a V(λ) filter"),
        ("last reading", minute(provenance.measured)),
        ("SHA-256 of frames and readings", provenance.input_sha256),
        ("calibrated with", ", ".join(f"{name} {text}" for name, text in provenance.versions.items())),
    ]


def _model(calibration: Calibration) -> str:
    response = response_name(calibration.response.kind)
    if response == "linear":
        return "DN = d(t) + R t V(x, y) L, with exposure time t and luminance L"
    return f"h(DN - d(t)) = R t V(x, y) L, with exposure time t, luminance L and a {response} response h"


def _vignetting(calibration: Calibration) -> str:
    vignetting, shape = calibration.vignetting, calibration.state.image_shape
    if vignetting is None:
        return "1: not corrected"
    if isinstance(vignetting, Cos4Vignetting):
        # A sensor of one row as long as the diagonal ends as far from the axis as the corner.
        diagonal = round(hypot(shape[0] - 1, shape[1] - 1)) + 1
        corner = vignetting.relative_illuminance((1, diagonal))[0, 0]
        by = {"focal_length_mm": 1e3 * vignetting.focal_length_m, "pixel_pitch_um": 1e6 * vignetting.pixel_pitch_m}
        shown = "-shown" if vignetting.log_corner else ""
        return page_text(f"vignetting-cos4{shown}", corner=100 * float(corner), corner_rel=vignetting.corner_rel, **by)
    image, slow_rel = vignetting.relative_illuminance(shape), vignetting.slow_rel
    ends = [100 * float(end) for end in (image.min(), image.max())]
    if isinstance(vignetting, RadialVignetting):
        terms = {name: getattr(vignetting, name) for name in ("a2", "a4", "a6")}
        signed = {name: f"{'-' if a < 0 else '+'} {significant(abs(a), 3)}" for name, a in terms.items()}
        return page_text("vignetting-radial", **signed, lowest=ends[0], slow_rel=slow_rel)
    return page_text("vignetting-flat-field", n_frames=vignetting.n_frames, ends=ends, slow_rel=slow_rel)


def lens_text(lens: LensIdentity | LensConfiguration) -> str:
    """Return model, serial number and settings of a lens."""
    serial = f" ({lens.serial})" if lens.serial else ""
    focus = "" if lens.focus_distance_m is None else f", focused at {lens.focus_distance_m:g} m"
    return f"{lens.model}{serial}, focal length {lens.focal_length_m * 1e3:g} mm, f/{lens.f_number:g}{focus}"


def traceability(scale: MeterScale, measured: datetime) -> str:
    """Return what the luminances of a time are traceable to, and whether mismatch and drift of the meter count."""
    certificate, mismatch = scale.certificate, ""
    if scale.mismatch_rel:
        mismatch = f"; f1' {100 * (scale.f1_prime or 0.0):g} % counts as mismatch in {scale.light} light"
    elif scale.f1_prime is None and not scale.in_own_light:
        mismatch = f"; mismatch of the meter in {scale.light} light not stated and not included"
    if certificate is None:
        return (
            f"none stated: accuracy of the data sheet, ± {100 * scale.limits_rel:g} % (limits, rectangular){mismatch}"
        )
    due = "" if certificate.due_date is None else f", due {certificate.due_date}"
    dof = "" if certificate.degrees_of_freedom is None else f", {certificate.degrees_of_freedom:g} degrees of freedom"
    factor = f"correction {certificate.correction:g}" if certificate.correction != 1 else "no correction"
    conditions = f"; {certificate.conditions}" if certificate.conditions else ""
    of_meter = (
        f", of {' '.join(part for part in (certificate.model, certificate.serial) if part)}"
        if certificate.model or certificate.serial
        else ""
    )
    limits = "" if certificate.range_cd_m2 is None else ", {:g} to {:g} cd/m²".format(*certificate.range_cd_m2)
    days = (measured.date() - certificate.date).days
    drift = (
        f"± {percent(scale.drift_rel, 2)} (limits)" if certificate.drift_rel_per_year else "not stated and not included"
    )
    since = f"; readings {abs(days)} days {'later' if days >= 0 else 'earlier, values as found'}, drift since {drift}"
    return (
        f"certificate {certificate.number} of {certificate.laboratory}, {certificate.date}{due}: {factor}, U = "
        f"{100 * certificate.expanded_uncertainty_rel:g} % (k = {certificate.coverage_factor:g}{dof}), illuminant "
        f"{certificate.illuminant}{of_meter}{limits}{conditions}{since}{mismatch}"
    )


def meter_text(meter: MeterIdentity) -> str:
    """Return model, serial number and calibration date of a luminance meter."""
    return (
        f"{meter.model}, serial number {meter.serial}, calibrated {meter.calibration_date or '(date not known)'}"
        f"{', simulated' if meter.simulated else ''}"
    )


def pixels_text(state: CameraState) -> str:
    """Return pixel format and bits, and the curve whose codes the pixels are."""
    curve = state.companding
    of_curve = "" if curve is None else f", codes of the curve {curve}"
    return f"{state.pixel_format}, {state.bit_depth} bit{of_curve}"


def _black_level(state: CameraState) -> str:
    if state.black_level_register is not None:
        return f"register at {state.black_level_register:g}"
    return "not stated" if state.black_level_dn is None else f"{state.black_level_dn:g} DN"
