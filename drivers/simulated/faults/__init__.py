"""Faults and drifts of the simulated bench."""
