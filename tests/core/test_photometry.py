import colour
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.photometry import as_quantum_efficiency, electron_radiance_per_cd_m2, photon_radiance_per_cd_m2

#: h c in J m.
HC = 6.62607015e-34 * 299792458


@pytest.mark.parametrize("spectrum", ["D65", "A", "E", "LED-B1", "LED-B4", "LED-B5"])
def test_photons_per_cd_m2_are_the_integral_from_380_to_780_nm(spectrum):
    # Both tables are linear between their points, so the middles of steps of 0.001 nm leave an error of 1e-8.
    light, visibility = colour.SDS_ILLUMINANTS[spectrum], colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"]
    nm = np.arange(380.0005, 780, 0.001)
    power = np.interp(nm, light.wavelengths, light.values, left=0)
    lumens = 683 * (power * np.interp(nm, visibility.wavelengths, visibility.values)).sum()
    photons = (power * nm * 1e-9 / HC).sum()
    assert photon_radiance_per_cd_m2(spectrum) == pytest.approx(photons / lumens, rel=5e-5)


@given(split_nm=st.integers(390, 770))
def test_two_detectors_that_share_the_wavelengths_share_the_photons(split_nm):
    below = [(380, 1), (split_nm, 1), (split_nm + 1, 0), (780, 0)]
    above = [(380, 0), (split_nm, 0), (split_nm + 1, 1), (780, 1)]
    both = electron_radiance_per_cd_m2("LED-B1", below) + electron_radiance_per_cd_m2("LED-B1", above)
    assert both == pytest.approx(photon_radiance_per_cd_m2("LED-B1"), rel=1e-12)


@pytest.mark.parametrize("spectrum", ["D66", "monochromatic 900 nm"])
@pytest.mark.parametrize("efficiency", ["much", [(600, 0.5)] * 900, [(500, 0.5), (600, -0.1)]])
def test_unusable_spectra_and_efficiencies_are_refused(spectrum, efficiency):
    for use, value in ((photon_radiance_per_cd_m2, spectrum), (as_quantum_efficiency, efficiency)):
        with pytest.raises(InputError, match=r"^(spectrum|quantum_efficiency) "):
            use(value)
