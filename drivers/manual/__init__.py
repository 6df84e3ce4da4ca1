"""Readings typed by hand or read from a file."""
