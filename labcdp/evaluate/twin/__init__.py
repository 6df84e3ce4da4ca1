"""The simulated twin of a calibrated camera."""
