"""The sensor of a chain from EMVA 1288 results: what is stated comes back, by the relations of the standard."""

from math import sqrt

import numpy as np
import pytest

import labcdp
from labcdp.calibration.emva.snr import snr
from labcdp.core.errors import InputError
from labcdp.evaluate.camera.characterise import characterise_session
from labcdp.evaluate.camera.result import result
from labcdp.evaluate.camera.sensor import chain_text, with_emva1288
from labcdp.report.envelope import envelope_json


@pytest.fixture
def sheet(tmp_path):
    def write(text):
        path = tmp_path / "sheet.toml"
        path.write_text(f"[emva1288]\n{text}")
        return path

    return write


@pytest.fixture(scope="module")
def camera():
    return labcdp.Chain.load("imx250")


def test_what_a_sheet_states_is_what_the_sensor_has(camera, sheet):
    """SNR is 1 at the stated threshold, and the stated largest one at saturation."""
    text = "quantum_efficiency = 0.6\nk_dn_per_e = 0.4\nsnr_max_db = 40.0\nsensitivity_threshold_photons = 10.0"
    sensor = camera.with_emva1288(sheet(text)).sensors[0][1]
    assert sensor.full_well_e == pytest.approx(10**4)
    assert sensor.dark_noise_dn() / 0.4 + 0.5 == pytest.approx(6.0)  # eta mu_p.min = sigma_y.dark / K + 1/2
    # That is where SNR is 1, but for 1/4 in the square of the noise.
    assert snr(np.array([6.0]), sensor.read_noise_e, 0.4)[0] == pytest.approx(6 / sqrt(5.5**2 + 6))
    same = camera.with_emva1288(sheet("quantum_efficiency = 0.6\nk_dn_per_e = 0.4\nfull_well_e = 10000.0\n"
                                      f"dynamic_range_db = {20 * np.log10(1e4 / 6)}"))  # fmt: skip
    assert same.sensors[0][1].read_noise_e == pytest.approx(sensor.read_noise_e)
    assert sensor.pixel_pitch_m == camera.sensors[0][1].pixel_pitch_m


def test_quantum_efficiency_at_a_wavelength_scales_the_shape(camera, sheet):
    found = camera.with_emva1288(sheet("quantum_efficiency = 0.335\nwavelength_nm = 525")).sensors[0][1]
    before, after = (np.array(one.quantum_efficiency) for one in (camera.sensors[0][1], found))
    assert after[:, 0].tolist() == before[:, 0].tolist()
    assert after[:, 1] == pytest.approx(before[:, 1] / 2, abs=1e-4)


def test_a_characterised_camera_is_a_chain(recorded, tmp_path):
    """The example session is of the preset manta-g505, whose values come back within their uncertainty."""
    path = tmp_path / "results.json"
    found = characterise_session(recorded)
    path.write_text(envelope_json(result(found)))
    chain, keys = with_emva1288(labcdp.Chain.load("imx250"), path)
    sensor, true = chain.sensors[0][1], labcdp.Chain.load("manta-g505").sensors[0][1]
    quantities = found.quantities()
    for key, name in (("k_dn_per_e", "k_dn_per_e"), ("dark_noise_e", "read_noise_e"), ("prnu_rel", "prnu_rel")):
        one = quantities[key]
        assert getattr(sensor, name) == one.value
        assert abs(getattr(sensor, name) - getattr(true, name)) < 4 * one.standard_uncertainty
    assert (sensor.width, sensor.height, sensor.bits) == (480, 400, 12)
    assert sensor.column_dsnu_e >= 0
    (tmp_path / "my.toml").write_text(chain_text("imx250", path))
    loaded = labcdp.Chain.load(tmp_path / "my.toml")
    assert loaded.sensors[0][1] == sensor
    assert "pixel_pitch_m = 3.45e-06  # preset imx250" in (tmp_path / "my.toml").read_text()
    assert "read_noise_e" in keys


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("full_wel_e = 1.0", r"\[emva1288\] has the key 'full_wel_e': give some of"),
        ("snr_max_db = 'a'", "snr_max_db is 'a': give a number above 0"),
        ("saturation_photons = 9000.0", "saturation_photons needs quantum_efficiency as one number"),
        ("quantum_efficiency = 0.9\nwavelength_nm = 780", "does not fit the shape of the preset"),
        ("full_well_e = -1.0", "full_well_e"),
    ],
)
def test_bad_sheets_are_refused(camera, sheet, text, message):
    with pytest.raises(InputError, match=message):
        camera.with_emva1288(sheet(text))


def test_only_a_chain_with_one_emva_sensor_takes_results(sheet):
    with pytest.raises(InputError, match="has no single sensor of type emva1288"):
        labcdp.Chain.load("thesis-2018").with_emva1288(sheet("full_well_e = 9000.0"))
