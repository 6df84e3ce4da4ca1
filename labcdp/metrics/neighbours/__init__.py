"""Nearest-neighbour contrast detection probability: of any image, and at the speed of a video of 8-bit frames."""
