"""Konica Minolta LS-100 and LS-110 luminance meters."""
