"""What a fit refuses, and what it only advises against."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt

import numpy as np

from ..errors import CalibrationError
from .design import Design
from .findings import FitTest
from .fit_tests import MIN_SPAN
from .gains import GainSetting
from .gls import Solution
from .intake import ADVISED_PATCHES
from .ladder import patch_weights

#: Fewest exposures without a warning.
ADVISED_EXPOSURES = 3
#: Ratio of the highest to the lowest patch below which there is no fit: what is common to all patches looks like light.
REFUSED_SPAN = 1.2
#: Contradiction of two patches, as a ratio, from which a calibration makes no sense.
_INVERSION = 1.1
#: Standard uncertainties by which both, reading and signal, must differ for it.
_INVERSION_LIMIT = 4.0
#: Unexplained scatter, relative, that is worth a warning: small beside the 2 % of a meter.
_SCATTER_TOLERANCE_REL = 0.002


def require_span(design: Design) -> None:
    """Refuse patches that all have about one luminance; raises CalibrationError."""
    low, high = design.reading_cd_m2.min(), design.reading_cd_m2.max()
    if high < REFUSED_SPAN * low:
        raise CalibrationError(
            f"the patches all have about the same luminance ({low:.4g} to {high:.4g} cd/m^2), which cannot tell light "
            "from glare and darkness: add patches, log spaced over the range you need"
        )


def require_every_gain(design: Design, settings: Sequence[GainSetting]) -> None:
    """Refuse a gain at which no patch can be used; raises CalibrationError."""
    for index, setting in enumerate(settings):
        if not (design.gain == index).any():
            raise CalibrationError(
                f"no patch is usable at a gain of {setting.gain_db:g} dB: take other exposures there, or leave it out"
            )


def require_monotone(solution: Solution) -> None:
    """Refuse two patches of which the brighter one gives clearly less signal; raises CalibrationError, naming them."""
    design = solution.design
    n = len(design.patches)
    reading, seen = design.reading_cd_m2, np.zeros(n)
    by_meter, by_camera = np.sqrt(design.reading_variance), np.zeros(n)
    for i in range(n):
        own, weight = design.patch == i, patch_weights(solution, i)
        seen[i] = weight @ solution.luminance[own]
        noise = float((weight * solution.slope[own]) ** 2 @ design.noise_variance_dn2[own])
        by_camera[i] = hypot(sqrt(noise), design.patch_rel[i] * seen[i])
    for i in np.argsort(-reading):
        for k in range(n):
            apart = reading[i] - reading[k] > _INVERSION_LIMIT * hypot(by_meter[i], by_meter[k])
            inverted = seen[k] - seen[i] > _INVERSION_LIMIT * hypot(by_camera[i], by_camera[k])
            if apart and inverted and reading[i] * seen[k] > _INVERSION * reading[k] * seen[i]:
                raise CalibrationError(
                    f"patch {design.patches[i]!r} reads {reading[i]:.4g} cd/m^2 and patch {design.patches[k]!r} "
                    f"{reading[k]:.4g} cd/m^2, but the camera sees less light from the first (as {seen[i]:.4g} and "
                    f"{seen[k]:.4g} cd/m^2): were regions or readings swapped? measure both again"
                )


def design_warnings(design: Design, settings: Sequence[GainSetting]) -> list[str]:
    """Say what would make the fit better."""
    warnings = []
    if len(design.patches) < ADVISED_PATCHES:
        warnings.append(
            f"the fit rests on {len(design.patches)} patches: use at least {ADVISED_PATCHES}, better 8 to 12, log "
            "spaced"
        )
    low, high = design.reading_cd_m2.min(), design.reading_cd_m2.max()
    if high < MIN_SPAN * low:
        warnings.append(
            f"the patches span {low:g} to {high:g} cd/m^2 only: the valid range is as narrow, and glare and linearity "
            "are not tested; add patches, log spaced"
        )
    used = np.unique(design.exposures_s[design.exposure])
    if used.size < ADVISED_EXPOSURES:
        untested = "reciprocity not testable; " if used.size == 1 else ""
        warnings.append(
            f"patches were usable at {used.size} exposure{'s' if used.size > 1 else ''}: {untested}use at least "
            f"{ADVISED_EXPOSURES}, so that the exposure time is tested"
        )
    for index, setting in enumerate(settings):
        times = design.exposures_s[design.exposure[design.gain == index]]
        darks = setting.dark.exposures_s
        if len(darks) > 1 and not (darks[0] * 0.999 <= times.min() and times.max() <= darks[-1] * 1.001):
            warnings.append(
                f"dark frames at {darks[0]:g} to {darks[-1]:g} s do not enclose the exposures {times.min():g} to "
                f"{times.max():g} s: the darkness is extrapolated"
            )
    return warnings


def finding_warnings(final: Solution, tests: Sequence[FitTest]) -> list[str]:
    """Say what the fit found out that the user should know."""
    design = final.design
    warnings = [
        test.meaning
        for test in tests
        if test.significant and test.name in ("glare", "exposure reciprocity", "drift", "fall-off", "darkness", "gain")
    ]
    before = len(warnings)
    if design.scatter_rel > _SCATTER_TOLERANCE_REL:
        ratios = [
            float(patch_weights(final, i) @ final.luminance[design.patch == i]) / design.reading_cd_m2[i] - 1
            for i in range(len(design.patches))
        ]
        worst = int(np.argmax(np.abs(ratios)))
        warnings.append(
            f"the patches scatter by {design.scatter_rel:.1%} more than the stated errors explain, most of all patch "
            f"{design.patches[worst]!r} ({ratios[worst]:+.1%}): check regions, readings, glare and the light; the "
            "uncertainty was widened by this scatter"
        )
    if design.scatter_each_rel > _SCATTER_TOLERANCE_REL:
        warnings.append(
            f"the exposures of a patch disagree by {design.scatter_each_rel:.1%} more than their noise: check the "
            "exposure times, the linearity, the dark frames and the light; the uncertainty was widened by this scatter"
        )
    if design.scatter_each_dn > 0:
        warnings.append(
            f"the exposures of a patch disagree by {design.scatter_each_dn:.2g} DN more than their noise: check the "
            "dark frames, the linearity and the light; the uncertainty was widened by this scatter"
        )
    if len(warnings) == before:  # scatter that is significant, but small
        warnings += [test.meaning for test in tests if test.significant and test.name == "scatter"]
    return warnings
