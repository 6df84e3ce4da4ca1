import subprocess
import sys

import colour
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.photometry import as_quantum_efficiency, electron_radiance_per_cd_m2, photon_radiance_per_cd_m2


@pytest.mark.parametrize("spectrum", ["D65", "A", "E", "LED-B1", "LED-B4", "LED-B5"])
def test_photons_per_cd_m2_are_the_integral_from_380_to_780_nm(spectrum: str) -> None:
    # Both tables are linear between their points, so the middles of steps of 0.001 nm leave an error of 1e-8.
    light, visibility = colour.SDS_ILLUMINANTS[spectrum], colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"]
    nm = np.arange(380.0005, 780, 0.001)
    power = np.interp(nm, light.wavelengths, light.values, left=0)
    lumens = 683 * (power * np.interp(nm, visibility.wavelengths, visibility.values)).sum()
    photons = (power * nm * 1e-9 / (6.62607015e-34 * 299792458)).sum()
    assert photon_radiance_per_cd_m2(spectrum) == pytest.approx(photons / lumens, rel=5e-5)


def test_a_photon_of_555_nm_carries_h_c_over_lambda() -> None:
    energy_j = 6.62607015e-34 * 299792458 / 555e-9
    assert photon_radiance_per_cd_m2("monochromatic 555 nm") == pytest.approx(1 / (683 * energy_j), rel=1e-12)


def test_d65_has_205_lumen_per_watt() -> None:
    # The mean photon energy links the two: a detector with QE proportional to 1 / lambda measures power.
    table = [(float(nm), 380 / nm) for nm in range(380, 781)]
    power_w = electron_radiance_per_cd_m2("D65", table) * 6.62607015e-34 * 299792458 / 380e-9
    assert 1 / power_w == pytest.approx(205.15, abs=0.01)


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
    assert (done.stdout, done.stderr) == ("1.389e+16\n", "")
