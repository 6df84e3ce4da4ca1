"""Scenes: targets and patches, checkerboards, step charts, images."""
