"""Camera specifications: what a file may say, and what it must not."""

import re
from math import pi

import pytest

from labcdp.core.errors import ConfigurationError
from labcdp.core.photometry import photon_radiance_per_cd_m2
from labcdp.evaluate.picture.camera_specification import load_camera_specification
from labcdp.session.configuration import example_session

EXAMPLE = example_session().parent / "cameras" / "thesis-2018.toml"


@pytest.fixture
def written(tmp_path):
    """The example with some keys replaced, and further lines."""

    def write(more="", **changes):
        text = EXAMPLE.read_text(encoding="utf-8")
        for key, value in changes.items():
            text, n = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
            assert n == 1
        path = tmp_path / "camera.toml"
        path.write_text(f"{text}\n{more}\n", encoding="utf-8")
        return path

    return write


def test_electrons_by_hand(written):
    # Light of 555 nm: 683 lm/W and h c / lambda per photon; pi / (4 N^2 (1 + m)^2) lux per cd/m^2; 25 um^2 and QE 0.5.
    path = written(spectrum='"monochromatic 555 nm"', f_number=2.0, lens_transmittance=0.8, magnification=0.25,
                   quantum_efficiency=0.5, pixel_pitch_m=5e-6)  # fmt: skip
    photons_per_lm_s = 555e-9 / (6.62607015e-34 * 299792458 * 683)
    expected = pi * 0.8 / (4 * 2.5**2) * photons_per_lm_s * 0.5 * 25e-12
    assert load_camera_specification(path).electrons_per_cd_m2_s() == pytest.approx(expected, rel=1e-3)


def test_a_table_of_quantum_efficiency_weights_the_spectrum(written):
    table = "[[379, 0.4], [781, 0.4]]"
    flat, tabled = (load_camera_specification(written(quantum_efficiency=q)) for q in (0.4, table))
    assert tabled.electrons_per_cd_m2_s() == pytest.approx(flat.electrons_per_cd_m2_s(), rel=1e-12)
    assert flat.electrons_per_cd_m2_s() / (0.4 * photon_radiance_per_cd_m2("D65")) == pytest.approx(
        pi * 0.9 / (4 * 2.6**2) * (3.45e-6) ** 2
    )


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("pixel_pitch_m", "3.45", "pixel_pitch_m is 3.45 m: give a distance of pixel centres above 0 m, up to 1e-3 m"),
        ("adc_bits", "12.0", "adc_bits is 12.0: give the bits of the converter, 1 to 16"),
        ("quantum_efficiency", '"0.4"', "quantum_efficiency is '0.4': give a fraction, or at least two pairs"),
        ("quantum_efficiency", "[[900, 0.4], [950, 0.4]]", "quantum_efficiency is 0 wherever 'D65' has light"),
        ("read_noise_e", "true", "read_noise_e is true: give a read noise of at least 0 e-"),
        ("spectrum", '"D66"', "spectrum is 'D66', which is not known: give"),
        ("black_dn", "5000.0", "black_dn is 5000 DN, 12 bits end at 4095: give a value up to that"),
    ],
)
def test_wrong_values_and_units_are_named(written, key, value, message):
    with pytest.raises(ConfigurationError, match=re.escape(f"camera.toml: {message}")):
        load_camera_specification(written(**{key: value}))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("pixel_pitch_um = 3.45", "pixel_pitch_um is not a known key: did you mean pixel_pitch_m?"),
        ("[lens]\nmodel = 'x'", "lens is not a known key: known here are format, name"),
        ("x =", "not valid TOML: Invalid value (at line"),
    ],
)
def test_wrong_lines_are_named(written, line, message):
    with pytest.raises(ConfigurationError, match=re.escape(f"camera.toml: {message}")):
        load_camera_specification(written(line))
