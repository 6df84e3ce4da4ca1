"""Simulated and predicted CDP over parameters of a chain."""
