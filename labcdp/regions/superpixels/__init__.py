"""Superpixels and the regions that are proposed from them."""
