"""Regions that follow their objects from frame to frame."""

from .methods import METHODS, method_among, methods_of
from .tracked_roi import NotFollowedError, TrackedRoi
from .tracker import Tracker, make_tracker

__all__ = ["METHODS", "NotFollowedError", "TrackedRoi", "Tracker", "make_tracker", "method_among", "methods_of"]
