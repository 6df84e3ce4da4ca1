"""The definition of CDP, every pair visited in exact rational arithmetic, and its closed form for normal patches."""

from fractions import Fraction
from math import inf, nan

import numpy as np
import pytest

from labcdp.core.luminance import LuminanceMap


@pytest.fixture(scope="session")
def all_contrasts():
    """Contrast of each pair of the brighter and the darker of two lists of integers: Fraction, inf or nan."""

    def contrasts(a, b):
        bright, dark = (a, b) if Fraction(sum(a), len(a)) >= Fraction(sum(b), len(b)) else (b, a)
        return [[_contrast(x, d) for x in bright] for d in dark]

    return contrasts


@pytest.fixture(scope="session")
def assert_array_equals_numbers():
    """Check that the result for an array of contrasts is that of each contrast alone."""

    def check(array, numbers):
        assert array.cdp.shape == array.contrast.shape == (len(numbers),)
        for name in ("cdp", "u", "below", "above", "undefined", "contrast", "interval", "detected_range"):
            np.testing.assert_array_equal(np.transpose(getattr(array, name)), [getattr(one, name) for one in numbers])

    return check


def _contrast(bright, dark):
    if dark > 0:
        return Fraction(bright, dark) - 1
    return inf if bright > 0 else nan


def neighbours_of(image):
    """Each pixel with its right and its lower neighbour, the darker one first."""
    both = (image[:, :-1], image[:, 1:]), (image[:-1], image[1:])
    return [tuple(sorted(pair)) for one, other in both for pair in zip(one.flat, other.flat, strict=True)]


def map_of(luminance, common=(), invalid=None, random_rel=0.01, **errors):
    """A luminance map whose pixels are all valid unless told otherwise."""
    invalid = np.zeros(luminance.shape, dtype=np.uint8) if invalid is None else invalid
    return LuminanceMap(luminance, np.full(luminance.shape, random_rel), common, invalid, **errors)
