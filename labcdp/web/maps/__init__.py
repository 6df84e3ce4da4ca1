"""Luminance maps on a page: false colours, profile, isolines, limits and export."""
