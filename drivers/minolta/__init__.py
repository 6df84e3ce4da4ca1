"""Konica Minolta luminance and chroma meters, and meters behind a program that answers on a port."""
