"""Frames and patches to luminance."""
