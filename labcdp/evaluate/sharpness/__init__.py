"""Sharpness of a camera: spatial frequency response at slanted edges over the field."""
