"""Contrast, CDP and related metrics of two regions of a luminance map, with uncertainties."""
