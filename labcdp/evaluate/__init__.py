"""Evaluation: sources, conversion and metrics joined to results."""

from .guess import guessed_conversion
from .observe import ObservedSession, calibrate_session, observe_session
from .session import ContrastRow, PatchRow, SessionEvaluation, evaluate_session

__all__ = [
    "ContrastRow",
    "ObservedSession",
    "PatchRow",
    "SessionEvaluation",
    "calibrate_session",
    "evaluate_session",
    "guessed_conversion",
    "observe_session",
]
