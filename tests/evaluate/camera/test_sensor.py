"""The sensor of a chain from EMVA 1288 results: what is stated comes back, by the relations of the standard."""

import json
from dataclasses import replace
from math import log10, sqrt

import numpy as np
import pytest

import labcdp
from labcdp.calibration.emva.quantities import snr
from labcdp.core.errors import InputError
from labcdp.evaluate.camera.characterise import characterise_session
from labcdp.evaluate.camera.result import result
from labcdp.evaluate.camera.sensor import chain_text
from labcdp.report.files import SCHEMA, envelope_json


@pytest.fixture
def sheet(tmp_path):
    def write(text):
        path = tmp_path / "sheet.toml"
        path.write_text(f"[emva1288]\n{text}")
        return path

    return write


def sensor_of(preset, results):
    return labcdp.Chain.load(preset).with_emva1288(results).sensors[0][1]


def seen(sensor, electrons):
    """Pixels of a frame with so many electrons on average."""
    rate = np.full(sensor.shape, electrons / 1e-3)
    return sensor.expose(rate, 1e-3, 0.0, temperature_c=25.0, seed=1, exposure_index=0).astype(float)


def test_what_a_sheet_states_is_what_the_sensor_has(sheet):
    """SNR is 1 at the stated threshold, and the stated largest one at saturation."""
    common = "quantum_efficiency = 0.6\nk_dn_per_e = 0.4\n"
    sensor = sensor_of("imx250", sheet(f"{common}snr_max_db = 40.0\nsensitivity_threshold_photons = 10.0"))
    assert sensor.full_well_e == pytest.approx(10**4)
    assert sensor.dark_noise_dn() / 0.4 + 0.5 == pytest.approx(6.0)  # eta mu_p.min = sigma_y.dark / K + 1/2
    # That is where SNR is 1, but for 1/4 in the square of the noise.
    assert snr(np.array([6.0]), sensor.read_noise_e, 0.4)[0] == pytest.approx(6 / sqrt(5.5**2 + 6))
    same = sensor_of("imx250", sheet(f"{common}full_well_e = 1e4\ndynamic_range_db = {20 * log10(1e4 / 6)}"))
    assert same.read_noise_e == pytest.approx(sensor.read_noise_e)


def test_a_sheet_without_k_gives_a_camera_that_has_its_ratios(sheet):
    """Photon transfer of simulated frames (dark, half, full) gives the stated SNR_max = sqrt(mu_e.sat) and DR."""
    path = sheet("bits = 12\nsnr_max_db = 40.3\ndynamic_range_db = 71.2\nwidth = 300\nheight = 300")
    sensor = replace(sensor_of("manta-g505", path), dsnu_e=0.0, dsnu_e_s=0.0, prnu_rel=0.0)
    (dark, dark_variance), (half, variance), (full, _) = (
        (one.mean(), one.var()) for one in (seen(sensor, e) for e in (0.0, 5000.0, 1e6))
    )
    k = (variance - dark_variance) / (half - dark)
    # K and sigma_y.dark are known to sqrt(2 / N) and sqrt(1 / (2 N)).
    k_rel = sqrt(2 / 300**2)
    assert 20 * log10(sqrt((full - dark) / k)) == pytest.approx(40.3, abs=4 * 10 / np.log(10) * k_rel)
    threshold_e = sqrt(dark_variance) / k + 0.5
    assert 20 * log10((full - dark) / k / threshold_e) == pytest.approx(71.2, abs=4 * 20 / np.log(10) * k_rel)


@pytest.mark.parametrize(
    ("preset", "limit", "full_well_e"),
    [("manta-g505", "converter", 7000.0), ("small", "not reached", 4031 / 0.6), ("manta-g505", "full well", 1682.0)],
)
def test_a_converter_that_ends_first_at_a_gain_does_not_limit_the_chain(tmp_path, preset, limit, full_well_e):
    """At 12 dB the converter of the manta-g505 ends at a quarter of its range in electrons at 0 dB."""
    values = {"k_dn_per_e": 0.6 * 10 ** (12 / 20), "black_level_dn": 64.0, "full_well_e": 1682.0}
    made = {"gain_db": 12.0, "bits": 12, "width": 300, "height": 300, "saturation_limit": limit}
    tables = {"characterisation": {"rows": [{"key": key, "value": value} for key, value in values.items()]}}
    document = {"schema": SCHEMA, "kind": "characterise", "configuration": made, "tables": tables}
    (tmp_path / "results.json").write_text(json.dumps(document))
    if preset == "small":
        preset = str(tmp_path / "small.toml")
        labcdp.Chain.load("manta-g505").with_(sensor__full_well_e=500.0).save(preset)
    sensor = sensor_of(preset, tmp_path)
    assert sensor.full_well_e == pytest.approx(full_well_e)
    assert (seen(sensor, 1e6).max() == 4095) == (limit != "full well")
    made["gain_db"] = None  # as of a data set
    (tmp_path / "results.json").write_text(json.dumps(document))
    assert sensor_of(preset, tmp_path).k_dn_per_e == values["k_dn_per_e"]


def test_a_characterised_camera_is_a_chain(recorded, tmp_path):
    """What is measured of the example session is what the sensor has, and the file of the chain holds it."""
    path, found = tmp_path / "results.json", characterise_session(recorded)
    path.write_text(envelope_json(result(found)))
    sensor = sensor_of("imx250", path)
    for key, name in (("k_dn_per_e", "k_dn_per_e"), ("dark_noise_e", "read_noise_e"), ("prnu_rel", "prnu_rel")):
        assert getattr(sensor, name) == found.quantities()[key].value
    assert (sensor.width, sensor.height, sensor.bits) == (480, 400, 12)
    (tmp_path / "my.toml").write_text(chain_text("imx250", path))
    assert labcdp.Chain.load(tmp_path / "my.toml").sensors[0][1] == sensor


def test_bad_sheets_are_refused(sheet):
    for text, message in (
        ("full_wel_e = 1.0", r"\[emva1288\]: full_wel_e is not a known key: did you mean full_well_e"),
        ("dynamic_range_db = 100000", "dynamic_range_db is 100000 dB: give a number above 0, up to 200 dB"),
        ("black_level_dn = 4095\ndark_noise_dn = 3.0", "k_dn_per_e is 0.0: give"),
        ("saturation_photons = 9000.0", "saturation_photons needs quantum_efficiency as one number"),
    ):
        with pytest.raises(InputError, match=rf"sheet\.toml.*{message}"):
            sensor_of("imx250", sheet(text))
