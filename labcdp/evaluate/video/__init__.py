"""CDP of videos, frame by frame."""
