"""Characterisation of sessions whose camera is simulated, and so is known."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from math import log2, pi

import numpy as np
import pytest

from labcdp.chain import Chain, Sensor
from labcdp.core.errors import CalibrationError
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.photometry import electron_radiance_per_cd_m2
from labcdp.evaluate.camera.characterise import characterise_session
from labcdp.session import Session, SessionConfiguration, example_session

SIGMAS = 4.0
SENSOR = Sensor(
    pixel_pitch_m=5e-6,
    width=160,
    height=120,
    quantum_efficiency=0.5,
    full_well_e=9000.0,
    k_dn_per_e=0.35,
    read_noise_e=7.0,
    dark_current_e_s=400.0,
    bits=12,
    black_level_dn=40.0,
    reference_temperature_c=30.0,
    doubling_temperature_c=7.0,
    prnu_rel=0.012,
    dsnu_e=4.0,
    dsnu_e_s=300.0,
    device_seed=5,
)
RATES = tuple(np.geomspace(2000, 60_000, 6))
CAMERA = CameraIdentity("Test", "Known", "1", simulated=True)


@pytest.fixture(scope="module")
def example():
    with Session.open(example_session()) as session:
        yield characterise_session(session)


def within(quantity, truth, more=0.0):
    assert abs(quantity.value - truth) <= SIGMAS * quantity.standard_uncertainty + more, (quantity, truth)


def test_camera_of_the_example_is_found(example):
    sensor = Chain.load("manta-g505").camera().sensor
    within(example.k_dn_per_e, sensor.k_dn_per_e)
    within(example.dark_noise_e, sensor.read_noise_e)
    within(example.dark_current_e_s, sensor.dark_current_at(35.0))
    within(example.dsnu_e, sensor.dsnu_e)
    within(example.prnu_rel, sensor.prnu_rel)
    within(example.black_level_dn, sensor.black_level_dn, more=0.01)
    assert example.temperature_c == 35.0
    assert example.saturation_limit == "converter"
    assert example.simulated


def test_responsivity_of_the_example_is_that_of_lens_and_sensor(example):
    preset = Chain.load("manta-g505").camera()
    sensor = preset.sensor
    electrons = electron_radiance_per_cd_m2("D65", sensor.quantum_efficiency) * sensor.pixel_pitch_m**2
    truth = sensor.k_dn_per_e * electrons * pi / (4 * 2.6**2) * 0.9
    # The simulated meter reads 0.6 % too much, so R comes out as much too small.
    assert example.responsivity.unit == "DN/(cd m^-2 s)"
    assert example.responsivity.value == pytest.approx(truth / 1.006, rel=0.004)


def test_linear_camera_is_linear(example):
    for quantity in (example.linearity_error_min_rel, example.linearity_error_max_rel):
        assert abs(quantity.value) <= SIGMAS * quantity.standard_uncertainty + 2e-4


def record(folder, temperatures=(30.0,), exposures_s=(0.01, 0.05, 0.2), darks=True, rates=RATES, sensor=SENSOR):
    """A session of six patches, each of 30 x 40 pixels, at rates in electrons per second."""
    base = SessionConfiguration.load(example_session() / "session.toml").model_dump(by_alias=True, exclude_none=True)
    places = [(x, y) for y in (10, 70) for x in (5, 58, 110)]
    patches = [{"name": f"P{i}", "roi": [float(x), float(y), 40.0, 40.0]} for i, (x, y) in enumerate(places)]
    base["target"] = {"name": "six", "patch": patches}
    base["contrast"] = []
    base["plan"] |= {"exposures_s": list(exposures_s)}
    scene = np.full(sensor.shape, 50.0)
    for (x, y), rate in zip(places, rates, strict=True):
        scene[y : y + 40, x : x + 40] = rate
    configuration = SessionConfiguration.from_toml(_toml(base), "test")
    start, number, frames = datetime(2026, 1, 1, tzinfo=UTC), 0, []
    with Session.create(folder, configuration) as session:
        for temperature in temperatures:
            for exposure_s in exposures_s:
                for role, light in (("dark", np.zeros(sensor.shape)), ("light", scene)):
                    if role == "dark" and not darks:
                        continue
                    if role == "light" and temperature != temperatures[0]:
                        continue
                    for _ in range(4):
                        dn = sensor.expose(light, exposure_s, temperature_c=temperature, seed=3, exposure_index=number)
                        number += 1
                        frame = Frame(
                            dn=dn,
                            exposure_s=exposure_s,
                            gain_db=0.0,
                            bit_depth=12,
                            saturation_dn=sensor.saturation_dn(),
                            black_level_dn=40.0,
                            pixel_format="Mono12",
                            colour_filter=None,
                            temperature_c=temperature,
                            timestamp=start + timedelta(seconds=number),
                            camera_timestamp_ns=number,
                            frame_id=number,
                            camera=CAMERA,
                        )
                        frames.append((frame, role, None))
        session.add_frames(frames)
    return Session.open(folder)


def _toml(values):
    from labcdp.core.toml_text import toml_text

    return toml_text(values)


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    with record(tmp_path_factory.mktemp("warm") / "session", temperatures=(30.0, 38.0, 46.0)) as session:
        yield characterise_session(session)


def test_known_sensor_is_found(warm):
    within(warm.k_dn_per_e, SENSOR.k_dn_per_e)
    within(warm.dark_noise_e, SENSOR.read_noise_e)
    within(warm.prnu_rel, SENSOR.prnu_rel)
    within(warm.dsnu_e, SENSOR.dsnu_e, more=0.02)
    within(warm.dsnu_e_s, SENSOR.dsnu_e_s)


def test_dark_signal_at_another_temperature_is_reported(tmp_path):
    with record(tmp_path / "session") as session:
        configuration, records = session.configuration, session.frames()
        frames = [
            (replace(session.load(r), temperature_c=30.0 if r.role == "dark" else 36.0), r.role, None) for r in records
        ]
    with Session.create(tmp_path / "warm", configuration) as session:
        session.add_frames(frames)
    with Session.open(tmp_path / "warm") as session:
        found = characterise_session(session)
    (finding,) = (one for one in found.findings if one.code == "dark-frames-of-other-temperature")
    assert (finding.values["dark_c"], finding.values["light_c"]) == (30.0, 36.0)


def test_doubling_temperature_is_found(warm):
    assert log2(warm.doubling_temperature_c.value / 7.0) == pytest.approx(0, abs=0.02)


def test_without_dark_frames_there_is_no_characterisation(tmp_path):
    with (
        record(tmp_path / "session", darks=False) as session,
        pytest.raises(CalibrationError, match=r"no exposure with at least 2 dark frames: cover the lens"),
    ):
        characterise_session(session)


def test_a_sensor_with_colours_is_characterised_by_one_plane(tmp_path):
    sensor = replace(SENSOR, prnu_rel=0.0)
    with record(tmp_path / "mono", sensor=sensor) as session:
        configuration, records = session.configuration, session.frames()
        frames = [
            (replace(session.load(r), colour_filter="RG", pixel_format="BayerRG12"), r.role, None) for r in records
        ]
    with Session.create(tmp_path / "colour", configuration) as session:
        session.add_frames(frames)
    with Session.open(tmp_path / "colour") as session:
        found = characterise_session(session)
    assert found.camera.endswith("plane Gr")
    assert found.image_shape == (60, 80)
    within(found.k_dn_per_e, SENSOR.k_dn_per_e)


def test_saturated_everywhere_is_refused(tmp_path):
    with (
        record(tmp_path / "session", rates=[5e6] * 6) as session,
        pytest.raises(CalibrationError, match=r"all patches are saturated at all exposures: record shorter"),
    ):
        characterise_session(session)


def test_missing_dark_exposures_are_told(tmp_path):
    with record(tmp_path / "session") as session:
        pass
    with Session.open(tmp_path / "session", writable=True) as session:
        lost = [r for r in session.frames("dark") if r.exposure_s == 0.05]
        session.supersede(lost, "test")
    with Session.open(tmp_path / "session") as session:
        found = characterise_session(session)
    (finding,) = (one for one in found.findings if one.code == "no-dark-frames-at")
    assert finding.values["exposures_s"] == [0.05]
    assert {point.exposure_s for point in found.series} == {0.01, 0.2}
