"""Spatially correlated noise, and the CDP of regions with it."""
