import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.photometry import as_quantum_efficiency, electron_radiance_per_cd_m2, photon_radiance_per_cd_m2


@pytest.mark.parametrize(
    ("spectrum", "photons", "half_digit"),
    [
        ("monochromatic 555 nm", 4.091e15, 0.0005e15),
        ("D65", 1.391e16, 0.0005e16),
        ("A", 2.107e16, 0.0005e16),
        ("LED-B1", 9.57e15, 0.005e15),
        ("LED-B4", 8.74e15, 0.005e15),
        ("LED-B5", 8.93e15, 0.005e15),
    ],
)
def test_photons_per_cd_m2_are_the_reference_figures(spectrum: str, photons: float, half_digit: float) -> None:
    assert photon_radiance_per_cd_m2(spectrum) == pytest.approx(photons, abs=half_digit)


def test_a_photon_of_555_nm_carries_h_c_over_lambda() -> None:
    energy_j = 6.62607015e-34 * 299792458 / 555e-9
    assert photon_radiance_per_cd_m2("monochromatic 555 nm") == pytest.approx(1 / (683 * energy_j), rel=1e-12)


def test_d65_has_204_8_lumen_per_watt() -> None:
    # The mean photon energy links the two: a detector with QE proportional to 1 / lambda measures power.
    table = [(float(nm), 380 / nm) for nm in range(380, 781)]
    power_w = electron_radiance_per_cd_m2("D65", table) * 6.62607015e-34 * 299792458 / 380e-9
    assert 1 / power_w == pytest.approx(204.8, abs=0.05)


@given(split_nm=st.integers(390, 770))
def test_two_detectors_that_share_the_wavelengths_share_the_photons(split_nm: int) -> None:
    below = [(380, 1), (split_nm, 1), (split_nm + 1, 0), (780, 0)]
    above = [(380, 0), (split_nm, 0), (split_nm + 1, 1), (780, 1)]
    both = electron_radiance_per_cd_m2("LED-B1", below) + electron_radiance_per_cd_m2("LED-B1", above)
    assert both == pytest.approx(photon_radiance_per_cd_m2("LED-B1"), rel=1e-12)


def test_unknown_spectrum_names_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"spectrum is 'D66', which is not known.*D65.*LED-B1"):
        photon_radiance_per_cd_m2("D66")


def test_wavelength_out_of_range_is_refused() -> None:
    with pytest.raises(InputError, match=r"'monochromatic 900 nm': give a wavelength from 380 to 780 nm"):
        photon_radiance_per_cd_m2("monochromatic 900 nm")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (1.5, r"quantum_efficiency is 1.5: give a fraction above 0, up to 1"),
        (0, r"quantum_efficiency is 0: give a fraction above 0, up to 1"),
        (float("nan"), r"quantum_efficiency is nan"),
        ("much", r"quantum_efficiency is 'much': give a fraction, or at least two pairs"),
        ([(500, 0.5)], r"at least two pairs of wavelength in nm and value"),
        ([500, 0.5], r"at least two pairs of wavelength in nm and value"),
        ([(600, 0.5)] * 900, r"^quantum_efficiency has the wavelengths .{97}\.\.\. nm: give them in rising order"),
        ([(600, 0.5), (500, 0.5)], r"the wavelengths \[600.0, 500.0\] nm: give them in rising order"),
        ([(500, 0.5), (600, -0.1)], r"the values \[0.5, -0.1\]: give fractions from 0 to 1"),
    ],
)
def test_unusable_quantum_efficiency_is_refused(value: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        as_quantum_efficiency(value)  # type: ignore[arg-type]


def test_works_without_matplotlib_and_leaves_numpy_alone() -> None:
    # colour warns without Matplotlib, and switches NumPy to an old print format.
    program = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "import numpy as np\n"
        "from labcdp.core.photometry import photon_radiance_per_cd_m2\n"
        "before = np.get_printoptions()\n"
        "photons = photon_radiance_per_cd_m2('D65')\n"
        "assert np.get_printoptions() == before, np.get_printoptions()\n"
        "print(f'{photons:.3e}')\n"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=300)
    assert (done.stdout, done.stderr) == ("1.391e+16\n", "")
