import re
from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration.emva import characterise_data_set
from labcdp.errors import CalibrationError, InputError

from .conftest import KnownCamera, Recording, write_data_set

SMALL = KnownCamera(shape=(24, 32))
SHORT = Recording(levels=10, stack=4)
#: Of a value within its stated uncertainty; one in 15 000 beyond.
SIGMAS = 4.0


@pytest.fixture(scope="module")
def found(data_set):
    return characterise_data_set(data_set)


def within(quantity, truth, more=0.0):
    assert abs(quantity.value - truth) <= SIGMAS * quantity.standard_uncertainty + more, quantity


def test_known_camera_is_found(found):
    camera = KnownCamera()
    within(found.k_dn_per_e, camera.k_dn_per_e)
    within(found.quantum_efficiency, camera.quantum_efficiency)
    gain = 1 + camera.prnu_rel * drawn_mean(camera, 0)
    within(found.responsivity, camera.k_dn_per_e * camera.quantum_efficiency * gain)
    within(found.dark_noise_e, camera.read_noise_e)
    within(found.black_level_dn, camera.black_level_dn + camera.k_dn_per_e * camera.dsnu_e * drawn_mean(camera, 1))
    within(found.dark_current_e_s, camera.dark_current_e_s)
    within(found.dark_current_by_variance_e_s, camera.dark_current_e_s)
    within(found.dsnu_e, camera.dsnu_e)
    within(found.prnu_rel, camera.prnu_rel)
    within(found.dsnu_column_e, 0.0)
    within(found.dsnu_row_e, 0.0)


def drawn_mean(camera, pattern):
    """Mean of the pattern this specimen drew, in its standard deviations: 0 for the gains, 1 for the offsets."""
    patterns = np.random.default_rng(camera.seed)
    return float([patterns.standard_normal(camera.shape).mean() for _ in range(2)][pattern])


def test_uncertainties_are_as_small_as_the_images_allow(found):
    # Of one point K is known to sqrt(2 / pixels) twice, of light and darkness; 12 points are better.
    assert found.k_dn_per_e.standard_uncertainty < 0.25 * 2 * sqrt(2 / (64 * 80))
    assert found.dsnu_e.standard_uncertainty < 0.1


def test_saturation_is_that_of_the_converter(found):
    camera = KnownCamera()
    assert found.saturation_limit == "converter"
    photons = (4095 - 20) / camera.k_dn_per_e / camera.quantum_efficiency
    # Noise and PRNU bring the first pixels to the end at 90 % of it; levels are 8 % apart.
    assert 0.9 * photons <= found.saturation_photons.value <= photons
    assert found.saturation_photons.standard_uncertainty == pytest.approx(40_000 / 15 / 2 / sqrt(3), rel=0.1)
    assert any("the converter ends the range, not the full well" in flag for flag in found.flags)


def test_linear_camera_is_linear(found):
    for quantity in (found.linearity_error_min_rel, found.linearity_error_max_rel):
        # The extreme of 14 normal deviations, with PRNU's drift of none.
        assert abs(quantity.value) < 5 * quantity.standard_uncertainty + 1e-5


def test_derived_quantities_follow(found):
    assert found.snr_max.value == pytest.approx(sqrt(found.full_well_e.value))
    assert found.dynamic_range.value == pytest.approx(found.full_well_e.value / found.sensitivity_threshold_e.value)
    photons = found.sensitivity_threshold_e.value / found.quantum_efficiency.value
    assert found.sensitivity_threshold_photons.value == pytest.approx(photons)


def test_everything_but_the_images_is_in_the_dictionary(found):
    values = found.to_dict()
    assert values["k_dn_per_e"]["value"] == found.k_dn_per_e.value
    assert values["doubling_temperature_c"] is None
    assert len(values["series"]) == 16
    assert "spatial" not in values


def test_tiff_images_and_column_pattern(tmp_path):
    camera = replace(KnownCamera(), column_dsnu_e=6.0)
    found = characterise_data_set(write_data_set(tmp_path / "set", camera, Recording(suffix=".tif", levels=8)))
    within(found.dsnu_column_e, 6.0)
    within(found.dsnu_pixel_e, 3.0)


def test_progress_is_told(tmp_path):
    calls = []
    characterise_data_set(write_data_set(tmp_path / "set", SMALL, SHORT), lambda *done: calls.append(done))
    assert calls == [(number, 48) for number in range(1, 49)]


@pytest.mark.parametrize(
    ("camera", "how", "flag"),
    [
        (SMALL, replace(SHORT, exposure_unit_s=1e-3), r"exposures are 1 to 20 ns, which no camera series has"),
        (SMALL, replace(SHORT, exposure_unit_s=1.0), r"exposures are 0\.001 to 0\.02 ns, which no camera"),
        (SMALL, replace(SHORT, exposure_unit_s=25e-9), r"longest exposure is 800 us, which is rare .* microseconds"),
        (
            SMALL,
            replace(SHORT, exposure_unit_s=1e-14),
            r"dark current is 2\.?\d*e-02 e-/s|0\.02\d? e-/s, which only a cooled",
        ),
        (SMALL, replace(SHORT, photon_factor=0.1), r"quantum efficiency is [45]\.\d*, more than 1 electron per photon"),
        (SMALL, replace(SHORT, photon_factor=1e4), r"quantum efficiency is [45]\.?\d*e-05, less than 0\.1 %"),
        (SMALL, replace(SHORT, bits_told=16, multiply=16), r"all values are multiples of 16: the camera's 12 bits"),
        (SMALL, replace(SHORT, bits_told=14), r"the images saturate at 4095 DN, less than half of what 14 bits"),
        (SMALL, replace(SHORT, levels=8), r"the series has 8 points: the standard asks for at least 9"),
        (
            SMALL,
            replace(SHORT, last_photons=20_000),
            r"saturation was not reached \(up to 2[45]\d\d DN above",
        ),
        (SMALL, replace(SHORT, stack=0), r"there is no stack of dark images, so DSNU and PRNU are not known"),
        (replace(SMALL, black_level_dn=1.0, dark_current_e_s=0), SHORT, r"% of the values in darkness at .* are 0 DN"),
    ],
)
def test_what_is_suspicious_is_flagged(tmp_path, camera, how, flag):
    found = characterise_data_set(write_data_set(tmp_path / "set", camera, how))
    assert any(re.search(flag, told) for told in found.flags), found.flags


def test_a_falling_darkness_is_flagged(tmp_path):
    class Cooling(KnownCamera):
        def images(self, photons, exposure_s, count, rng):
            warm = replace(SMALL, black_level_dn=30 - 500 * exposure_s, dark_current_e_s=0.0)
            return warm.images(photons, exposure_s, count, rng)

    found = characterise_data_set(write_data_set(tmp_path / "set", Cooling(shape=SMALL.shape), SHORT))
    assert found.dark_current_e_s.value == pytest.approx(-2000, abs=4 * found.dark_current_e_s.standard_uncertainty)
    assert any("dark current by the mean is -" in flag and "which is impossible" in flag for flag in found.flags)


def test_a_full_well_below_the_converters_end_is_found(tmp_path):
    camera = replace(KnownCamera(), full_well_e=12_000.0)
    found = characterise_data_set(write_data_set(tmp_path / "set", camera))
    assert found.saturation_limit == "full well"
    assert found.full_well_e.note.startswith("saturation capacity of EMVA 1288, at the peak of the temporal variance")
    assert found.full_well_e.value == pytest.approx(12_000, abs=4 * found.full_well_e.standard_uncertainty)
    assert not any("converter ends" in flag for flag in found.flags)


def test_denoised_images_are_flagged(tmp_path):
    class Denoised(KnownCamera):
        def images(self, photons, exposure_s, count, rng):
            images = SMALL.images(photons, exposure_s, count, rng)
            if photons < 12_000:
                return images
            mean = np.mean(images, axis=0)
            return [np.rint(mean + (image - mean) / 4).astype(np.uint16) for image in images]

    how = replace(SHORT, last_photons=24_000)
    found = characterise_data_set(write_data_set(tmp_path / "set", Denoised(shape=SMALL.shape), how))
    assert any("though the signal still rises: the images are denoised" in flag for flag in found.flags)


def test_equal_images_are_refused(tmp_path):
    class Copied(KnownCamera):
        def images(self, photons, exposure_s, count, rng):
            return SMALL.images(photons, exposure_s, 1, rng) * count

    index = write_data_set(tmp_path / "set", Copied(shape=SMALL.shape), SHORT)
    with pytest.raises(InputError, match=r"line 6: b_000_001\.png has the same pixels as b_000_000\.png \(line 5\)"):
        characterise_data_set(index)


def test_noise_that_does_not_grow_is_refused(tmp_path):
    class Denoised(KnownCamera):
        def images(self, photons, exposure_s, count, rng):
            mean = round(0.1 * photons) + 20
            return [(mean + rng.integers(-3, 4, self.shape)).astype(np.uint16) for _ in range(count)]

    index = write_data_set(tmp_path / "set", Denoised(shape=SMALL.shape, seed=3), SHORT)
    with pytest.raises(CalibrationError, match=r"noise does not grow with the signal"):
        characterise_data_set(index)


def test_a_level_without_darkness_is_refused(tmp_path):
    index = write_data_set(tmp_path / "set", SMALL, SHORT)
    index.write_text(index.read_text().replace("d 1e+06\n", "d 1.5e+06\n"))
    with pytest.raises(InputError, match=r"line 4: there are no dark images at 1e\+06 ns: record them"):
        characterise_data_set(index)


def test_mixed_sizes_are_refused(tmp_path):
    index = write_data_set(tmp_path / "set", SMALL, SHORT)
    from .conftest import write_image

    write_image(index.parent / "images" / "d_003_001.png", np.zeros((10, 12), np.uint16))
    with pytest.raises(InputError, match=r"d_003_001\.png has 12 x 10 pixels, the index says 32 x 24"):
        characterise_data_set(index)
