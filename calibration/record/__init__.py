"""Calibration files, and their history."""
