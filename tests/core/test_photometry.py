import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.photometry import as_quantum_efficiency, electron_radiance_per_cd_m2, photon_radiance_per_cd_m2

#: h c in J m.
HC = 6.62607015e-34 * 299792458


@pytest.mark.parametrize(
    ("spectrum", "photons", "half_digit"),
    [
        ("monochromatic 555 nm", 555e-9 / (683 * HC), 1e3),
        ("monochromatic 555 nm", 4.091e15, 0.0005e15),
        ("D65", 1.391e16, 0.0005e16),
        ("A", 2.107e16, 0.0005e16),
        ("LED-B1", 9.57e15, 0.005e15),
        ("LED-B4", 8.74e15, 0.005e15),
        ("LED-B5", 8.93e15, 0.005e15),
    ],
)
def test_photons_per_cd_m2_are_the_reference_figures(spectrum, photons, half_digit):
    assert photon_radiance_per_cd_m2(spectrum) == pytest.approx(photons, rel=1e-12, abs=half_digit)


def test_d65_has_204_8_lumen_per_watt():
    # The mean photon energy links the two: a detector with QE proportional to 1 / lambda measures power.
    table = [(float(nm), 380 / nm) for nm in range(380, 781)]
    power_w = electron_radiance_per_cd_m2("D65", table) * HC / 380e-9
    assert 1 / power_w == pytest.approx(204.8, abs=0.05)


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
        (as_quantum_efficiency, 1.5, r"quantum_efficiency is 1.5: give a fraction above 0, up to 1"),
        (as_quantum_efficiency, float("nan"), r"quantum_efficiency is nan"),
        (as_quantum_efficiency, "much", r"quantum_efficiency is 'much': give a fraction, or at least two pairs"),
        (as_quantum_efficiency, [500, 0.5], r"at least two pairs of wavelength in nm and value"),
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
