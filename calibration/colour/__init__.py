"""Cameras with colour filters."""
