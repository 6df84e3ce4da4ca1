"""Verification of a calibration."""
