"""Figures: style, images, maps and plots."""
