"""Predictions of a chain without random numbers: distributions of DN, CDP and its relatives."""
