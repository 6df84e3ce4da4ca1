"""What researchers use from Python: thin objects over the evaluations, with results as xarray datasets."""
