"""Flicker of regions of a video: the frames that are measured, the indices, and their page."""
