"""Fit of a camera with colour filters: each plane, and the combination of planes to luminance."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..errors import CalibrationError
from ..frame import PLANES
from ..reading import Reading
from ..spectral_mismatch import f1_prime, weighted_sum
from ..spectral_table import SpectralTable
from .calibrate import fit
from .chance import student_widening
from .colour import ColourCalibration, CombinationStep
from .colour_combination import (
    Array,
    ColourData,
    Combination,
    Prior,
    combine,
    leave_one_out,
    single,
    single_leave_one_out,
)
from .colour_conversion import colour_patch_luminance
from .colour_patches import ColourPatches, by_patch, centre_px, colour_patches, colour_row
from .colour_planes import COLOURS, colours_of_planes, one_spectrum
from .colour_prior import ColourPrior, choose_prior
from .dark_library import DarkLibrary
from .defects import DefectMap
from .intake import group_by_patch
from .model import Calibration
from .observations import DarkObservation, PatchObservation
from .residuals import held_out_rows
from .setup import Setup

_log = logging.getLogger(__name__)

#: A colour alone is taken only if it misses patches it was not shown by less than this part of the combination's error:
#: the combination has less noise, and noise decides between equals.
_CLEARLY_BETTER = 0.8
#: Name of the combination on the ladder.
COMBINATION = "combination"
#: Share of the prior's width up to which the patches have determined the weights.
_DETERMINED = 0.5


def fit_colour(
    observations: Mapping[str, Sequence[PatchObservation]],
    darks: Mapping[str, Sequence[DarkObservation]],
    readings: Mapping[str, Sequence[Reading]],
    setup: Setup,
    *,
    sensitivities: Mapping[str, SpectralTable] | None = None,
    held_out: Collection[str] = (),
    defects: Mapping[str, DefectMap | None] | None = None,
    dark_libraries: Mapping[str, DarkLibrary | None] | None = None,
) -> ColourCalibration:
    """Calibrate a camera with colour filters.

    Each plane is calibrated by `fit` with the patches that share one spectrum, as grey patches in one light do: of
    another colour a plane sees more or less than the meter, which is no fault of its linearity. Then the weights of
    L = sum w_p L_p are fitted to all patches, with the errors of meter and planes. What the patches leave open is
    decided by least noise, or by the smallest f1' where the spectral sensitivities are known; see
    `labcdp.calibration.colour_prior`. The combination is compared with each colour alone by leave-one-out errors.

    Parameters
    ----------
    observations : mapping of str to sequence of PatchObservation
        By plane (R, Gr, Gb, B): all patches at all exposures, from the frames that `planes.split` returns.
    darks : mapping of str to sequence of DarkObservation
        By plane.
    readings : mapping of str to sequence of Reading
        The meter's readings by the name of the patch.
    setup : Setup
        Lens, spectrum, and hash of the input.
    sensitivities : mapping of str to SpectralTable or None
        Relative spectral sensitivities of R, G and B to radiant power, if known; their relative scale does not matter.
    held_out : collection of str
        Patches the fit is not shown; their deviations tell how good it is.
    defects, dark_libraries : mapping of str or None
        By plane, as for `fit`.

    Raises
    ------
    CalibrationError
        As `fit`, naming the plane; if a plane is missing, fewer than three patches share one spectrum, or not all
        planes can use the same patches.
    InputError
        If sensitivities are not those of R, G and B, or see none of the light.
    """
    _require_planes(observations, darks)
    for plane in PLANES:
        group_by_patch(observations[plane], readings, held_out)
    grey, warnings = one_spectrum(observations, darks, [name for name in readings if name not in held_out])
    corrections = {plane: ((defects or {}).get(plane), (dark_libraries or {}).get(plane)) for plane in PLANES}
    planes = _fit_planes(observations, darks, {name: readings[name] for name in grey}, setup, corrections)
    groups = by_patch(observations)
    prior = choose_prior(planes, sensitivities, setup.light)
    scatter_rel = _scatter_rel(planes, colours_of_planes(planes) @ prior.prior.weights)
    patches = colour_patches(planes, {n: groups[n] for n in groups if n not in held_out}, readings, scatter_rel)
    chosen, ladder = _choose(patches.data, prior.prior)
    calibration = _assemble(planes, chosen, patches, ladder, prior)
    rows, of_held_out = held_out_rows(
        lambda name: colour_patch_luminance(calibration, groups[name]),
        {name: centre_px(group) for name, group in groups.items() if name in held_out},
        readings,
    )
    warnings += [
        *_plane_warnings(planes),
        *patches.warnings,
        *prior.warnings,
        *_warnings(chosen, patches, prior),
        *of_held_out,
    ]
    for warning in warnings:
        _log.warning("%s", warning)
    return replace(calibration, held_out=rows, warnings=tuple(warnings))


def _fit_planes(
    observations: Mapping[str, Sequence[PatchObservation]],
    darks: Mapping[str, Sequence[DarkObservation]],
    readings: Mapping[str, Sequence[Reading]],
    setup: Setup,
    corrections: Mapping[str, tuple[DefectMap | None, DarkLibrary | None]],
) -> list[Calibration]:
    planes = []
    for plane in PLANES:
        own = [o for o in observations[plane] if o.patch in readings]
        defects, dark_library = corrections[plane]
        try:
            planes.append(fit(own, darks[plane], readings, setup, defects=defects, dark_library=dark_library))
        except CalibrationError as error:
            raise CalibrationError(f"plane {plane}: {error}") from error
    return planes


def _require_planes(
    observations: Mapping[str, Sequence[PatchObservation]], darks: Mapping[str, Sequence[DarkObservation]]
) -> None:
    for what, given in (("light", observations), ("dark", darks)):
        missing = [plane for plane in PLANES if not given.get(plane)]
        if missing:
            raise CalibrationError(
                f"there are no {what} frames of plane {missing[0]}: split every Bayer frame and observe all planes"
            )


def _scatter_rel(planes: Sequence[Calibration], weights: Array) -> float:
    """Scatter of the patches in the combination: of uneven patches and readings, so the same way in all planes."""
    return float(np.abs(weights) @ np.array([plane.responsivity.scatter_rel for plane in planes]))


def _plane_warnings(planes: Sequence[Calibration]) -> list[str]:
    """Return the warnings of the planes; an intercept that differs between them is one of colour, and no glare."""
    glare = [next(test for test in plane.tests if test.name == "glare") for plane in planes]
    signs = {np.sign(test.value) if test.significant else 0 for test in glare}
    of_colour = [test.meaning for test in glare if test.significant] if len(signs) > 1 else []
    warnings = [
        f"plane {plane.state.plane}: {warning}"
        for plane in planes
        for warning in plane.warnings
        if warning not in of_colour
    ]
    if of_colour:
        found = ", ".join(f"{p.state.plane} {test.value:+.2g}" for p, test in zip(planes, glare, strict=True))
        warnings.append(
            f"the planes extrapolate to different light at zero signal ({found} cd/m^2), which glare would not do: the "
            "grey patches are not all of exactly one colour"
        )
    return warnings


def _choose(data: ColourData, prior: Prior) -> tuple[Combination, tuple[CombinationStep, ...]]:
    """Compare the combination with each colour alone by leave-one-out errors."""
    found = combine(data, prior)
    left_out = _rms(leave_one_out(data, prior, found.spectral))
    alone = {colour: _rms(single_leave_one_out(data, i)) for i, colour in enumerate(COLOURS)}
    best = min(alone, key=lambda colour: alone[colour])
    if alone[best] < _CLEARLY_BETTER * left_out:
        chosen, name = single(data, COLOURS.index(best)), best
        why = f"misses patches it was not shown by {alone[best]:.2%}, clearly less than the combination"
    else:
        chosen, name = found, COMBINATION
        why = "no colour alone comes clearly closer to patches the fit was not shown, and it has the least noise"
    steps = [(COMBINATION, left_out), *alone.items()]
    return chosen, tuple(
        CombinationStep(step, error, step == name, why if step == name else f"{name} was chosen")
        for step, error in steps
    )


def _rms(deviations: Array) -> float:
    return float(np.sqrt(np.mean(deviations**2)))


def _assemble(
    planes: Sequence[Calibration],
    chosen: Combination,
    patches: ColourPatches,
    ladder: tuple[CombinationStep, ...],
    prior: ColourPrior,
) -> ColourCalibration:
    to_colour = colours_of_planes(planes)
    weights = to_colour @ chosen.weights
    freedom = max(len(patches.names) - len(COLOURS), 1)
    covariance = to_colour @ (chosen.covariance * max(1.0, chosen.chi_squared / freedom)) @ to_colour.T
    own = {step.name: step for step in ladder}[COMBINATION].chosen
    left_out = leave_one_out(patches.data, prior.prior, chosen.spectral) if own else None
    rows = [
        colour_row(reading, seen, centre, float(deviation), float(deviation / uncertainty))
        for reading, seen, centre, deviation, uncertainty in zip(
            patches.readings, patches.seen, patches.centres_px, chosen.deviation, chosen.uncertainty, strict=True
        )
    ]
    if left_out is None:
        left_out = single_leave_one_out(patches.data, int(np.argmax(np.abs(chosen.weights))))
    luminances = [value for row in rows for value in (row.reading_cd_m2, row.luminance_cd_m2)]
    sensitivity = None
    if prior.sensitivities is not None:
        sensitivity = weighted_sum(prior.sensitivities, dict(zip(COLOURS, chosen.weights.tolist(), strict=True)))
    return ColourCalibration(
        planes=tuple(planes),
        weights=tuple(weights.tolist()),
        weight_covariance=tuple(tuple(row) for row in covariance.tolist()),
        spectral_rel=chosen.spectral * student_widening(freedom),
        scatter_rel=_scatter_rel(planes, weights),
        range_cd_m2=(min(luminances), max(luminances)),
        residuals=tuple(replace(row, leave_one_out_rel=float(v)) for row, v in zip(rows, left_out, strict=True)),
        held_out=(),
        left_out=patches.left_out,
        ladder=ladder,
        sensitivity=sensitivity,
        f1_prime=None if sensitivity is None else f1_prime(sensitivity),
        warnings=(),
    )


def _warnings(chosen: Combination, patches: ColourPatches, prior: ColourPrior) -> list[str]:
    warnings = []
    if chosen.undetermined > _DETERMINED * prior.prior.width:
        how = "of the smallest f1'" if prior.sensitivities is not None else "of the least noise"
        warnings.append(
            "the patches are nearly of one colour, so the meter does not tell how red, green and blue make luminance: "
            f"the weights are those {how}; luminances of other colours are as uncertain as stated: add coloured patches"
            + ("" if prior.sensitivities is not None else ", or give the camera's spectral_sensitivity")
        )
    if chosen.spectral > 0:
        worst = int(np.argmax(np.abs(chosen.deviation)))
        warnings.append(
            f"no weights make all colours fit the meter, most of all patch {patches.names[worst]!r} "
            f"({chosen.deviation[worst]:+.1%}): no sum of the camera's sensitivities is V(lambda); the uncertainty "
            "of coloured patches holds this"
        )
    return warnings
