"""Errors and the uncertainty budget."""
