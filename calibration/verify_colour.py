"""Whether the calibration of a camera with colour filters still holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..errors import CalibrationError
from ..frame import PLANES
from ..reading import Reading
from .colour import ColourCalibration
from .colour_balance import balance_of, plane_drifts
from .colour_conversion import colour_patch_luminance
from .comparison import compare, dark_row, join_readings, unevenness_rel
from .dark import DarkModel, fit_dark
from .model import Calibration
from .observations import DarkObservation, PatchObservation
from .verification import Verification, VerifiedPlane, z_limits
from .verify import judged


def verify_colour(
    calibration: ColourCalibration,
    observations: Mapping[str, Sequence[PatchObservation]],
    darks: Mapping[str, Sequence[DarkObservation]],
    readings: Mapping[str, Sequence[Reading]],
) -> Verification:
    """Compare patches measured again by a calibrated camera with colour filters with the meter.

    The luminance by the combination of planes is judged as `verify` judges that of a monochrome camera, and the
    darkness plane by plane. The grey patches that the planes were calibrated with tell beside that how the
    responsivity of each plane has changed, and whether the colours have changed alike.

    Parameters
    ----------
    calibration : ColourCalibration
        To verify.
    observations, darks : mapping of str to sequence
        By plane (R, Gr, Gb, B); otherwise as for `verify`.
    readings : mapping of str to sequence of Reading
        New readings by the name of the patch.

    Raises
    ------
    CalibrationError
        As `verify`, naming the plane; and if a plane is missing.
    """
    groups: dict[str, dict[str, list[PatchObservation]]] = {}
    for plane in PLANES:
        for o in observations.get(plane, ()):
            groups.setdefault(o.patch, {}).setdefault(plane, []).append(o)
    if not groups:
        raise CalibrationError("there is no patch to verify the calibration with: give frames and readings of one")
    new = [_dark(one, darks.get(f"{one.state.plane}", ())) for one in calibration.planes]
    read = join_readings(groups, readings, calibration.meter_scale)
    seen = [colour_patch_luminance(calibration, group) for group in groups.values()]
    brightest = max(calibration.planes, key=lambda one: one.responsivity.responsivity_dn_s_cd_m2)
    uneven = [unevenness_rel(group[f"{brightest.state.plane}"], brightest) for group in groups.values()]
    comparison = compare(seen, read, uneven)
    rows = [
        dark_row(d, one, calibration.range_cd_m2[0], weight)
        for one, weight in zip(calibration.planes, calibration.weights, strict=True)
        for d in sorted(darks[f"{one.state.plane}"], key=lambda d: d.exposure_s)
    ]
    limit = z_limits(len(rows))[1]
    moved = {row.plane for row in rows if abs(row.z) > limit}
    with_new = [replace(one, dark=dark) for one, dark in zip(calibration.planes, new, strict=True)]
    # A darkness that has moved is told as such, and is no change of colour.
    now = [a if a.state.plane in moved else b for a, b in zip(with_new, calibration.planes, strict=True)]
    of_planes = plane_drifts(replace(calibration, planes=tuple(now)), groups, read, uneven)
    drifts = (None,) * len(new) if of_planes is None else of_planes.drifts
    of_new_dark = replace(calibration, planes=tuple(with_new))
    return judged(
        calibration,
        comparison,
        comparison.rows([_luminance(of_new_dark, group) for group in groups.values()]),
        rows,
        [
            VerifiedPlane(one.state.plane, dark, drift)
            for one, dark, drift in zip(calibration.planes, new, drifts, strict=True)
        ],
        None if of_planes is None else balance_of(calibration, of_planes),
        float(np.linalg.norm(calibration.weight_errors.sum(axis=1))),
    )


def _dark(plane: Calibration, darks: Sequence[DarkObservation]) -> DarkModel:
    name = f"{plane.state.plane}"
    if not darks:
        raise CalibrationError(f"there are no dark frames of plane {name}: split every Bayer frame and observe all")
    for d in darks:
        plane.require(d.state, f"the set of dark frames of plane {name} at {d.exposure_s:g} s")
    return fit_dark(darks)[0]


def _luminance(calibration: ColourCalibration, group: Mapping[str, Sequence[PatchObservation]]) -> float | None:
    try:
        return colour_patch_luminance(calibration, group).luminance_cd_m2
    except CalibrationError:
        return None
