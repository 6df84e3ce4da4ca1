"""Comparison of the published values of the 2018 thesis with those of labcdp."""
