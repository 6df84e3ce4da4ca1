"""Maps of CDP: usable range, isolines, transitions."""
