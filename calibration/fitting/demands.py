"""Requirements and recommendations of a fit."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import hypot

import numpy as np

from ...core.errors import CalibrationError
from ...core.result import Finding, info, warning
from ..fit_records import FLICKERING, SETTLING, FitTest, undecided_cause
from ..frames.observations import PatchObservation
from ..sensor.noise import GainSetting, few_frames, first_frames
from ..uncertainty import SMALL_EFFECT_REL, expanded_half_width
from .design import PATCH_SHAPE, Design
from .effects import MIN_SPAN
from .intake import ADVISED_PATCHES
from .problem import Solution
from .selection import seen_cd_m2, weights_by_patch

#: Fewest exposures without a warning.
ADVISED_EXPOSURES = 3
#: Ratio of the highest to the lowest patch below which a fit is refused: errors common to all patches could not be
#: separated from light.
REFUSED_SPAN = 1.2
#: Ratio of two contradicting patches above which a calibration is refused.
_INVERSION = 1.1
#: Standard uncertainties by which reading and signal must both differ.
_INVERSION_LIMIT = 4.0
#: Glare over the darkest patch from which it is named if it cannot be excluded: as the 2 % of a meter.
_GLARE_TOLERANCE_REL = 0.02
#: Flicker of the light from which it is named: as much as a meter's repeatability, by some frames.
_FLICKER_TOLERANCE_REL = 0.005

#: Probability by chance below which what the first frames have may be the cause of a flicker.
_PERHAPS = 0.05


def require_span(design: Design) -> None:
    """Refuse patches of about the same luminance; raises CalibrationError."""
    low, high = design.reading_cd_m2.min(), design.reading_cd_m2.max()
    if high < REFUSED_SPAN * low:
        raise CalibrationError(
            f"the patches all have about the same luminance ({low:.4g} to {high:.4g} cd/m²), which cannot separate "
            "light from glare and dark signal: add patches with logarithmic spacing over the range you need"
        )


def require_every_gain(design: Design, settings: Sequence[GainSetting]) -> None:
    """Refuse a gain at which no patch can be used; raises CalibrationError."""
    for index, setting in enumerate(settings):
        if not (design.signals.gain_index == index).any():
            raise CalibrationError(
                f"no patch is usable at a gain of {setting.gain_db:g} dB: take other exposures there, or leave it out"
            )


def require_monotone(solution: Solution, deviating: Collection[str]) -> None:
    """Refuse two patches of which the brighter one gives clearly less signal; raises CalibrationError, naming them.

    Those that deviate from all others are named already, unless each has the other's reading.
    """
    design = solution.design
    reading, seen, by_meter = design.reading_cd_m2, seen_cd_m2(solution), np.sqrt(design.reading_variance)
    noise_cd_m2 = solution.slope * np.sqrt(design.signals.noise_variance_dn2)
    noise = [np.linalg.norm(weight * noise_cd_m2[of_patch]) for of_patch, weight in weights_by_patch(solution)]
    by_camera = np.hypot(noise, design.own_rel * seen)
    for i in np.argsort(-reading):
        for k in range(seen.size):
            apart = reading[i] - reading[k] > _INVERSION_LIMIT * hypot(by_meter[i], by_meter[k])
            inverted = seen[k] - seen[i] > _INVERSION_LIMIT * hypot(by_camera[i], by_camera[k])
            named = {design.patches[i], design.patches[k]} & {*deviating}
            # Two that deviate may be exchanged.
            if len(named) == 2:
                apart_rel = max(abs(reading[i] / seen[k] - 1), abs(reading[k] / seen[i] - 1))
                named = named if apart_rel > _INVERSION - 1 else set()
            if not named and apart and inverted and reading[i] * seen[k] > _INVERSION * reading[k] * seen[i]:
                raise CalibrationError(
                    f"patch {design.patches[i]!r} reads {reading[i]:.4g} cd/m² and patch {design.patches[k]!r} "
                    f"{reading[k]:.4g} cd/m², but the camera sees less light from the first (as {seen[i]:.4g} and "
                    f"{seen[k]:.4g} cd/m²): were regions or readings swapped, or the meter read before it settled? "
                    "measure both again"
                )


def design_findings(
    design: Design,
    settings: Sequence[GainSetting],
    of_noise: Sequence[Finding],
    observations: Sequence[PatchObservation],
) -> list[Finding]:
    """Return recommendations for a better fit; what the first frames have explains a flicker."""
    findings = []
    if len(design.patches) < ADVISED_PATCHES:
        findings.append(warning("few-patches", count=len(design.patches), advised=ADVISED_PATCHES))
    low, high = design.reading_cd_m2.min(), design.reading_cd_m2.max()
    if high < MIN_SPAN * low:
        findings.append(warning("narrow-luminance-range", low_cd_m2=float(low), high_cd_m2=float(high)))
    used = np.unique(design.exposures_s[design.exposure])
    if used.size < ADVISED_EXPOSURES:
        findings.append(warning("few-exposures", exposures_s=used.tolist(), advised=ADVISED_EXPOSURES))
    noise = settings[0].noise
    flicker_rel, exposure_s = max((noise.flicker_at(float(t))[0], float(t)) for t in used)
    settling = next((finding for finding in of_noise if finding.code == SETTLING[1]), None)
    if settling is not None and few_frames(settling) and flicker_rel > 0:
        findings.append(warning("flicker", flicker_rel=flicker_rel, exposure_s=exposure_s))
        findings.append(undecided_cause(SETTLING, FLICKERING))
    elif settling is None and flicker_rel > _FLICKER_TOLERANCE_REL:
        findings.append(warning("flicker", flicker_rel=flicker_rel, exposure_s=exposure_s))
        if first_frames(observations, settings[0].dark, _PERHAPS):
            findings.append(undecided_cause(FLICKERING, SETTLING))
    for index, setting in enumerate(settings):
        times = design.exposures_s[design.exposure[design.signals.gain_index == index]]
        darks = setting.dark.exposures_s
        if len(darks) > 1 and not (darks[0] * 0.999 <= times.min() and times.max() <= darks[-1] * 1.001):
            light_s = [float(times.min()), float(times.max())]
            dark_s = [darks[0], darks[-1]]
            findings.append(warning("dark-extrapolated", dark_exposures_s=dark_s, light_exposures_s=light_s))
    return findings


def fit_findings(final: Solution, tests: Sequence[FitTest]) -> list[Finding]:
    """Return the findings of the fit."""
    design = final.design
    findings = [test.finding for test in tests if test.significant and test.name == "gain"]
    by_name = {test.name: test for test in tests}
    if not by_name["dark signal"].significant:
        findings += _glare_not_excluded(design, by_name["glare"])
    shape_rel = max((abs(float(np.mean(e.relative))) for e in design.shared if e.source == PATCH_SHAPE), default=0.0)
    # An uncorrected vignetting changes within a patch, too.
    if shape_rel > SMALL_EFFECT_REL and not by_name["vignetting"].significant:
        findings.append(warning("patch-shape", shape_rel=shape_rel))
    before = len(findings)
    if design.scatter_rel.size > SMALL_EFFECT_REL:
        ratios = seen_cd_m2(final) / design.reading_cd_m2 - 1
        worst = int(np.argmax(np.abs(ratios)))
        name, size, deviation = design.patches[worst], design.scatter_rel.size, float(ratios[worst])
        findings.append(warning("patches-scatter", scatter_rel=size, patch=name, deviation_rel=deviation))
    if design.scatter_each_rel.size > SMALL_EFFECT_REL:
        findings.append(warning("exposures-scatter", scatter_rel=design.scatter_each_rel.size))
    if design.scatter_each_dn.size > 0:
        findings.append(warning("exposures-scatter-dn", scatter_dn=design.scatter_each_dn.size))
    if len(findings) == before:  # significant but small scatter
        findings += [test.finding for test in tests if test.significant and test.name == "scatter"]
    return findings


def _glare_not_excluded(design: Design, test: FitTest) -> list[Finding]:
    """Name glare that the patches do not show, but that would matter beside the darkest one."""
    darkest = float(design.reading_cd_m2.min())
    most = max(test.value, 0.0) + expanded_half_width(0.0, test.standard_uncertainty)
    if test.significant or most <= _GLARE_TOLERANCE_REL * darkest:
        return []
    return [info("intercept-not-excluded", glare_cd_m2=most, share_rel=most / darkest, darkest_cd_m2=darkest)]
