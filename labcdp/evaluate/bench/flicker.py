"""Flicker of the patches of a session, at each exposure time by itself."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

import numpy as np

from ...calibration import AnyCalibration
from ...core.errors import InputError
from ...core.frame import Frame
from ...core.roi import Roi
from ...metrics.region import SATURATED_SHARE, mean_light
from ...session import FrameRecord
from ...session.records import frame_times_s
from ..flicker.measure import RegionFlicker, region_flicker
from .recorded import Report, by_exposure, by_patch
from .session import SessionEvaluation

#: Light of a region in a frame, which is nan without one, and whether it is saturated, and black.
_Light = tuple[float, bool, bool]


def session_flicker(
    evaluation: SessionEvaluation,
    *,
    threshold: float = 0.1,
    tolerance: float = 0.1,
    frequency_hz: float | None = None,
    report: Report = lambda _done, _total: None,
) -> tuple[RegionFlicker, ...]:
    """Measure how the light of the patches of a session flickers from frame to frame.

    Exposure times see different light of a lamp, so that each counts by itself; an exposure at which a patch is
    saturated or black in all frames is left out.

    Parameters
    ----------
    evaluation : SessionEvaluation
        The session.
    threshold, tolerance, frequency_hz
        As of `labcdp.flicker`.
    report : callable
        Called with the number of frames read, and of all frames.

    Returns
    -------
    tuple of RegionFlicker
        Each with its exposure time, the shortest first, in the order of the patches.

    Raises
    ------
    InputError
        If no patch has a value in any frame.
    SessionError
        If a file is missing or altered.
    """
    session, calibration = evaluation.observed.session, evaluation.calibration
    regions = [row.region for row in evaluation.patches]
    groups = by_exposure(session, "light")
    n_frames, n_read = sum(map(len, groups.values())), 0
    limits = {"threshold": threshold, "tolerance": tolerance, "frequency_hz": frequency_hz}
    measured: list[RegionFlicker] = []
    for exposure_s, of_exposure in groups.items():
        for shown, records in by_patch(of_exposure).items():
            seen = [region for region in regions if shown in (None, region.name)]
            rows: list[list[_Light]] = []
            for record in records if seen else ():
                frame = session.load(record)
                rows.append([_light(calibration, frame, region) for region in seen])
                n_read += 1
                report(n_read, n_frames)
            measured += [
                _measured(region, exposure_s, records, [row[index] for row in rows], limits)
                for index, region in enumerate(seen)
            ]
    order = {region.name: index for index, region in enumerate(regions)}
    known = [item for item in measured if np.isfinite(item.values).any()]
    if not known:
        raise InputError(
            "no patch has light in any frame: all are saturated or black; record exposures at which they are not"
        )
    return tuple(sorted(known, key=lambda item: (item.exposure_s, order[item.region])))


def _light(calibration: AnyCalibration, frame: Frame, roi: Roi) -> _Light:
    """Return the mean of a region in cd/m^2, or why there is none."""
    group = 1 if frame.colour_filter is None else 2
    region, shape = roi.divided(group), (frame.shape[0] // group, frame.shape[1] // group)
    window = region.window(shape)
    mean, saturated_share = mean_light(calibration.to_luminance(frame, window), roi, region.mask(shape))
    saturated, black = saturated_share > SATURATED_SHARE, not mean > 0
    return nan if saturated or black else mean, saturated, black


def _measured(
    region: Roi,
    exposure_s: float,
    records: Sequence[FrameRecord],
    lights: Sequence[_Light],
    limits: dict[str, float | None],
) -> RegionFlicker:
    values, saturated, black = (np.array(column) for column in zip(*lights, strict=True))
    return region_flicker(
        region.name, values, np.array(frame_times_s(records)), None, limits, saturated=saturated, black=black,
        exposure_s=exposure_s,
    )  # fmt: skip
