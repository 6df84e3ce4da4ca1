"""Changes of the planes of a camera with colour filters, from grey patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import sqrt

import numpy as np

from ...core.errors import CalibrationError
from ..colour.conversion import own_rel
from ..colour.model import ColourCalibration
from ..convert.patch import PatchLuminance, patch_luminance
from ..errors.uncertainty import expanded_half_width
from ..frames.observations import PatchObservation
from ..model import Calibration
from .comparison import Comparison, Readings
from .result import VerifiedPlane


def grey_patches(calibration: ColourCalibration) -> set[str]:
    """Names of the patches that the planes were fitted to: those of one spectrum, for which all planes agree."""
    return set.intersection(*({row.patch for row in plane.residuals} for plane in calibration.planes))


def balanced(
    calibration: ColourCalibration,
    groups: Mapping[str, Mapping[str, Sequence[PatchObservation]]],
    readings: Readings,
    uneven_rel: Mapping[str, float],
    planes: Sequence[VerifiedPlane],
) -> list[VerifiedPlane]:
    """Add to each plane its change against the meter, and its deviation from all planes together.

    Parameters
    ----------
    calibration : ColourCalibration
        Calibration to verify.
    groups : mapping
        New observations by patch, then by plane; only the grey patches of the calibration are used.
    readings : Readings
        Of these patches.
    uneven_rel : mapping of str to float
        Non-uniformity of each of these patches.
    planes : sequence of VerifiedPlane
        The planes, in the calibration's order.
    """
    seen = [
        own for name in groups if name in grey_patches(calibration) and (own := _of_planes(calibration, groups[name]))
    ]
    if not seen:
        return list(planes)
    by_plane = list(zip(*seen, strict=True))
    luminance = np.array([[one.luminance_cd_m2 for one in of_plane] for of_plane in by_plane])
    shares = np.array(calibration.weights)[:, None] * luminance
    shares = (shares / shares.sum(axis=0)).mean(axis=1)
    balance = (luminance / (np.array(calibration.weights) @ luminance) - 1).mean(axis=1)
    errors = np.array([_own_rel(plane, own) for plane, own in zip(calibration.planes, by_plane, strict=True)])
    against_all = np.eye(len(planes)) - shares
    u = np.sqrt(np.square(against_all) @ np.square(errors))
    return [
        replace(
            one,
            drift=Comparison.of(own, readings, uneven_rel).drift(plane),
            balance_rel=float(balance[n]),
            balance_expanded_rel=expanded_half_width(0.0, float(u[n])),
            share=float(shares[n]),
        )
        for n, (one, plane, own) in enumerate(zip(planes, calibration.planes, by_plane, strict=True))
    ]


def _of_planes(
    calibration: ColourCalibration, group: Mapping[str, Sequence[PatchObservation]]
) -> list[PatchLuminance] | None:
    try:
        return [patch_luminance(plane, group[f"{plane.state.plane}"]) for plane in calibration.planes]
    except CalibrationError:
        return None


def _own_rel(plane: Calibration, own: Sequence[PatchLuminance]) -> float:
    """Relative standard uncertainty of the mean over patches of a plane, by what differs from plane to plane."""
    noise = sum(own_rel(plane, one) ** 2 for one in own) / len(own) ** 2
    scatter = plane.responsivity.scatter_rel**2 / len(own)
    return sqrt(noise + scatter + max(one.fit_rel for one in own) ** 2)
