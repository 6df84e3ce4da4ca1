"""Characterisation of sessions whose camera is simulated, and so is known."""

from dataclasses import replace
from math import log2, pi

import numpy as np
import pytest

from labcdp.chain import Chain, Sensor
from labcdp.core.errors import CalibrationError
from labcdp.core.photometry import electron_radiance_per_cd_m2
from labcdp.evaluate.camera.characterise import characterise_session
from labcdp.session import Session

from ..bench.synthetic import configuration, exposed, record

SENSOR = Sensor(
    pixel_pitch_m=5e-6, width=160, height=120, quantum_efficiency=0.5, full_well_e=9000.0, k_dn_per_e=0.35,
    read_noise_e=7.0, dark_current_e_s=400.0, bits=12, black_level_dn=40.0, reference_temperature_c=30.0,
    doubling_temperature_c=7.0, prnu_rel=0.012, dsnu_e=4.0, dsnu_e_s=300.0, device_seed=5,
)  # fmt: skip
#: Six patches, and their light in electrons per second.
ROIS = {f"P{i}": [x, y, 40, 40] for i, (y, x) in enumerate((y, x) for y in (10, 70) for x in (5, 58, 110))}
RATES = np.geomspace(2000, 60_000, 6)


def frames_of(roles, temperatures, exposures_s, rates, sensor=SENSOR):
    """Frames in the dark at each temperature, and in the light at the first one."""
    scene = np.full(sensor.shape, 50.0)
    for (x, y, w, h), rate in zip(ROIS.values(), rates, strict=True):
        scene[y : y + h, x : x + w] = rate
    levels = {"black_level_dn": 40.0, "saturation_dn": sensor.saturation_dn()}
    for at in temperatures:
        for one, role in exposed(sensor, scene, exposures_s, 4, first=round(10 * at), temperature_c=at, **levels):
            if role in roles and (role == "dark" or at == temperatures[0]):
                yield one, role


def characterised(path, change=None, roles=("dark", "light"), temperatures=(30.0,), rates=RATES, sensor=SENSOR):
    """Characterisation of a session whose frames were changed, or left out by None."""
    frames = frames_of(roles, temperatures, (0.01, 0.05, 0.2), rates, sensor)
    changed = [(change(*one) if change else one[0], one[1]) for one in frames]
    record(path, configuration(ROIS), [one for one in changed if one[0] is not None])
    with Session.open(path) as session:
        return characterise_session(session)


@pytest.fixture(scope="module")
def example(recorded):
    return characterise_session(recorded)


def within(quantity, truth, more=0.0):
    assert abs(quantity.value - truth) <= 4 * quantity.standard_uncertainty + more, (quantity, truth)


def test_camera_of_the_example_is_found(example):
    sensor = Chain.load("manta-g505").camera().sensor
    within(example.k_dn_per_e, sensor.k_dn_per_e)
    within(example.dark_noise_e, sensor.read_noise_e)
    within(example.dark_current_e_s, sensor.dark_current_at(35.0))
    within(example.dsnu_e, sensor.dsnu_e)
    within(example.prnu_rel, sensor.prnu_rel)
    within(example.black_level_dn, sensor.black_level_dn, more=0.01)
    for quantity in (example.linearity_error_min_rel, example.linearity_error_max_rel):
        within(quantity, 0, more=2e-4)
    assert (example.temperature_c, example.saturation_limit, example.simulated) == (35.0, "converter", True)
    # That of lens and sensor. The simulated meter reads 0.6 % too much, so R comes out as much too small.
    electrons = electron_radiance_per_cd_m2("D65", sensor.quantum_efficiency) * sensor.pixel_pitch_m**2
    truth = sensor.k_dn_per_e * electrons * pi / (4 * 2.6**2) * 0.9
    assert example.responsivity.unit == "DN/(cd m^-2 s)"
    assert example.responsivity.value == pytest.approx(truth / 1.006, rel=0.004)


def test_known_sensor_is_found_with_its_doubling_temperature(tmp_path):
    found = characterised(tmp_path / "s", temperatures=(30.0, 38.0, 46.0))
    within(found.k_dn_per_e, SENSOR.k_dn_per_e)
    within(found.dark_noise_e, SENSOR.read_noise_e)
    within(found.prnu_rel, SENSOR.prnu_rel)
    within(found.dsnu_e, SENSOR.dsnu_e, more=0.02)
    within(found.dsnu_e_s, SENSOR.dsnu_e_s)
    assert log2(found.doubling_temperature_c.value / 7.0) == pytest.approx(0, abs=0.02)


def test_a_full_well_below_the_converters_end_is_found(tmp_path):
    rates = np.geomspace(2000, 200_000, 6)
    told = characterised(tmp_path / "a", rates=rates)
    found = characterised(tmp_path / "b", lambda frame, _: replace(frame, saturation_dn=4095.0), rates=rates)
    for one in (told, found):
        assert one.saturation_limit == "full well"
        within(one.full_well_e, SENSOR.full_well_e)
        within(one.k_dn_per_e, SENSOR.k_dn_per_e)
        within(one.prnu_rel, SENSOR.prnu_rel)
        within(one.linearity_error_max_rel, 0.0, more=2e-4)


def test_a_sensor_with_colours_is_characterised_by_one_plane(tmp_path):
    def coloured(frame, _):
        return replace(frame, colour_filter="RG", pixel_format="BayerRG12")

    found = characterised(tmp_path / "s", coloured, sensor=replace(SENSOR, prnu_rel=0.0))
    assert found.camera.endswith("plane Gr")
    assert found.image_shape == (60, 80)
    within(found.k_dn_per_e, SENSOR.k_dn_per_e)


def test_dark_frames_that_do_not_fit_are_told(tmp_path):
    warmer = characterised(tmp_path / "a", lambda f, role: replace(f, temperature_c=30.0 if role == "dark" else 36.0))
    (finding,) = (one for one in warmer.findings if one.code == "dark-frames-of-other-temperature")
    assert (finding.values["dark_c"], finding.values["light_c"]) == (30.0, 36.0)
    fewer = characterised(tmp_path / "b", lambda f, role: None if (role, f.exposure_s) == ("dark", 0.05) else f)
    (finding,) = (one for one in fewer.findings if one.code == "no-dark-frames-at")
    assert finding.values["exposures_s"] == [0.05]
    assert {point.exposure_s for point in fewer.series} == {0.01, 0.2}


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"roles": ("light",)}, r"no exposure with at least 2 dark frames: cover the lens"),
        ({"rates": [5e6] * 6}, r"all patches are saturated at all exposures: record shorter"),
    ],
)
def test_without_darks_or_with_saturation_everywhere_there_is_no_characterisation(tmp_path, how, message):
    with pytest.raises(CalibrationError, match=message):
        characterised(tmp_path / "s", **how)
