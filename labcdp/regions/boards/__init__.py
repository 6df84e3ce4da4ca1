"""Checkerboards and step charts found in an image."""
