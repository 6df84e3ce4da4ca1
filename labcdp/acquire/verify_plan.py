"""Plan of a verification: two or three patches of a configuration at calibrated exposures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import log, sqrt

from ..calibration import AnyCalibration, Calibration
from ..calibration.frames.measure import plane_region
from ..calibration.frames.statistics import MIN_NET_SIGNAL
from ..core.errors import InputError
from ..session import PatchConfiguration, SessionConfiguration

#: Largest share of saturation of a patch.
_HIGHEST_SHARE = 0.9
#: Relative tolerance of the calibrated luminance range.
_RANGE_REL = 0.05


def verification_configuration(
    configuration: SessionConfiguration, calibration: AnyCalibration, patches: Sequence[str] = ()
) -> SessionConfiguration:
    """Derive the plan of a verification: the same devices and target, a few patches, calibrated exposures.

    Each patch gets the longest calibrated exposure at which it stays below 90 % of saturation; with colour filters one
    for each plane; a patch not known as grey by the calibration gets all exposures.

    Parameters
    ----------
    configuration : SessionConfiguration
        Bench, target and plan.
    calibration : Calibration or ColourCalibration
        Calibration to verify.
    patches : sequence of str
        Names of the patches; empty for the darkest, a middle and the brightest of those with such an exposure (grey
        ones with colour filters). Their luminance is taken from the calibration, else from the configuration.

    Returns
    -------
    SessionConfiguration
        Without contrasts; gain and pixel format are the calibration's.

    Raises
    ------
    InputError
        If a name is unknown or given twice, no patch can be chosen, or a named one is too bright or too dark.
    """
    known = {patch.name: patch for patch in configuration.target.patches}
    for index, name in enumerate(patches):
        if name not in known:
            raise InputError(f"there is no patch {name!r} to verify with: choose from {', '.join(known)}")
        if name in patches[:index]:
            raise InputError(f"patch {name!r} is given twice: name each patch once")
    luminance = _luminances(configuration, calibration)
    fitting = {name: _exposures_s(calibration, known[name], value) for name, value in luminance.items()}
    chosen = list(patches) or _choice(luminance, fitting, calibration)
    coloured = () if isinstance(calibration, Calibration) else set(luminance) - calibration.grey_patches
    exposures_s: set[float] = set()
    for name in chosen:
        if name not in luminance or name in coloured:
            # Its luminance is not known in advance: one of the calibrated exposures should fit.
            exposures_s |= set(calibration.exposures_s)
        elif not fitting[name]:
            raise InputError(
                f"patch {name!r} has about {luminance[name]:.3g} cd/m², for which no calibrated exposure gives a good "
                "signal: choose another patch"
            )
        else:
            exposures_s |= fitting[name]
    target = configuration.target.model_copy(update={"patches": tuple(known[name] for name in known if name in chosen)})
    plan = configuration.plan.model_copy(
        update={
            "exposures_s": tuple(sorted(exposures_s)),
            "gain_db": calibration.state.gain_db,
            "pixel_format": calibration.state.pixel_format,
        }
    )
    name = f"Verification: {configuration.name}"
    return configuration.model_copy(update={"name": name, "target": target, "plan": plan, "contrasts": ()})


def _luminances(configuration: SessionConfiguration, calibration: AnyCalibration) -> dict[str, float]:
    """Known luminances of the patches, in the target's order."""
    read = {row.patch: row.reading_cd_m2 for row in (*calibration.residuals, *calibration.held_out)}
    nominal = {patch.name: patch.nominal_luminance_cd_m2 for patch in configuration.target.patches}
    both = {name: read.get(name, value) for name, value in nominal.items()}
    return {name: value for name, value in both.items() if value is not None}


def _exposures_s(calibration: AnyCalibration, patch: PatchConfiguration, luminance_cd_m2: float) -> set[float]:
    """Longest calibrated exposure that leaves headroom, for each plane; empty if a plane has no good signal at any."""
    planes = calibration.planes
    longest = [_exposure_s(plane, patch, luminance_cd_m2) for plane in planes]
    fitting = {exposure_s for exposure_s in longest if exposure_s is not None}
    return set() if None in longest else fitting


def _exposure_s(calibration: Calibration, patch: PatchConfiguration, luminance_cd_m2: float) -> float | None:
    seen_cd_m2 = luminance_cd_m2 * _relative_illuminance(calibration, patch)
    fitting = []
    for exposure_s in calibration.exposures_s:
        net_dn, dark_dn = calibration.net_dn(seen_cd_m2, exposure_s), calibration.dark.mean_dn(exposure_s)
        noise_dn2 = calibration.noise.variance_dn2(net_dn, calibration.dark.noise_variance_dn2(exposure_s))
        bright_enough = net_dn >= MIN_NET_SIGNAL * sqrt(noise_dn2)
        if bright_enough and net_dn + dark_dn <= _HIGHEST_SHARE * calibration.state.saturation_dn:
            fitting.append(exposure_s)
    return max(fitting, default=None)


def _relative_illuminance(calibration: Calibration, patch: PatchConfiguration) -> float:
    if calibration.vignetting is None:
        return 1.0
    height, width = calibration.state.image_shape
    region = patch.region() if calibration.state.plane is None else plane_region(patch.region())
    x0, y0, x1, y1 = region.bounds
    x, y = min(int((x0 + x1) / 2), width - 1), min(int((y0 + y1) / 2), height - 1)
    return float(calibration.vignetting.relative_illuminance((height, width))[y, x])


def _choice(
    luminance: Mapping[str, float], fitting: Mapping[str, set[float]], calibration: AnyCalibration
) -> list[str]:
    low, high = calibration.range_cd_m2
    usable = [
        name
        for name, value in sorted(luminance.items(), key=lambda item: item[1])
        if fitting[name] and low * (1 - _RANGE_REL) <= value <= high * (1 + _RANGE_REL)
    ]
    if not isinstance(calibration, Calibration):
        grey = calibration.grey_patches
        usable = [name for name in usable if name in grey] or usable
    if not usable:
        raise InputError(
            "no patch of the configuration is known to lie within the calibrated range: name two or three patches"
        )
    darkest, brightest = usable[0], usable[-1]
    middle = (log(luminance[darkest]) + log(luminance[brightest])) / 2
    between = min(usable, key=lambda name: abs(log(luminance[name]) - middle))
    return list(dict.fromkeys((darkest, between, brightest)))
