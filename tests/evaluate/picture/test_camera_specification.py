"""Camera specifications: what a file may say, and what it must not."""

import re
from math import pi

import pytest

from labcdp.core.errors import ConfigurationError
from labcdp.evaluate.picture.camera_specification import CameraSpecification
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
        (tmp_path / "camera.toml").write_text(f"{text}\n{more}\n", encoding="utf-8")
        return tmp_path / "camera.toml"

    return write


@pytest.mark.parametrize("efficiency", [0.5, "[[379, 0.5], [781, 0.5]]"])
def test_electrons_by_hand(written, efficiency):
    # Light of 555 nm: 683 lm/W and h c / lambda per photon; pi / (4 N^2 (1 + m)^2) lux per cd/m^2; 25 um^2 and QE 0.5.
    path = written(spectrum='"monochromatic 555 nm"', f_number=2.0, lens_transmittance=0.8, magnification=0.25,
                   quantum_efficiency=efficiency, pixel_pitch_m=5e-6)  # fmt: skip
    photons_per_lm_s = 555e-9 / (6.62607015e-34 * 299792458 * 683)
    expected = pi * 0.8 / (4 * 2.5**2) * photons_per_lm_s * 0.5 * 25e-12
    assert CameraSpecification.load(path).electrons_per_cd_m2_s() == pytest.approx(expected, rel=1e-3)


def test_wrong_values_units_and_keys_are_named(written):
    for more, values, message in (
        ("", {"pixel_pitch_m": 3.45}, "pixel_pitch_m is 3.45 m: give a distance of pixel centres above 0 m, up to"),
        ("", {"quantum_efficiency": "[[900, 0.4], [950, 0.4]]"}, "quantum_efficiency is 0 wherever 'D65' has light"),
        ("pixel_pitch_um = 3.45", {}, "pixel_pitch_um is not a known key: did you mean pixel_pitch_m?"),
    ):
        with pytest.raises(ConfigurationError, match=re.escape(f"camera.toml: {message}")):
            CameraSpecification.load(written(more, **values))
