"""Frames, readings, luminance maps, regions, units and errors: the types that every package uses."""
