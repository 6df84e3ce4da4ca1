"""Characterisation of cameras that are simulated, and so are known, from sessions and from a data set."""

import json
from dataclasses import replace
from math import log2, log10, pi, sqrt

import numpy as np
import pytest

import labcdp
from labcdp.calibration.emva.data_set import characterise_data_set
from labcdp.calibration.emva.quantities import snr
from labcdp.chain import Chain, Sensor
from labcdp.core.errors import CalibrationError, InputError
from labcdp.core.photometry import electron_radiance_per_cd_m2
from labcdp.evaluate.camera.characterise import characterise_session
from labcdp.evaluate.camera.result import characterisation_files, result
from labcdp.evaluate.camera.sensor import chain_text
from labcdp.report.files import SCHEMA, envelope_json
from labcdp.session import Session, example_session

from ...conftest import valid
from ...output.test_results_folder import write
from ..bench.synthetic import configuration, exposed, record

SENSOR = Sensor(
    pixel_pitch_m=5e-6, width=160, height=120, quantum_efficiency=0.5, full_well_e=9000.0, k_dn_per_e=0.35,
    read_noise_e=7.0, dark_current_e_s=400.0, bits=12, black_level_dn=40.0, reference_temperature_c=30.0,
    doubling_temperature_c=7.0, prnu_rel=0.012, dsnu_e=4.0, dsnu_e_s=300.0, device_seed=5,
)  # fmt: skip
#: Six patches, and their light in electrons per second.
ROIS = {f"P{i}": [x, y, 40, 40] for i, (y, x) in enumerate((y, x) for y in (10, 70) for x in (5, 58, 110))}
RATES = np.geomspace(2000, 60_000, 6)


def frames_of(temperatures, exposures_s, rates, sensor=SENSOR):
    """Frames in the dark at each temperature, and in the light at the first one."""
    scene = np.full(sensor.shape, 50.0)
    for (x, y, w, h), rate in zip(ROIS.values(), rates, strict=True):
        scene[y : y + h, x : x + w] = rate
    levels = {"black_level_dn": 40.0, "saturation_dn": sensor.saturation_dn()}
    for at in temperatures:
        for one, role in exposed(sensor, scene, exposures_s, 4, first=round(10 * at), temperature_c=at, **levels):
            if role == "dark" or at == temperatures[0]:
                yield one, role


def characterised(path, change=None, temperatures=(30.0,), rates=RATES, sensor=SENSOR, luminances=None, **bench):
    """Characterisation of a session whose frames were changed, or left out by None."""
    frames = frames_of(temperatures, (0.01, 0.05, 0.2), rates, sensor)
    changed = [(change(*one) if change else one[0], one[1]) for one in frames]
    record(path, configuration(ROIS, **bench), [one for one in changed if one[0] is not None], luminances)
    with Session.open(path) as session:
        return characterise_session(session)


def within(found, truth, more=0.0):
    """The quantities lie within 4 standard uncertainties, and as much more, of what is true."""
    for name, expected in truth.items():
        quantity = getattr(found, name)
        assert abs(quantity.value - expected) <= 4 * quantity.u + more, (name, quantity, expected)


def of(sensor, **names):
    """True values of quantities by attributes of a sensor."""
    return {name: getattr(sensor, attribute) for name, attribute in names.items()}


def test_camera_of_the_example_is_found(recorded):
    found, sensor = characterise_session(recorded), Chain.load("manta-g505").camera().sensor
    names = {"dark_noise_e": "read_noise_e"} | {name: name for name in ("k_dn_per_e", "dsnu_e", "prnu_rel")}
    within(found, of(sensor, **names) | {"dark_current_e_s": sensor.dark_current_at(35.0)})
    within(found, {"black_level_dn": sensor.black_level_dn}, more=0.01)
    within(found, {"linearity_error_min_rel": 0, "linearity_error_max_rel": 0}, more=2e-4)
    assert (found.temperature_c, found.saturation_limit, found.simulated) == (35.0, "converter", True)
    # That of lens and sensor. The simulated meter reads 0.6 % too much, so R comes out as much too small.
    electrons = electron_radiance_per_cd_m2("D65", sensor.quantum_efficiency) * sensor.pixel_pitch_m**2
    truth = sensor.k_dn_per_e * electrons * pi / (4 * 2.6**2) * 0.9
    assert found.responsivity.unit == "DN/(cd m^-2 s)"
    assert found.responsivity.value == pytest.approx(truth / 1.006, rel=0.004)
    # 95 % of the meter's rectangular error of 2 % are within 1.9 %.
    assert pytest.approx(0.019 * found.responsivity.value, rel=0.02) == found.responsivity.U


def test_the_certificate_of_the_meter_corrects_the_responsivity(tmp_path):
    certificate = {"number": "1", "laboratory": "PTB", "date": "2026-01-31", "expanded_uncertainty_rel": 0.01}
    meter, luminances = {"model": "LS-110", "serial": "73323007"}, dict(zip(ROIS, RATES / 1000, strict=True))
    plain, calibrated = (
        characterised(tmp_path / name, luminances=luminances, meter=meter | more).responsivity
        for name, more in (("a", {}), ("b", {"certificate": certificate | {"correction": 1.05}}))
    )
    assert plain.value / calibrated.value == pytest.approx(1.05)
    assert 0.01 < calibrated.U / calibrated.value < 0.015 < plain.U / plain.value


def test_known_sensor_is_found_with_its_doubling_temperature(tmp_path):
    found = characterised(tmp_path / "s", temperatures=(30.0, 38.0, 46.0))
    names = {name: name for name in ("k_dn_per_e", "prnu_rel", "dsnu_e_s")}
    within(found, of(SENSOR, dark_noise_e="read_noise_e", **names))
    within(found, of(SENSOR, dsnu_e="dsnu_e"), more=0.02)
    assert log2(found.doubling_temperature_c.value / 7.0) == pytest.approx(0, abs=0.02)


def test_a_full_well_below_the_converters_end_is_found(tmp_path):
    rates = np.geomspace(2000, 200_000, 6)
    told = characterised(tmp_path / "a", rates=rates)
    found = characterised(tmp_path / "b", lambda frame, _: replace(frame, saturation_dn=4095.0), rates=rates)
    for one in (told, found):
        assert one.saturation_limit == "full well"
        within(one, of(SENSOR, full_well_e="full_well_e", k_dn_per_e="k_dn_per_e", prnu_rel="prnu_rel"))
        within(one, {"linearity_error_max_rel": 0}, more=2e-4)


def test_a_sensor_with_colours_is_characterised_by_one_plane(tmp_path):
    def coloured(frame, _):
        return replace(frame, colour_filter="RG", pixel_format="BayerRG12")

    found = characterised(tmp_path / "s", coloured, sensor=replace(SENSOR, prnu_rel=0.0))
    assert found.camera.endswith("plane Gr")
    assert found.image_shape == (60, 80)
    within(found, of(SENSOR, k_dn_per_e="k_dn_per_e"))


def test_dark_frames_that_do_not_fit_are_told_or_refused(tmp_path):
    warmer = characterised(tmp_path / "a", lambda f, role: replace(f, temperature_c=30.0 if role == "dark" else 36.0))
    (finding,) = (one for one in warmer.findings if one.code == "dark-frames-of-other-temperature")
    assert (finding.values["dark_c"], finding.values["light_c"]) == (30.0, 36.0)
    fewer = characterised(tmp_path / "b", lambda f, role: None if (role, f.exposure_s) == ("dark", 0.05) else f)
    assert {point.exposure_s for point in fewer.series} == {0.01, 0.2}
    with pytest.raises(CalibrationError, match=r"all patches are saturated at all exposures: record shorter"):
        characterised(tmp_path / "c", rates=[5e6] * 6)
    nothing = pytest.raises(CalibrationError, match="the session has no frames")
    with Session.create(tmp_path / "d", configuration(ROIS)) as empty, nothing:
        characterise_session(empty)


def test_quantities_of_a_data_set_and_all_plots_of_the_standard_are_written(data_set, tmp_path):
    found = characterise_data_set(data_set)
    write(tmp_path / "out", characterisation_files(found, result(found)))
    values = valid((tmp_path / "out" / "results.json").read_text())
    rows = {row["key"]: row for row in values["tables"]["characterisation"]["rows"]}
    for key, quantity in found.quantities().items():
        if quantity is not None:
            assert (rows[key]["value"], rows[key]["u_value"]) == (quantity.value, quantity.u)
    assert rows["k_dn_per_e"]["value"] == pytest.approx(0.25, rel=0.05)
    assert rows["snr_max_db"]["value"] == pytest.approx(10 * np.log10(found.full_well_e.value))
    assert len([*(tmp_path / "out" / "figures").iterdir()]) == 9


def test_the_command_takes_a_session_and_nothing_in_it_needs_action(labcdp, tmp_path):
    done = labcdp("characterise", example_session(), "-o", "out")
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr
    assert "Simulated data, not a measurement" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


# The sensor of a chain from EMVA 1288 results: what is stated comes back, by the relations of the standard


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


def test_no_number_of_a_characterisation_is_a_truth_value_or_text(tmp_path):
    values = {"k_dn_per_e": 0.6, "black_level_dn": 64.0, "full_well_e": 1682.0, "dark_noise_e": 5.0}
    made = {"gain_db": 0.0, "bits": 12, "width": 300, "height": 300, "temperature_c": 30.0, "saturation_limit": ""}
    rows = [{"key": key, "value": value} for key, value in values.items()]
    document = {"schema": SCHEMA, "kind": "characterise", "configuration": made}
    document["tables"] = {"characterisation": {"rows": rows}}
    numbers = [(made, key) for key, value in made.items() if value != ""] + [(row, "value") for row in rows]
    for row, key in numbers:
        kept = row[key]
        for row[key] in (True, False, str(kept)):
            (tmp_path / "results.json").write_text(json.dumps(document))
            with pytest.raises(InputError, match="lacks some of the results of labcdp characterise"):
                sensor_of("imx250", tmp_path)
        row[key] = kept


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
