from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration.emva import characterise_data_set
from labcdp.report.text import finding_text

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


def test_saturation_is_that_of_the_converter(found):
    camera = KnownCamera()
    assert found.saturation_limit == "converter"
    photons = (4095 - 20) / camera.k_dn_per_e / camera.quantum_efficiency
    # Noise and PRNU bring the first pixels to the end at 90 % of it; levels are 8 % apart.
    assert 0.9 * photons <= found.saturation_photons.value <= photons
    assert found.saturation_photons.standard_uncertainty == pytest.approx(40_000 / 15 / 2 / sqrt(3), rel=0.1)
    assert "converter-saturates" in [one.code for one in found.findings]


@pytest.mark.parametrize(
    ("camera", "how", "code", "value"),
    [
        (SMALL, replace(SHORT, exposure_unit_s=1e-3), "exposures-not-in-ns", ("longest_ns", 20, 20)),
        (SMALL, replace(SHORT, exposure_unit_s=25e-9), "exposures-perhaps-in-us", ("longest_s", 8e-4, 8e-4)),
        (SMALL, replace(SHORT, exposure_unit_s=1e-14), "exposures-perhaps-in-ps", ("dark_current_e_s", 0.018, 0.022)),
        (SMALL, replace(SHORT, photon_factor=0.1), "photons-too-few", ("quantum_efficiency", 4, 6)),
        (SMALL, replace(SHORT, photon_factor=1e4), "photons-too-many", ("quantum_efficiency", 4e-5, 6e-5)),
        (SMALL, replace(SHORT, bits_told=16, multiply=16), "bits-shifted", ("bits", 12, 12)),
        (SMALL, replace(SHORT, bits_told=14), "bits-unused", ("saturation_dn", 4094.5, 4095)),
        (SMALL, replace(SHORT, levels=8), "few-points", ("count", 8, 8)),
        (SMALL, replace(SHORT, last_photons=20_000), "saturation-not-reached", ("net_dn", 2400, 2600)),
        (SMALL, replace(SHORT, stack=0), "no-dark-stack", None),
        (replace(SMALL, black_level_dn=1.0, dark_current_e_s=0), SHORT, "dark-values-clipped", ("share", 0.005, 0.7)),
    ],
)
def test_what_is_suspicious_is_found(tmp_path, camera, how, code, value):
    found = characterise_data_set(write_data_set(tmp_path / "set", camera, how)).findings
    (finding,) = (one for one in found if one.code == code)
    assert finding.severity == "warning"
    assert finding_text(finding)
    if value is not None:
        name, low, high = value
        assert low * (1 - 1e-9) <= finding.values[name] <= high * (1 + 1e-9)


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
