"""Alignment of a region with the first frame."""
