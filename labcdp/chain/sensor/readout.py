"""The steps from mean electrons to digital numbers, in the order of the EMVA 1288 camera model.

Photo and dark electrons share one Poisson process, the well clips them, reading adds noise, the system gain and
the black level make digital numbers, which are rounded and clipped. EMVA 1288 Release 3.1, section 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]


def collect_electrons(mean_e: FloatArray, full_well_e: float, rng: np.random.Generator) -> FloatArray:
    """Draw the electrons each pixel holds at the end of an exposure.

    Parameters
    ----------
    mean_e : ndarray of float32
        Mean photo and dark electrons, at least 0.
    full_well_e : float
        Most electrons a pixel can hold; up to 1e7, so that float32 holds every count exactly.
    rng : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    ndarray of float32
        Whole electrons, from 0 to `full_well_e`.
    """
    # 30 sigma above the full well the outcome is certain, and the Poisson sampler has a largest mean.
    certain_e = np.float32(4 * full_well_e + 1000)
    electrons = rng.poisson(np.minimum(mean_e, certain_e)).astype(np.float32)
    return np.minimum(electrons, np.float32(full_well_e), out=electrons)


def read_out(electrons: FloatArray, offset_e: FloatArray, read_noise_e: float, rng: np.random.Generator) -> FloatArray:
    """Add the fixed offset and the normal read noise, both in electrons."""
    signal = rng.standard_normal(electrons.shape, dtype=np.float32)
    signal *= np.float32(read_noise_e)
    signal += electrons
    signal += offset_e
    return signal


def digitise(signal_e: FloatArray, k_dn_per_e: float, black_level_dn: float, bits: int) -> NDArray[np.uint16]:
    """Digital numbers K e + black level, rounded to the nearest and clipped to 0 .. 2^bits - 1.

    Rounding adds a variance of 1/12 DN^2 and no bias.
    """
    dn: NDArray[Any] = signal_e * np.float32(k_dn_per_e)
    dn += np.float32(black_level_dn)
    np.rint(dn, out=dn)
    np.clip(dn, 0, 2**bits - 1, out=dn)
    return dn.astype(np.uint16)
