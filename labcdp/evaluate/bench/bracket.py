"""Response of a camera from the several exposures that a session has of its target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...calibration.response.curve import MIN_EXPOSURES, ResponseCurve, response_from_bracket
from ...core.errors import CalibrationError
from ...core.frame import Frame
from ...session import FrameRecord, Session
from .observe import ObservedSession
from .recorded import by_exposure, by_patch


def response_of_session(session: Session, observed: ObservedSession) -> ResponseCurve:
    """Find the response from a session's light frames, a bracket of the target that stood still.

    Where patches were shown one by one, their frames are laid side by side.

    Parameters
    ----------
    session : Session
        To read the frames from; of a monochrome sensor.
    observed : ObservedSession
        What `observe_session` returned for it, for the dark signal.

    Raises
    ------
    CalibrationError
        If the sensor has colour filters, the session has too few exposures, or as `response_from_bracket`.
    SessionError
        If a file is missing or altered.
    """
    darks = observed.darks  # refuses colour filters
    groups = by_exposure(session, "light")
    if len(groups) < MIN_EXPOSURES:
        there = ", ".join(f"{1e3 * t:g} ms" for t in groups)
        raise CalibrationError(
            f"the session has light frames at {len(groups)} exposure{'s' if len(groups) > 1 else ''} ({there}): the "
            f"response by a bracket needs {MIN_EXPOSURES} or more; record more exposures, a factor of 1.5 to 2.5 apart"
        )
    frames = [frame for records in groups.values() for frame in _scenes(session, records)]
    return response_from_bracket(frames, float(np.mean([dark.mean_dn for dark in darks])))


def _scenes(session: Session, records: Sequence[FrameRecord]) -> list[Frame]:
    """Frames of all that was shown at one exposure."""
    shown = [[session.load(record) for record in group] for group in by_patch(records).values()]
    together = zip(*shown, strict=False)  # as many as there are of each
    return [parts[0].with_pixels(np.concatenate([part.dn for part in parts])) for parts in together]
