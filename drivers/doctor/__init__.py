"""Checks that find problems of a bench and their remedies."""
