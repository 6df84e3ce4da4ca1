"""Flat fields and their structure."""
