"""Luminance of a patch by the calibrated camera, with its 95 % interval, and the contrast of two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, inf, sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.clock import exposure_text
from ...core.errors import CalibrationError
from ...core.luminance import RANGE_MARGIN, CommonError
from ...core.result import Finding, unique, warning
from ..camera import EXPOSURE_TIME, OF_FRAMES, CalibratedCamera, common_errors, placed
from ..frames.nonuniformity import vignetting_errors
from ..frames.observations import PatchObservation
from ..setup import METER_SOURCES
from ..signal import NetSignals, left_out_text, net_signals, temperature_findings, usable
from ..uncertainty import SMALL_EFFECT_REL, effective_dof, expanded_uncertainty, variance_from_one_estimate

#: Fraction of the calibrated signal range by which a signal may exceed it without a finding.
_RANGE_MARGIN = 0.05
#: Standard uncertainties beyond which a rim is no noise: by chance in 0.5 % of sessions of 3 patches in 4 planes.
_RIM_LIMIT = 3.5
#: Standard uncertainties within which a signal above the calibrated ones is confirmed by lower ones.
_CONFIRMED = 3.0

Array = NDArray[np.float64]


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
        Independent relative standard uncertainty of this patch: noise, pixels, dark signal non-uniformity, residual
        vignetting at its position, and unexplained scatter of the calibration's patches.
    common : tuple of CommonError
        Common errors of the patches of one calibration, as signed numbers; see `labcdp.calibration.common_errors`.
    exposures_s : tuple of float
        Exposures that were used.
    findings : tuple of Finding
        Findings on excluded exposures, temperatures not covered by the dark frames, and luminances or signals outside
        the calibrated range.
    scatter_rel, scatter_dof : float
        Part of `random_rel` by the scatter of the calibration's patches, and its degrees of freedom.
    rim_rel : float
        Part of it by light of the surroundings in the region.

    Examples
    --------
    >>> from labcdp.calibration import PatchLuminance
    >>> patch = PatchLuminance("a", 20.0, random_rel=0.01, common=(), exposures_s=(0.01,), findings=())
    >>> round(patch.U_rel, 4)
    0.0196
    """

    patch: str
    luminance_cd_m2: float
    random_rel: float
    common: tuple[CommonError, ...]
    exposures_s: tuple[float, ...]
    findings: tuple[Finding, ...]
    scatter_rel: float = 0.0
    scatter_dof: float = inf
    rim_rel: float = 0.0

    @property
    def fit_rel(self) -> float:
        """Relative standard uncertainty by the common errors without the meter's: fit, dark signal, exposure."""
        return sqrt(sum(float(e.relative) ** 2 for e in self.common if e.source not in METER_SOURCES))

    @property
    def common_rel(self) -> float:
        """Relative standard uncertainty by all common errors."""
        return sqrt(sum(float(e.relative) ** 2 for e in self.common))

    @property
    def u_rel(self) -> float:
        """Relative standard uncertainty by all errors."""
        return hypot(self.random_rel, self.common_rel)

    @property
    def U_rel(self) -> float:  # noqa: N802 - the symbol of the GUM
        """Relative expanded uncertainty U (95 %), as `expanded_uncertainty`."""
        return expanded_uncertainty(self._normal, self._rectangular)

    @property
    def dof(self) -> float:
        """Effective degrees of freedom of `u_rel` (JCGM 100:2008, G.4.1); infinite where few values play no part."""
        return effective_dof([*self._normal, *((u**2, inf) for u in self._rectangular)])

    @property
    def interval_95_cd_m2(self) -> tuple[float, float]:
        """Ends of the 95 % interval."""
        half_width = self.U_rel * self.luminance_cd_m2
        return self.luminance_cd_m2 - half_width, self.luminance_cd_m2 + half_width

    @property
    def _normal(self) -> list[tuple[float, float]]:
        return _parts([self], [error for error in self.common if not error.rectangular])

    @property
    def _rectangular(self) -> list[float]:
        return [float(error.relative) for error in self.common if error.rectangular]


def patch_luminance(calibration: CalibratedCamera, observations: Sequence[PatchObservation]) -> PatchLuminance:
    """Luminance of one patch from its observations at one or more exposures and gains.

    Parameters
    ----------
    calibration : CalibratedCamera
        Of the same camera and settings.
    observations : sequence of PatchObservation
        Of one patch, observed with the calibration's vignetting.

    Raises
    ------
    CalibrationError
        If there is no observation, observations are of several patches, of another camera, setting or
        vignetting, or the patch is clipped or black at every exposure.

    Examples
    --------
    >>> from labcdp import Session
    >>> from labcdp.calibration import observe_patches, patch_luminance
    >>> from labcdp.session import example_session
    >>> session = Session.open(example_session())
    >>> calibration = session.calibrate().calibration
    >>> light, patch = session.frames("light"), session.configuration.target.patches[-1]
    >>> frames = [session.load(r) for r in light if r.exposure_s == light[0].exposure_s]
    >>> seen = observe_patches(frames, [patch.region()], calibration.vignetting)
    >>> patch_luminance(calibration, seen).luminance_cd_m2 > 0
    True
    """
    observations = [o.with_vignetting(calibration.vignetting) for o in observations]
    names = sorted({o.patch for o in observations})
    if len(names) != 1:
        raise CalibrationError(f"observations are of patches {names}: give those of one patch at a time")
    for o in observations:
        name = f"patch {o.patch!r} at {exposure_text(o.exposure_s)}"
        calibration.require(o.state, name)
        if o.vignetting != calibration.vignetting:
            raise CalibrationError(
                f"{name} was observed with vignetting {o.vignetting}, the calibration has {calibration.vignetting}: "
                "observe it with the calibration's"
            )
    observations = [o.saturating_at(calibration.state.saturation_dn) for o in observations]
    kept, left_out, findings = usable(observations, calibration.settings)
    if not kept:
        raise CalibrationError(f"no exposure gives the luminance of a patch ({left_out_text(left_out)})")
    return _combined(calibration, kept, findings)


def is_within_response(calibration: CalibratedCamera, observation: PatchObservation) -> bool:
    """Whether a signal is within the fitted range of a response that is not linear, with a small margin."""
    dark = calibration.setting(observation.state.gain_db).dark
    net_dn = observation.net_dn_at_pixel(dark.mean_dn(observation.exposure_s, observation.temperature_c))
    return calibration.response.kind == "linear" or net_dn <= calibration.range_net_dn[1] * (1 + _RANGE_MARGIN)


def contrast_u(bright: PatchLuminance, dark: PatchLuminance) -> float:
    """Return the standard uncertainty of the Weber contrast K = L_bright / L_dark - 1 of two patches.

    u = (1 + K) sqrt(r_b^2 + r_d^2 + sum (c_b - c_d)^2) with the random parts r and the signed common parts c (JCGM
    100:2008, 5.2.2, for fully correlated errors). The meter's scale cancels exactly.

    Parameters
    ----------
    bright, dark : PatchLuminance
        By one calibration.

    Examples
    --------
    >>> from labcdp.calibration import PatchLuminance, contrast_u
    >>> bright = PatchLuminance("a", 20.0, random_rel=0.01, common=(), exposures_s=(0.01,), findings=())
    >>> dark = PatchLuminance("b", 10.0, random_rel=0.01, common=(), exposures_s=(0.01,), findings=())
    >>> round(contrast_u(bright, dark), 4)
    0.0283
    """
    return bright.luminance_cd_m2 / dark.luminance_cd_m2 * sqrt(sum(part for part, _ in _ratio_parts(bright, dark)))


def contrast_U(bright: PatchLuminance, dark: PatchLuminance) -> float:  # noqa: N802 - the symbol of the GUM
    """Return the expanded uncertainty U (95 %) of the contrast, as `contrast_u` with Student's t.

    Examples
    --------
    >>> from labcdp.calibration import PatchLuminance, contrast_U
    >>> bright = PatchLuminance("a", 20.0, random_rel=0.01, common=(), exposures_s=(0.01,), findings=())
    >>> dark = PatchLuminance("b", 10.0, random_rel=0.01, common=(), exposures_s=(0.01,), findings=())
    >>> round(contrast_U(bright, dark), 4)
    0.0554
    """
    return bright.luminance_cd_m2 / dark.luminance_cd_m2 * expanded_uncertainty(_ratio_parts(bright, dark))


def _ratio_parts(bright: PatchLuminance, dark: PatchLuminance) -> list[tuple[float, float]]:
    """Squares of the relative uncertainty of a ratio, with their degrees of freedom."""
    a, b = numbered(bright.common), numbered(dark.common)
    left = []
    for name in sorted(a.keys() | b.keys()):
        first, second = (errors.get(name, CommonError(name[0], 0.0)) for errors in (a, b))
        difference = float(first.relative) - float(second.relative)
        left.append(CommonError(name[0], difference, dof=min(first.dof, second.dof)))
    return _parts([bright, dark], left)


def _parts(patches: Sequence[PatchLuminance], common: Sequence[CommonError]) -> list[tuple[float, float]]:
    """Squares of relative uncertainties with their degrees of freedom, one for all that follow from one estimate."""
    independent = [(max(patch.random_rel**2 - patch.scatter_rel**2, 0.0), inf) for patch in patches]
    alike: dict[str, list[tuple[float, float]]] = {"fit": [], **{source: [] for source in OF_FRAMES}}
    for error in common:
        estimate = next((of for source, of in alike.items() if error.source.startswith(source)), independent)
        estimate.append((float(error.relative) ** 2, error.dof))
    alike["fit"] += [(patch.scatter_rel**2, patch.scatter_dof) for patch in patches]
    return [*independent, *map(variance_from_one_estimate, alike.values())]


def _combined(
    calibration: CalibratedCamera, observations: Sequence[PatchObservation], findings: list[Finding]
) -> PatchLuminance:
    observations = [o for o in observations if is_within_response(calibration, o)] or observations
    signals = net_signals(observations, calibration.settings)
    net, r = signals.net_dn, calibration.responsivity.responsivity_dn_s_cd_m2
    applied = np.array([calibration.exposure_times.applied_s(o.exposure_s) / o.exposure_s for o in observations])
    factor = np.array([setting.factor for setting in calibration.settings])[signals.gain_index]
    scale = signals.scale_per_s / (r * factor * applied)
    each = scale * calibration.response.linearise(net)
    slope = scale * calibration.response.slope(net)
    inverse = 1 / (slope**2 * signals.variance_dn2)
    weight = inverse / inverse.sum()
    luminance = float(weight @ each)
    of_each_dn2 = signals.noise_variance_dn2 + calibration.responsivity.scatter_dn**2
    noise = float((weight * slope) ** 2 @ of_each_dn2)
    # Dark signal non-uniformity and the pixels' sensitivity do not average over the exposures.
    uneven = float(weight @ (slope * signals.dark_nonuniformity_dn))
    pixels = float((weight * each / luminance) @ signals.pixels_rel)
    slow = hypot(calibration.field_rel, calibration.responsivity.scatter_rel)
    rim_rel = _rim_rel(calibration, weight, signals)
    random_rel = sqrt((noise + uneven**2) / luminance**2 + pixels**2 + slow**2 + rim_rel**2)
    of_place = vignetting_errors(calibration.vignetting, calibration.state.image_shape, [observations[0].centre_px])
    shares, shared = weight * each / luminance, dict[str, CommonError]()

    def add(key: str, error: CommonError) -> None:
        so_far = float(shared[key].relative) if key in shared else 0.0
        shared[key] = replace(error, relative=so_far + float(error.relative))

    for o, n, share in zip(observations, net, shares, strict=True):
        errors = common_errors(calibration, n, o.exposure_s, o.state.gain_db, o.temperature_c)
        for number, error in enumerate(placed(calibration, errors, list(of_place[:, 0]))):
            exposure = error.source == EXPOSURE_TIME
            source = f"{EXPOSURE_TIME} {o.exposure_s:g} s" if exposure else error.source
            add(source if exposure else f"{number}", replace(error, source=source, relative=share * error.relative))
    of_frames = signals.flicker_rel * shares, signals.black_level_dn * weight * slope / luminance
    for o, index, *parts in zip(observations, signals.gain_index, *of_frames, strict=True):
        frames = " ".join(f"{part}" for part in o.frames if part is not None)
        setting = calibration.settings[index]
        dofs = setting.noise.flicker_at(o.exposure_s)[1], setting.dark.drift_dof
        for source, part, dof in zip(OF_FRAMES, parts, dofs, strict=True):
            if part:
                add(name := f"{source}, frames {frames}", CommonError(name, part, dof=dof or inf))
    patch = observations[0].patch
    return PatchLuminance(
        patch=patch,
        luminance_cd_m2=luminance,
        random_rel=random_rel,
        common=tuple(shared.values()),
        exposures_s=tuple(sorted({o.exposure_s for o in observations})),
        scatter_rel=calibration.responsivity.scatter_rel,
        scatter_dof=calibration.responsivity.scatter_dof or inf,
        rim_rel=rim_rel,
        findings=(
            *findings,
            *temperature_findings(observations, calibration.settings),
            *_unknown_temperatures(calibration, observations),
            *([warning("patch-rim", patch, rim_rel=rim_rel)] if abs(rim_rel) > SMALL_EFFECT_REL else []),
            *(
                outside_range(patch, luminance, random_rel, calibration.range_cd_m2)
                or _unconfirmed(calibration, patch, net, each, inverse)
            ),
        ),
    )


def _rim_rel(calibration: CalibratedCamera, weight: Array, signals: NetSignals) -> float:
    """Return by how much the rim of a region changes its mean, beyond noise and what the calibration's patches had.

    What is inside may be the patch, and the rim have light of the surroundings, by defocus or a halo; or the patch is
    brighter in the middle, as those of the calibration were.
    """
    rim, u = float(weight @ signals.rim_rel), float(np.hypot.reduce(weight * signals.rim_u_rel))
    beyond = min(rim, rim - calibration.responsivity.rim_rel, key=abs)
    if abs(beyond) <= _RIM_LIMIT * u:
        return 0.0
    # A halo reaches beyond the rim: the middle has least of it.
    of_middle = -float(weight @ signals.shape_rel)
    return max(beyond, of_middle, key=abs) if beyond * of_middle > 0 else beyond


def _unknown_temperatures(
    calibration: CalibratedCamera, observations: Sequence[PatchObservation]
) -> tuple[Finding, ...]:
    darks = ((calibration.setting(o.state.gain_db).dark, (o.exposure_s, o.temperature_c)) for o in observations)
    return unique(finding for dark, taken in darks for finding in dark.unknown_temperature_findings([taken]))


def _unconfirmed(calibration: CalibratedCamera, patch: str, net_dn: Array, each: Array, weight: Array) -> list[Finding]:
    """Warn of signals above the calibrated ones, unless the patch's lower signals give the same luminance."""
    highest_dn = calibration.range_net_dn[1]
    above = net_dn > highest_dn * (1 + _RANGE_MARGIN)
    if not above.any():
        return []
    if not above.all():
        means = [float(np.average(each[part], weights=weight[part])) for part in (above, ~above)]
        u = sqrt(1 / weight[above].sum() + 1 / weight[~above].sum())
        if abs(means[0] - means[1]) <= _CONFIRMED * u:
            return []
    return [warning("signal-outside-range", patch, net_dn=float(net_dn.max()), highest_net_dn=highest_dn)]


def outside_range(
    patch: str, luminance_cd_m2: float, random_rel: float, range_cd_m2: tuple[float, float]
) -> list[Finding]:
    """Warn of a patch outside the luminance range of the calibration by more than its noise."""
    (low, high), margin = range_cd_m2, RANGE_MARGIN * random_rel * luminance_cd_m2
    if low - margin <= luminance_cd_m2 <= high + margin:
        return []
    code, limits = "luminance-outside-range", {"lowest_cd_m2": low, "highest_cd_m2": high}
    return [warning(code, patch, luminance_cd_m2=luminance_cd_m2, **limits)]


def numbered(common: Sequence[CommonError]) -> dict[tuple[str, int], CommonError]:
    """Errors of a patch by source and number, as several have the same source."""
    sources = [error.source for error in common]
    return {(source, sources[:i].count(source)): common[i] for i, source in enumerate(sources)}
