"""Sessions of parts of the sensor, evaluated with the calibration of a session of another part."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from labcdp.chain import Sensor
from labcdp.core.errors import CalibrationError
from labcdp.core.frame import Readout
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.corrections import calibration_for, corrections_of, require_same_optics
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.evaluate.bench.verification import verify_session
from labcdp.session import Session

from .synthetic import configuration, exposed, record

SIZE, PART = (120, 160), (slice(10, 70), slice(20, 100))
LUMINANCES = {"A": 20.0, "B": 60.0, "C": 110.0, "D": 200.0}
CORNERS = {"A": (24, 14), "B": (70, 20), "C": (30, 45), "D": (80, 50)}
EXPOSURES_S = (0.004, 0.008)


def _frames(window, readout, seed):
    """Light and dark frames of a window of the whole scene, with a natural vignetting down to a third."""
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    r2 = ((x - 79.5) ** 2 + (y - 59.5) ** 2) * (4e-6 / 0.0005) ** 2
    scene = np.full(SIZE, 5.0)
    for name, (left, top) in CORNERS.items():
        scene[top : top + 16, left : left + 16] = LUMINANCES[name]
    light = (scene * (1 + r2) ** -2)[window]
    sensor = Sensor(
        pixel_pitch_m=4e-6, width=light.shape[1], height=light.shape[0], quantum_efficiency=0.5, full_well_e=1e6,
        k_dn_per_e=0.25, read_noise_e=6.0, dark_current_e_s=0.0, bits=12, black_level_dn=64.0, prnu_rel=0.0, dsnu_e=0.0,
        dsnu_e_s=0.0, device_seed=1,
    )  # fmt: skip
    for one, role in exposed(sensor, 6000 * light, EXPOSURES_S, 6, first=100 * seed, readout=readout):
        yield replace(one, timestamp=one.timestamp + timedelta(hours=seed)), role


def _session(path, window=(slice(0, SIZE[0]), slice(0, SIZE[1])), readout=None, seed=1):
    top, left = window[0].start, window[1].start
    rois = {name: (x - left, y - top, 16, 16) for name, (x, y) in CORNERS.items()}
    lens = {"model": "Prime", "serial": "7", "focal_length_m": 0.0005, "f_number": 2.8}
    plan = configuration(rois, lens=lens)
    return Session.open(record(path, plan, _frames(window, readout, seed), LUMINANCES, seed, 3600 * seed))


def _evaluated(session, calibration):
    own = calibration_for(session, calibration)
    return evaluate_session(session, observe_session(session, corrections=corrections_of(own)), own, [])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return _session(tmp_path_factory.mktemp("whole") / "s", readout=Readout(sensor_size=(160, 120)))


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    return _session(tmp_path_factory.mktemp("part") / "s", PART, Readout(20, 10, sensor_size=(160, 120)), seed=2)


def test_calibration_of_the_whole_sensor_measures_a_part_of_it(whole, part):
    calibration = calibrate_session(observe_session(whole))
    for session in (part, whole):
        rows = {row.region.name: row.calibrated.luminance_cd_m2 for row in _evaluated(session, calibration).patches}
        assert rows == pytest.approx(LUMINANCES, rel=0.005)
    verification, _ = verify_session(part, calibration)
    assert verification.verdict == "conform"


def test_another_part_of_the_same_size_is_refused(part, tmp_path):
    calibration = calibrate_session(observe_session(part))
    # Its axis is beside its middle.
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1500, rel=0.005)
    corner = _session(tmp_path / "corner", PART, Readout(0, 0, sensor_size=(160, 120)), seed=3)
    message = "region of the sensor of the calibration is from column 20 and row 10, .* has from column 0 and row 0"
    with pytest.raises(CalibrationError, match=message):
        _evaluated(corner, calibration)
    with pytest.raises(CalibrationError, match=message):
        verify_session(corner, calibration)
    with pytest.raises(CalibrationError, match="the region of the sensor of the flat field's session is from column 0"):
        require_same_optics(part, corner)
