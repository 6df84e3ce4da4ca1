"""The definition of CDP, every pair visited in exact rational arithmetic."""

from fractions import Fraction
from math import inf, nan

import pytest


@pytest.fixture(scope="session")
def all_contrasts():
    """Contrast of each pair of the brighter and the darker of two lists of integers: Fraction, inf or nan."""

    def contrasts(a, b):
        bright, dark = (a, b) if Fraction(sum(a), len(a)) >= Fraction(sum(b), len(b)) else (b, a)
        return [[_contrast(x, d) for x in bright] for d in dark]

    return contrasts


def _contrast(bright, dark):
    if dark > 0:
        return Fraction(bright, dark) - 1
    return inf if bright > 0 else nan
