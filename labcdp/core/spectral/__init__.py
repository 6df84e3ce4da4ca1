"""Measured spectra, f1' and spectral mismatch factors."""
