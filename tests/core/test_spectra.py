"""Light by its spectrum: mismatch of a meter, photons of a luminance, quantum efficiency."""

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
    spectral_weights,
)
from labcdp.core.spectra import (
    SpectralTable,
    f1_prime,
    least_f1_prime,
    mismatch_factor,
    mismatch_findings,
    read_spectral_file,
    weighted_sum,
)

NM, _, V = spectral_weights("E")


def table(values):
    return SpectralTable(tuple(NM.tolist()), tuple(np.asarray(values, dtype=float).tolist()))


def bell(middle_nm, width_nm):
    return np.exp(-(((NM - middle_nm) / width_nm) ** 2) / 2)


def test_f1_prime_of_a_published_case():
    # F. Rudawski, Lighting Toolbox, cief1: V(lambda)^1.05 has 2.4148 %; the last digits are of the tables' steps.
    assert f1_prime(table(V**1.05)) == pytest.approx(0.024148, abs=2e-5)


@given(middle=st.floats(450, 650), width=st.floats(20, 100), scale=st.floats(0.01, 100))
def test_the_scale_of_a_sensitivity_does_not_matter(middle, width, scale):
    one = table(bell(middle, width) + 1e-6)
    other = table(scale * np.array(one.values))
    assert f1_prime(other) == pytest.approx(f1_prime(one), rel=1e-9)
    assert mismatch_factor(other, "LED-B4", "A") == pytest.approx(mismatch_factor(one, "LED-B4", "A"), rel=1e-9)


def test_a_mismatch_factor_is_the_ratio_of_true_and_indicated_luminance():
    s = bell(530, 60)
    for test_light, calibration in (("LED-B1", "A"), ("D65", "LED-B4")):
        (_, power_t, _), (_, power_c, _) = spectral_weights(test_light), spectral_weights(calibration)
        # A meter that shows 1 per unit of luminance in the light of its calibration.
        responsivity = float(power_c @ s) / float(power_c @ V)
        indicated, true = float(power_t @ s) / responsivity, float(power_t @ V)
        assert mismatch_factor(table(s), test_light, calibration) == pytest.approx(true / indicated, rel=1e-12)


def test_the_least_f1_prime_is_below_all_others():
    exact = least_f1_prime({"R": table(V * (NM > 560)), "G": table(2 * V * (NM <= 560))})
    assert (exact["R"], exact["G"]) == pytest.approx((1, 0.5), rel=1e-6)
    planes = {"R": table(bell(600, 40)), "G": table(bell(535, 40)), "B": table(bell(460, 30))}
    best = least_f1_prime(planes)
    least = f1_prime(weighted_sum(planes, best))
    rng = np.random.default_rng(0)
    for _ in range(300):
        near = {name: weight + rng.normal(0, 0.1) for name, weight in best.items()}
        assert f1_prime(weighted_sum(planes, near)) >= least - 1e-9


def test_a_warning_says_how_much_lights_differ_as_far_as_it_is_known():
    s = table(bell(520, 60))
    found = [mismatch_findings(*of)[0] for of in (("A", "LED-B4", s), ("A", "LED-B4", table(V)), ("A", "lamp", s))]
    assert [one.code for one in found] == [f"light-differs-{how}" for how in ("by", "negligible", "unknown")]
    assert found[0].values["deviation_rel"] == pytest.approx(1 / mismatch_factor(s, "LED-B4", "A") - 1)


@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", ","), ("\t", ",")])
def test_files_of_spectra_are_read(tmp_path, separator, point):
    text = "wavelength_nm r g b\n380 0 0 0\n500 0.5 1 0\n600 1 0.25 0.125\n780 0 0 0"
    (tmp_path / "s.csv").write_text(text.replace(".", point).replace(" ", separator))
    file = read_spectral_file(tmp_path / "s.csv")
    assert list(file.columns) == ["R", "G", "B"]
    assert file.columns["B"].values == (0, 0, 0.125, 0)
    assert file.columns["R"].at([440.0, 900.0]) == pytest.approx([0.25, 0])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("wavelength_nm,s\n380,0\n500,1\n500,1\n780,0\n", "wavelengths do not rise at 500 nm"),
        ("wavelength_nm,s\n380,0\n500,nan\n780,0\n", "line 3: .* a cell that is not a number"),
        ("wavelength_nm,s\n380,0\n500,1_0\n780,0\n", "line 3: .* a cell that is not a number"),
        ("wavelength_nm,s\n380,0\n500,1e999\n780,0\n", "one that is not finite"),
        # A thousand, or one?
        ("wavelength_nm;s\n380;0,5\n500;1.000\n780;0\n", "line 3: .* has another decimal mark"),
        ("wavelength_nm,s\n380,0\n500,1\n650,0.6\n", "ends at 650 nm with 60% of its maximum"),
    ],
)
def test_files_that_are_no_spectra_are_refused(tmp_path, text, match):
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InputError, match=match):
        read_spectral_file(tmp_path / "s.csv")


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
