from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration.emva.data_set import characterise_data_set

from .conftest import SHORT, SMALL, KnownCamera, write_data_set

#: Of a value within its stated uncertainty; one in 15 000 beyond.
SIGMAS = 4.0


@pytest.fixture(scope="module")
def found(data_set):
    return characterise_data_set(data_set)


def within(quantity, truth, more=0.0):
    assert abs(quantity.value - truth) <= SIGMAS * quantity.u + more, quantity


def test_known_camera_is_found(found):
    camera = KnownCamera()
    within(found.k_dn_per_e, camera.k_dn_per_e)
    within(found.quantum_efficiency, camera.quantum_efficiency)
    # The patterns' means of this specimen are not 0.
    n, responsivity = camera.shape[0] * camera.shape[1], camera.k_dn_per_e * camera.quantum_efficiency
    within(found.responsivity, responsivity, SIGMAS * responsivity * camera.prnu_rel / sqrt(n))
    within(found.dark_noise_e, camera.read_noise_e)
    within(found.black_level_dn, camera.black_level_dn, SIGMAS * camera.k_dn_per_e * camera.dsnu_e / sqrt(n))
    within(found.dark_current_e_s, camera.dark_current_e_s)
    within(found.dark_current_by_variance_e_s, camera.dark_current_e_s)
    within(found.dsnu_e, camera.dsnu_e)
    within(found.prnu_rel, camera.prnu_rel)
    within(found.dsnu_column_e, 0.0)
    within(found.dsnu_row_e, 0.0)
    assert found.saturation_limit == "converter"
    photons = (4095 - 20) / camera.k_dn_per_e / camera.quantum_efficiency
    # Noise and PRNU bring the first pixels to the end at 90 % of it; levels are 8 % apart.
    assert 0.9 * photons <= found.saturation_photons.value <= photons
    assert found.saturation_photons.u == pytest.approx(40_000 / 15 / 2 / sqrt(3), rel=0.1)


@pytest.mark.parametrize(
    ("code", "how"),
    [
        ("exposures-not-in-ns", {"exposure_unit_s": 1e-3}),
        ("exposures-perhaps-in-us", {"exposure_unit_s": 25e-9}),
        ("exposures-perhaps-in-ps", {"exposure_unit_s": 1e-14}),
        ("photons-too-few", {"photon_factor": 0.1}),
        ("photons-too-many", {"photon_factor": 1e4}),
        ("bits-shifted", {"bits_told": 16, "multiply": 16}),
        ("bits-unused", {"bits_told": 14}),
        ("few-points", {"levels": 8}),
        ("saturation-not-reached", {"last_photons": 20_000}),
        ("no-dark-stack", {"stack": 0}),
    ],
)
def test_what_is_suspicious_is_found(tmp_path, code, how):
    index = write_data_set(tmp_path / "set", SMALL, replace(SHORT, **how))
    assert code in [one.code for one in characterise_data_set(index).findings]


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
    assert "noise-falls" in [one.code for one in found.findings]


def test_of_several_stacks_the_one_at_half_of_the_range_gives_the_nonuniformity(tmp_path):
    index = write_data_set(tmp_path / "set", SMALL, replace(SHORT, stack=0, images=3))
    # A level without light is still one of photons.
    index.write_text(index.read_text().replace("b 1e+06 1000", "b 1e+06 0"))
    found = characterise_data_set(index)
    dark, bright = found.spatial
    assert bright.mean_dn - dark.mean_dn == pytest.approx(0.25 * 0.5 * 18_333, rel=0.02)  # of 1 000 to 40 000 photons
    assert "bright-stacks-alike" in {one.code for one in found.findings}
