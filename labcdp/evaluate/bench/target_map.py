"""Luminance of the whole target, merged from the frames of a session."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...calibration import AnyCalibration
from ...core.errors import CalibrationError
from ...core.luminance import Invalid, LuminanceMap, chosen
from ...core.roi import Roi
from ...session import FrameRecord, Session
from .observe import ObservedSession
from .recorded import by_exposure, by_patch


def target_map(session: Session, observed: ObservedSession, calibration: AnyCalibration) -> LuminanceMap:
    """Merge the frames of the target, for each pixel from the longest exposure that does not saturate it.

    Where patches were shown one by one, each region shows its patch, and the rest what was around the first one;
    of regions that overlap the last one shows.

    Raises
    ------
    CalibrationError
        If there are no light frames.
    SessionError
        If a file is missing or altered.
    """
    frames: dict[str | None, list[FrameRecord]] = {}
    for group in by_exposure(session, "light").values():
        for patch, records in by_patch(group).items():
            frames.setdefault(patch, []).append(records[0])
    if not frames:
        raise CalibrationError("the session has no light frames: uncover the lens and resume the acquisition")
    first, *others = frames
    target = _merged(session, calibration, frames[first])
    regions = {patch.name: patch.region() for patch in observed.configuration.target.patches}
    for name in others:
        assert name is not None, "a session has patches together or one by one"
        alone = _merged(session, calibration, frames[name])
        target = chosen(_whole_mask(target.scaled(regions[name]), target.shape), alone, target)
    return target


def _merged(session: Session, calibration: AnyCalibration, records: Sequence[FrameRecord]) -> LuminanceMap:
    """Merge frames, the shortest exposure first."""
    merged = calibration.to_luminance(session.load(records[0]))
    for record in records[1:]:
        longer = calibration.to_luminance(session.load(record))
        merged = chosen(longer.invalid & Invalid.SATURATED == 0, longer, merged)
    return merged


def _whole_mask(region: Roi, shape: tuple[int, int]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, dtype=np.bool_)
    mask[region.window(shape)] = region.mask(shape)
    return mask
