import subprocess
import sys

import colour
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.photometry import (
    as_quantum_efficiency,
    electron_radiance_per_cd_m2,
    photon_radiance_per_cd_m2,
)

#: h c in J m.
HC = 6.62607015e-34 * 299792458


@pytest.mark.parametrize("spectrum", ["D65", "A", "E", "LED-B1", "LED-B4", "LED-B5"])
def test_photons_per_cd_m2_are_the_integral_from_380_to_780_nm(spectrum: str) -> None:
    # Both tables are linear between their points, so the middles of steps of 0.001 nm leave an error of 1e-8.
    light, visibility = colour.SDS_ILLUMINANTS[spectrum], colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"]
    nm = np.arange(380.0005, 780, 0.001)
    power = np.interp(nm, light.wavelengths, light.values, left=0)
    lumens = 683 * (power * np.interp(nm, visibility.wavelengths, visibility.values)).sum()
    photons = (power * nm * 1e-9 / HC).sum()
    assert photon_radiance_per_cd_m2(spectrum) == pytest.approx(photons / lumens, rel=5e-5)


def test_a_photon_of_555_nm_carries_h_c_over_lambda() -> None:
    energy_j = HC / 555e-9
    assert photon_radiance_per_cd_m2("monochromatic 555 nm") == pytest.approx(1 / (683 * energy_j), rel=1e-12)


@given(split_nm=st.integers(390, 770))
def test_two_detectors_that_share_the_wavelengths_share_the_photons(split_nm):
    below = [(380, 1), (split_nm, 1), (split_nm + 1, 0), (780, 0)]
    above = [(380, 0), (split_nm, 0), (split_nm + 1, 1), (780, 1)]
    both = electron_radiance_per_cd_m2("LED-B1", below) + electron_radiance_per_cd_m2("LED-B1", above)
    assert both == pytest.approx(photon_radiance_per_cd_m2("LED-B1"), rel=1e-12)


@pytest.mark.parametrize(
    ("use", "value", "message"),
    [
        (photon_radiance_per_cd_m2, "D66", r"spectrum is 'D66', which is not known.*D65.*LED-B1"),
        (photon_radiance_per_cd_m2, "monochromatic 900 nm", "'monochromatic 900 nm': give a wavelength"),
        (as_quantum_efficiency, "much", r"quantum_efficiency is 'much': give a fraction, or at least two pairs"),
        (as_quantum_efficiency, [(600, 0.5)] * 900, r"has the wavelengths .{97}\.\.\. nm: give them in rising order"),
        (as_quantum_efficiency, [(500, 0.5), (600, -0.1)], r"the values \[0.5, -0.1\]: give fractions from 0 to 1"),
    ],
)
def test_unusable_spectra_and_efficiencies_are_refused(use, value, message):
    with pytest.raises(InputError, match=message):
        use(value)


def test_works_without_matplotlib_and_leaves_numpy_alone():
    # colour warns without Matplotlib, and switches NumPy to an old print format.
    program = """
import sys; sys.modules["matplotlib"] = None
import numpy as np
from labcdp.core.photometry import photon_radiance_per_cd_m2
before = np.get_printoptions()
print(photon_radiance_per_cd_m2("D65") > 1e16, np.get_printoptions() == before)
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=900)
    assert (done.stdout, done.stderr) == ("True True\n", "")
