"""Sensors: EMVA 1288, and the one of the 2018 thesis."""
