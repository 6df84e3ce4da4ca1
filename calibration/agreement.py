"""Whether the exposures of a session agree on the luminances of its patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.result import Finding, warning
from .camera import EXPOSURE_TIME, common_errors
from .convert.patch import is_within_response
from .frames.observations import PatchObservation
from .model import Calibration
from .setup import METER_SOURCES
from .signal import net_signals, usable
from .uncertainty import SMALL_EFFECT_REL, p_value_of_chi_squared

Array = NDArray[np.floating[Any]]
#: Probability with which chance makes exposures disagree: that of three standard deviations.
_BY_CHANCE = 0.0027


def with_agreement(plane: Calibration, observations: Sequence[PatchObservation]) -> tuple[Calibration, list[Finding]]:
    """Return a calibration whose exposure times are as uncertain as the exposures of a session disagree.

    A pulsed lamp with which the frames are synchronised, or another exposure time than the camera states, changes
    all patches of an exposure alike, and every frame of it. Each has less effect on longer exposures, in proportion:
    the longest one is taken as the reference, and may itself be off as much less than the next one as it is longer.

    Parameters
    ----------
    plane : Calibration
        As it holds in the session.
    observations : sequence of PatchObservation
        Of the session.
    """
    taken = _seen_twice(plane, observations)
    times_s, exposure = np.unique([o.exposure_s for o in taken], return_inverse=True)
    names, patch = np.unique([o.patch for o in taken], return_inverse=True)
    n = times_s.size - 1
    of_patches, of_times = (np.equal.outer(of, np.arange(k)) for of, k in ((patch, names.size), (exposure, max(n, 0))))
    columns = np.hstack([of_patches, of_times]).astype(float)
    if n < 1 or np.linalg.matrix_rank(columns) < columns.shape[1]:
        return plane, []
    logarithms, covariance = _luminances(plane, taken)
    weight = np.linalg.inv(covariance)
    normal = np.linalg.inv(columns.T @ weight @ columns)
    deviations = (normal @ columns.T @ weight @ logarithms)[-n:]
    chi_squared = float(deviations @ np.linalg.solve(normal[-n:, -n:], deviations))
    largest = int(np.argmax(np.abs(deviations)))
    agree = p_value_of_chi_squared(chi_squared, n) >= _BY_CHANCE
    if agree or abs(deviations[largest]) <= SMALL_EFFECT_REL:
        return plane, []
    of_longest = deviations[-1] * times_s[-2] / times_s[-1]
    times = plane.exposure_times
    for exposure_s, size in zip(times_s.tolist(), [*deviations.tolist(), float(of_longest)], strict=True):
        times = times.more_uncertain(exposure_s, abs(size))
    finding = warning(
        "exposures-disagree", exposure_s=float(times_s[largest]), deviation_rel=float(deviations[largest])
    )
    return replace(plane, exposure_times=times), [finding]


def _seen_twice(plane: Calibration, observations: Sequence[PatchObservation]) -> list[PatchObservation]:
    """Return the usable observations of patches that several exposures show, all at the calibration's own gain."""
    at_gain = [
        o.saturating_at(plane.state.saturation_dn) for o in observations if o.state.has_gain(plane.state.gain_db)
    ]
    kept = [o for o in usable(at_gain, plane.settings)[0] if is_within_response(plane, o)]
    times_s: dict[str, set[float]] = {}
    for o in kept:
        times_s.setdefault(o.patch, set()).add(o.exposure_s)
    return [o for o in kept if len(times_s[o.patch]) > 1]


def _luminances(plane: Calibration, observations: Sequence[PatchObservation]) -> tuple[Array, Array]:
    """Return the logarithms of the luminances, and the covariance of their errors without the meter's."""
    signals = net_signals(observations, plane.settings)
    net, linear_dn = signals.net_dn, plane.response.linearise(signals.net_dn)
    applied_s = np.array([plane.exposure_times.applied_s(o.exposure_s) for o in observations])
    stated_s = np.array([o.exposure_s for o in observations])
    luminance = linear_dn * signals.scale_per_s * stated_s / applied_s
    per_dn = plane.response.slope(net) / linear_dn
    independent = per_dn**2 * (signals.noise_variance_dn2 + plane.responsivity.scatter_dn**2)
    covariance = np.diag(independent)
    uneven = signals.dark_nonuniformity_dn * per_dn
    names = np.array([o.patch for o in observations])
    covariance += np.where(np.equal.outer(names, names), np.outer(uneven, uneven), 0.0)
    for o in dict.fromkeys(o.frames for o in observations):
        same = np.array([other.frames == o for other in observations])
        for error in (signals.flicker_rel, signals.black_level_dn * per_dn):
            covariance += np.outer(same * error, same * error)
    errors = [
        common_errors(plane, n, o.exposure_s, o.state.gain_db, o.temperature_c)
        for n, o in zip(net.tolist(), observations, strict=True)
    ]
    for same_error in zip(*errors, strict=True):
        if same_error[0].source in METER_SOURCES:
            continue
        row = np.array([float(error.relative) for error in same_error])
        effect = np.outer(row, row)
        apart = same_error[0].source == EXPOSURE_TIME
        covariance += np.where(np.equal.outer(stated_s, stated_s), effect, 0.0) if apart else effect
    return np.log(luminance), covariance
