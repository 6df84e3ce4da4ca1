"""A camera with a tone curve (8 bit, gamma): its response from the session's own exposures, scaled by the meter."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from labcdp.calibration import load
from labcdp.core.errors import CalibrationError
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.reading import MeterIdentity, Reading
from labcdp.core.response import Response
from labcdp.evaluate.bench.bracket import response_of_session
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.session import Session, SessionConfiguration

START = datetime(2026, 3, 1, 12, tzinfo=UTC)
CAMERA = CameraIdentity("Allied Vision Technologies", "Manta_G-505B", "503363706")
SHAPE = (160, 208)
GAMMA, BLACK, FULL_WELL_E, READ_NOISE_E, PER_CD_S = 2.2, 0.004, 8000.0, 8.0, 0.9
SCALE_ERROR = 0.004
EXPOSURES_S = (0.0005, 0.001, 0.0017, 0.004, 0.0075, 0.016, 0.03)
LUMINANCES = np.geomspace(1.1, 420, 9)
N_FRAMES = 4
BENCH = """\
format = 1
name = "Camera with a tone curve"
operator = "test"

[camera]
vendor = "Allied Vision Technologies"
model = "Manta_G-505B"
serial = "503363706"
pixel_pitch_m = 1e-9

[lens]
model = "LM6NCL"
serial = "0117"
focal_length_m = 0.006
f_number = 2.6

[meter]
model = "LS-110"
serial = "73323007"

[source]
spectrum = "LED-B4"

[target]
name = "nine patches"

[[contrast]]
bright = "P9"
dark = "P1"
contrast = 300

[plan]
exposures_s = [0.0005]
"""


def rois():
    """Nine patches with a dark frame around each: name to (x, y, width, height)."""
    height, width = SHAPE[0] // 3, SHAPE[1] // 3
    order = np.random.default_rng(0).permutation(9)
    return {
        f"P{number + 1}": (k % 3 * width + 6, k // 3 * height + 6, width - 12, height - 12)
        for k, number in enumerate(order)
    }


def scene(luminances):
    image = np.full(SHAPE, 8.0)
    for name, (x, y, w, h) in rois().items():
        image[y - 3 : y + h + 3, x - 3 : x + w + 3] = luminances[int(name[1:]) - 1]
    return image


def tone_frames(luminance_cd_m2, exposure_s, n, seed, start=0):
    """Frames of a camera with noise, a tone curve of the power 1 / 2.2 after it, and rounding to 8 bits at last."""
    rng = np.random.default_rng(seed)
    electrons = FULL_WELL_E * PER_CD_S * luminance_cd_m2 * exposure_s
    for i in range(n):
        seen = rng.poisson(electrons) + rng.normal(0, READ_NOISE_E, SHAPE)
        dn = np.rint(255 * np.clip(BLACK + seen / FULL_WELL_E, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
        yield Frame(
            dn=dn,
            exposure_s=exposure_s,
            gain_db=0.0,
            bit_depth=8,
            saturation_dn=255.0,
            black_level_dn=20.0,
            pixel_format="Mono8",
            colour_filter=None,
            temperature_c=35.0,
            timestamp=START + timedelta(seconds=start + i),
            camera_timestamp_ns=start + i,
            frame_id=start + i,
            camera=CAMERA,
        )


def reading(luminance_cd_m2, second, rng):
    value = luminance_cd_m2 * (1 + SCALE_ERROR) * (1 + rng.normal(0, 0.001))
    return Reading(
        value=round(value, 2),
        unit="cd/m2",
        resolution=0.01,
        scale_half_width_rel=0.02,
        digits_half_width=0.01,
        repeatability_rel=0.001,
        peak=False,
        correction="preset",
        held=False,
        meter=MeterIdentity("LS-110", "73323007", "2025-03-31"),
        timestamp=START + timedelta(seconds=second),
        raw=f"OK00,CcPM{value:6.2f}",
    )


def record(path, exposures_s=EXPOSURES_S, seed=5, one_by_one=False):
    patches = "".join(
        f'\n[[target.patch]]\nname = "{name}"\nroi = {[float(v) for v in roi]}\n' for name, roi in rois().items()
    )
    text = BENCH.replace(
        'name = "nine patches"\n',
        'name = "nine patches"\n' + ('presentation = "one by one"\n' if one_by_one else "") + patches,
    )
    configuration = SessionConfiguration.from_toml(text, "bench.toml")
    rng = np.random.default_rng(seed)
    with Session.create(path, configuration) as session:
        for k, t in enumerate(exposures_s):
            if one_by_one:
                for number, name in enumerate(rois()):
                    alone = np.where(np.arange(9) == int(name[1:]) - 1, LUMINANCES, 8.0)
                    frames = tone_frames(scene(alone), t, 2, seed + 1000 * k + number, 100 * k)
                    session.add_frames([(frame, "light", name) for frame in frames])
            else:
                session.add_frames(
                    [(f, "light", None) for f in tone_frames(scene(LUMINANCES), t, N_FRAMES, seed + k, 100 * k)]
                )
            session.add_frames(
                [(f, "dark", None) for f in tone_frames(np.zeros(SHAPE), t, N_FRAMES, seed + 50 + k, 100 * k + 50)]
            )
        for number, luminance in enumerate(LUMINANCES):
            for j in range(3):
                session.add_reading(reading(luminance, 60 * number + j, rng), f"P{number + 1}")
    return path


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return record(tmp_path_factory.mktemp("tone") / "session")


@pytest.fixture(scope="module")
def session(path):
    with Session.open(path) as opened:
        yield opened


@pytest.fixture(scope="module")
def observed(session):
    return observe_session(session)


@pytest.fixture(scope="module")
def calibration(session, observed):
    return calibrate_session(observed, response=response_of_session(session, observed))


def test_the_curve_is_that_of_the_camera(session, observed):
    curve = response_of_session(session, observed)
    low, high = curve.range_net_dn
    assert low < 15
    assert high > 200
    dark = 255 * BLACK ** (1 / GAMMA)
    n = np.geomspace(low, high, 100)
    ratio = curve.response.linearise(n) / (((n + dark) / 255) ** GAMMA - BLACK)
    ratio /= np.exp(np.mean(np.log(ratio)))
    assert np.sqrt(np.mean((ratio - 1) ** 2)) < 0.015
    # Deviations from the shape lie within its stated errors: chi^2 of the worst point over 3 standard uncertainties.
    errors = curve.errors(n) - curve.errors(n).mean(axis=1, keepdims=True)
    assert (np.abs(ratio - 1) < 3 * np.sqrt((errors**2).sum(axis=0)) + 0.01).all()


def test_patches_are_right_within_the_stated_uncertainty(session, observed, calibration):
    assert calibration.response.kind == "table"
    rows = {row.region.name: row.calibrated for row in evaluate_session(session, observed, calibration).patches}
    for number, truth in enumerate(LUMINANCES, start=1):
        seen = rows[f"P{number}"]
        assert abs(seen.luminance_cd_m2 / truth - 1) < seen.half_width_95_rel
        assert abs(seen.luminance_cd_m2 / truth - 1 - SCALE_ERROR) < 0.015
        assert seen.half_width_95_rel < 0.06


def test_pixels_of_another_scene_are_right_with_their_noise(calibration):
    """A ramp over two decades, at an exposure between those of the bracket."""
    luminance = np.broadcast_to(np.geomspace(3, 200, SHAPE[1]), SHAPE)
    (frame,) = tone_frames(luminance, 0.005, 1, 99)
    seen = calibration.to_luminance(frame)
    valid = seen.valid
    assert valid.mean() > 0.8
    columns = valid.all(axis=0)
    means = seen.luminance_cd_m2[:, columns].mean(axis=0) / luminance[0, columns] - 1
    assert np.abs(means - SCALE_ERROR).max() < 0.04  # one column has 160 pixels
    z = (seen.luminance_cd_m2 / luminance - 1 - SCALE_ERROR)[valid] / seen.random_rel[valid]
    assert z.std() == pytest.approx(1, abs=0.08)


def test_a_curve_of_another_camera_contradicts_the_patches(session, observed):
    curve = response_of_session(session, observed)
    n = np.array(curve.response.net_dn[1:])
    other = Response("table", (0.0, *n.tolist()), (0.0, *(n[0] * (n / n[0]) ** 1.02).tolist()))
    with pytest.raises(CalibrationError, match="the response of the bracket contradicts the patches: check"):
        calibrate_session(observed, response=replace(curve, response=other, residual_rel=1e-4))


def test_the_command_finds_scales_and_saves_it(labcdp, path, tmp_path, calibration):
    done = labcdp("calibrate", path, "--response", "debevec", "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    saved = load(tmp_path / "out" / "calibration.json")
    assert saved.response == calibration.response
    assert saved.noise.tone == calibration.response
    done = labcdp("evaluate", path, "--calibration", tmp_path / "out" / "calibration.json", "--json")
    assert done.returncode == 0, done.stderr
    for row in json.loads(done.stdout)["tables"]["luminance"]["rows"]:
        deviation = row["calibrated_cd_m2"] - LUMINANCES[int(row["patch"][1:]) - 1]
        assert abs(deviation) < row["expanded_calibrated_cd_m2"]


@pytest.mark.parametrize("exposures_s", [(0.004,), (0.002, 0.004)])
def test_too_few_exposures_are_refused_in_one_line(labcdp, tmp_path, exposures_s):
    record(tmp_path / "session", exposures_s)
    done = labcdp("calibrate", "session", "--response", "debevec")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    there = "4 ms" if len(exposures_s) == 1 else "2 ms, 4 ms"
    assert f"({there}): the response by a bracket needs 3 or more" in done.stderr.splitlines()[-1]


def test_it_comes_first_on_the_ladder_with_a_reason(calibration):
    first, *others = calibration.ladder
    assert (first.kind, first.n_parameters, first.chosen) == ("table", 1, True)
    assert first.reason.code == "model-bracket"
    assert first.reason.values["n_exposures"] == 7
    assert not any(step.chosen for step in others)
    assert all(step.leave_one_out_rel > first.leave_one_out_rel for step in others)
