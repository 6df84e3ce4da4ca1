"""Colours of the patches of a session."""

from __future__ import annotations

from ...core.errors import InputError
from ..colour.measure import PairColours, measure_colours
from ..colour.planes import frame_colours
from .session import SessionEvaluation


def session_colours(evaluation: SessionEvaluation, epsilon: float | None = None) -> tuple[PairColours, ...]:
    """Separate the colours of the pairs of a session, in the frames that their contrasts are evaluated in.

    Parameters
    ----------
    evaluation : SessionEvaluation
        The session.
    epsilon : float or None
        Relative tolerance of the difference of chromaticity; None for that of each pair's contrast.

    Raises
    ------
    InputError
        If the camera has no colour filter, or a pair was recorded in two frames.
    """
    observed, calibration = evaluation.observed, evaluation.calibration
    records = {record.number: record for record in observed.session.frames("light")}
    pairs: list[PairColours] = []
    for row in {row.name: row for row in evaluation.contrasts}.values():
        if row.frame_number != row.dark_frame_number:
            raise InputError(f"{row.name}: the patches were shown one by one: colours need both in one frame")
        frame = observed.frame(records[row.frame_number])
        if frame.colour_filter is None:
            raise InputError("the camera of the session has no colour filter: its patches have no colours to separate")
        tolerance = row.target.epsilon if epsilon is None else epsilon
        regions = row.bright.region, row.dark.region
        pairs += measure_colours(
            frame_colours(frame, calibration), regions, [(row.target.bright, row.target.dark)], tolerance
        )
    return tuple(pairs)
