"""Several exposures and how they are merged."""
