"""Measurement of patches and dark signal from frames."""
