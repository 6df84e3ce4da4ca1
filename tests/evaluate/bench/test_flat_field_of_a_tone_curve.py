"""Flat field of a camera with gamma 2.2: linearised by the response, which the same session's bracket shows."""

import numpy as np
import pytest

from labcdp.core.response import Response
from labcdp.evaluate.bench.flat import UniformLight
from labcdp.evaluate.bench.recorded_calibration import calibrate_recorded
from labcdp.session import Session, SessionConfiguration

from .test_tone_curve import BENCH, BLACK, EXPOSURES_S, GAMMA, LUMINANCES, SHAPE, reading, rois, scene, tone_frames

Y, X = np.indices(SHAPE) + 0.5
#: 1 on the axis and 0.705 in the corner.
V = 1 - 0.295 * ((X - SHAPE[1] / 2) ** 2 + (Y - SHAPE[0] / 2) ** 2) / ((SHAPE[0] ** 2 + SHAPE[1] ** 2) / 4)


def record(path, image, exposures_s, seed, n=4, readings=False):
    patches = "".join(f'\n[[target.patch]]\nname = "{k}"\nroi = {[float(v) for v in r]}\n' for k, r in rois().items())
    text = BENCH.replace('name = "nine patches"\n', 'name = "nine patches"\n' + patches)
    rng = np.random.default_rng(seed)
    with Session.create(path, SessionConfiguration.from_toml(text, "bench.toml")) as session:
        for k, t in enumerate(exposures_s):
            for role, light in (("light", image * V), ("dark", np.zeros(SHAPE))):
                start = 200 * k + (100 if role == "dark" else 0)
                session.add_frames([(f, role, None) for f in tone_frames(light, t, n, seed + start, start)])
        for number, luminance in enumerate(LUMINANCES if readings else ()):
            for j in range(3):
                session.add_reading(reading(luminance, 60 * number + j, rng), f"P{number + 1}")
    return path


@pytest.fixture(scope="module")
def uniform(tmp_path_factory):
    path = record(tmp_path_factory.mktemp("uniform") / "flat", np.full(SHAPE, 60.0), (0.0075,), 900, n=30)
    with Session.open(path) as flat:
        yield UniformLight.read(flat, 0.005)


def corner(vignetting):
    v = vignetting.relative_illuminance(SHAPE)
    return v[:5, :5].mean() / V[:5, :5].mean() * 0.705


def test_with_the_true_response_the_flat_field_is_the_truth(uniform):
    dn = np.arange(60.0, 230.0)
    # The dark signal is that of the curve at 0.
    zero = 255 * BLACK ** (1 / GAMMA)
    light = (dn / 255) ** GAMMA - BLACK
    response = Response("table", (0.0, *(dn - zero).tolist()), (0.0, *(1e4 * light).tolist()))
    linearised = uniform.linearised({None: response})[None]
    assert corner(uniform.corrections[None].vignetting) > 0.8
    assert corner(linearised) == pytest.approx(0.705, abs=0.003)


def test_calibration_and_flat_field_agree_with_the_truth(uniform, tmp_path):
    with Session.open(record(tmp_path / "session", scene(LUMINANCES), EXPOSURES_S, 5, readings=True)) as session:
        calibration, _ = calibrate_recorded([session], uniform, bracket=True)
        (frame,) = tone_frames(scene(LUMINANCES) * V, 0.004, 1, 77)
        seen = calibration.to_luminance(frame).luminance_cd_m2
    assert corner(calibration.vignetting) == pytest.approx(0.705, abs=0.01)
    for name, (x, y, w, h) in rois().items():
        truth = LUMINANCES[int(name[1:]) - 1]
        if 4 < truth < 200:
            assert seen[y : y + h, x : x + w].mean(dtype=float) == pytest.approx(truth, rel=0.02)
