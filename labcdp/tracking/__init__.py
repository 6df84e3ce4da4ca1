"""Regions that follow their objects from frame to frame."""

from .tracker import METHODS, TrackedRoi, Tracker, make_tracker

__all__ = ["METHODS", "TrackedRoi", "Tracker", "make_tracker"]
