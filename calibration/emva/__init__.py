"""Characterisation of a camera after EMVA 1288."""
