"""Python interface for researchers: thin objects over the evaluations, with results as xarray datasets."""
