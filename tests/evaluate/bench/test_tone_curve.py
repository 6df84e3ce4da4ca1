"""A camera with a tone curve (8 bit, gamma) and a lens with vignetting: both are found, and measurements are right."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.core.dn import Response
from labcdp.core.errors import CalibrationError
from labcdp.evaluate.bench.calibrate import calibrate_recorded, calibrate_session
from labcdp.evaluate.bench.corrections import UniformLight, calibration_corrections
from labcdp.evaluate.bench.observe import observe_session, session_response
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.session import Session

from .synthetic import configuration, frame, record

SHAPE = (160, 208)
GAMMA, BLACK, FULL_WELL_E, READ_NOISE_E, PER_CD_S = 2.2, 0.004, 8000.0, 8.0, 0.9
SCALE_ERROR = 0.004
EXPOSURES_S = (0.0005, 0.001, 0.0017, 0.004, 0.0075, 0.016, 0.03)
#: Nine patches with a dark frame around each.
LUMINANCES = {f"P{i + 1}": float(value) for i, value in enumerate(np.geomspace(1.1, 420, 9))}
ROIS = {name: [k % 3 * 69 + 6, k // 3 * 53 + 6, 57, 41]
        for name, k in zip(LUMINANCES, np.random.default_rng(0).permutation(9).tolist(), strict=True)}  # fmt: skip
SCENE = np.full(SHAPE, 8.0)
for _name, (_x, _y, _w, _h) in ROIS.items():
    SCENE[_y - 3 : _y + _h + 3, _x - 3 : _x + _w + 3] = LUMINANCES[_name]
Y, X = np.indices(SHAPE) + 0.5
#: Of a lens with vignetting: 1 on the axis and 0.705 in the corner.
V = 1 - 0.295 * ((X - SHAPE[1] / 2) ** 2 + (Y - SHAPE[0] / 2) ** 2) / ((SHAPE[0] ** 2 + SHAPE[1] ** 2) / 4)


def tone_frames(luminance_cd_m2, exposure_s, n, seed):
    """Frames of a camera with noise, a tone curve of the power 1 / 2.2 after it, and rounding to 8 bits at last."""
    rng = np.random.default_rng(seed)
    electrons = FULL_WELL_E * PER_CD_S * luminance_cd_m2 * exposure_s
    eight = {"bit_depth": 8, "saturation_dn": 255.0, "black_level_dn": 20.0, "pixel_format": "Mono8"}
    for i in range(n):
        seen = rng.poisson(electrons) + rng.normal(0, READ_NOISE_E, SHAPE)
        dn = np.rint(255 * np.clip(BLACK + seen / FULL_WELL_E, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
        yield frame(dn, exposure_s, 100 * seed + i, **eight)


def bench_of(path, scene=SCENE, exposures_s=EXPOSURES_S, n=4, seed=5):
    """Write a session; pixels are so small that the lens has no vignetting of its own."""
    lights = (("light", scene * V, seed), ("dark", np.zeros(SHAPE), seed + 50))
    frames = [(one, role) for k, t in enumerate(exposures_s) for role, light, first in lights
              for one in tone_frames(light, t, n, first + k)]  # fmt: skip
    bench = configuration(ROIS, contrast=[], camera={"pixel_pitch_m": 1e-9})
    return record(path, bench, frames, {name: value * (1 + SCALE_ERROR) for name, value in LUMINANCES.items()}, seed)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    with Session.open(bench_of(tmp_path_factory.mktemp("tone") / "session")) as opened:
        yield opened


@pytest.fixture(scope="module")
def uniform(tmp_path_factory):
    """Even light by which the flat field is measured."""
    path = bench_of(tmp_path_factory.mktemp("tone") / "flat", np.full(SHAPE, 60.0), (0.0075,), 30, seed=900)
    with Session.open(path) as flat:
        return UniformLight.read(flat, 0.005)


@pytest.fixture(scope="module")
def calibration(session, uniform):
    return calibrate_recorded([session], uniform, bracket=True)[1]


@pytest.fixture(scope="module")
def observed(session, calibration):
    return observe_session(session, corrections=calibration_corrections(calibration))


@pytest.fixture(scope="module")
def curve(session, observed):
    return session_response(observed)


def test_the_curve_is_that_of_the_camera(curve, calibration):
    low, high = curve.range_net_dn
    assert low < 15 < 200 < high
    n = np.geomspace(low, high, 100)
    ratio = curve.response.linearise(n) / (((n + 255 * BLACK ** (1 / GAMMA)) / 255) ** GAMMA - BLACK)
    ratio /= np.exp(np.mean(np.log(ratio)))
    assert np.sqrt(np.mean((ratio - 1) ** 2)) < 0.015
    assert calibration.response.kind == "table"
    assert calibration.noise.tone == calibration.response


def test_patches_and_pixels_of_another_scene_are_right_with_their_noise(session, observed, calibration):
    """A ramp over two decades, at an exposure between those of the bracket."""
    luminance = np.broadcast_to(np.geomspace(3, 200, SHAPE[1]), SHAPE)
    (one,) = tone_frames(luminance * V, 0.005, 1, 99)
    seen = calibration.to_luminance(one)
    assert seen.valid.mean() > 0.8
    columns = seen.valid.all(axis=0)
    means = seen.luminance_cd_m2[:, columns].mean(axis=0) / luminance[0, columns] - 1
    assert np.abs(means - SCALE_ERROR).max() < 0.04  # one column has 160 pixels
    for row in evaluate_session(observed, calibration).patches:
        off = row.calibrated.luminance_cd_m2 / LUMINANCES[row.region.name] - 1
        assert abs(off) < row.calibrated.U_rel < 0.06
    z = ((seen.luminance_cd_m2 / luminance - 1 - SCALE_ERROR) / seen.random_rel)[seen.valid]
    assert z.std() == pytest.approx(1, abs=0.08)


def test_the_flat_field_is_linearised_by_the_curve(uniform, calibration):
    """By the values of a camera with gamma the corner would have 0.85 of the light."""
    dn = np.arange(60.0, 230.0)
    # The dark signal is that of the curve at 0.
    net, light = dn - 255 * BLACK ** (1 / GAMMA), 1e4 * ((dn / 255) ** GAMMA - BLACK)
    linearised = uniform.linearised({None: Response("table", (0.0, *net.tolist()), (0.0, *light.tolist()))})
    vignettings = uniform.corrections[None].vignetting, linearised[None], calibration.vignetting
    raw, by_truth, by_bracket = (one.relative_illuminance(SHAPE)[:5, :5].mean() for one in vignettings)
    truth = V[:5, :5].mean()
    assert raw > 1.13 * truth
    assert by_truth == pytest.approx(truth, abs=0.003)
    assert by_bracket == pytest.approx(truth, abs=0.01)


def test_a_curve_that_contradicts_the_patches_is_refused(curve, observed):
    n = np.array(curve.response.net_dn[1:])
    other = Response("table", (0.0, *n.tolist()), (0.0, *(n[0] * (n / n[0]) ** 1.02).tolist()))
    with pytest.raises(CalibrationError, match="the response of the bracket contradicts the patches: check"):
        calibrate_session(observed, response=replace(curve, response=other, residual_rel=1e-4))
