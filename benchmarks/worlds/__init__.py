"""Outside-world test bench for the statistics of the calibration; see docs/validation.md."""
