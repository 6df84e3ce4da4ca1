"""Images of slanted edges in closed form, which share no code with what measures them."""

from math import cos, pi, radians, sin, sqrt

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr


def edge_image(height, width, angle_deg, sigma_px, dark=20.0, bright=100.0, bend=0.0):
    """Mean over each square pixel of a straight edge behind a Gaussian blur; `bend` moves rows by its square.

    The mean over a square across a line is that over two boxes, of cos and sin of the angle: differences of the second
    antiderivative of the normal distribution.
    """
    across, along = cos(radians(angle_deg)), sin(radians(angle_deg))
    y, x = np.mgrid[:height, :width] + 0.5
    distance = (x - width / 2) * across - (y - height / 2) * along - bend * (y - height / 2) ** 2
    a, b = across / 2, abs(along) / 2
    mean = sum(
        sign * twice_integrated(distance + step, sigma_px)
        for sign, step in ((1, a + b), (-1, a - b), (-1, b - a), (1, -a - b))
    ) / (4 * a * b)
    return dark + (bright - dark) * mean


def twice_integrated(x, sigma):
    """Second antiderivative of the distribution function of a normal distribution, or of a step."""
    if sigma == 0:
        return np.maximum(x, 0) ** 2 / 2
    z = x / sigma
    return ((x**2 + sigma**2) * ndtr(z) + x * sigma * np.exp(-(z**2) / 2) / sqrt(2 * pi)) / 2


def response(frequency, angle_deg, sigma_px):
    """Closed form of the response: Gaussian blur and square pixels."""
    square = np.sinc(frequency * cos(radians(angle_deg))) * np.sinc(frequency * sin(radians(angle_deg)))
    return np.exp(-2 * (pi * sigma_px * frequency) ** 2) * np.abs(square)


def frequency_at(level, angle_deg, sigma_px):
    """Frequency in cycles/pixel at which the closed form is at a level."""
    return brentq(lambda frequency: response(frequency, angle_deg, sigma_px) - level, 1e-6, 1.0)
