"""EMVA 1288 General: closed forms of curves that are not linear, and a series camera with its hand-overs."""

from math import log10, sqrt

import numpy as np
import pytest

from labcdp.calibration.emva.general import general_model, local_slopes
from labcdp.core.errors import CalibrationError
from labcdp.evaluate.camera.characterise import characterise_camera, characterise_session
from labcdp.evaluate.camera.general import general_files, general_result

from ...calibration.test_series_camera import imported
from ...series_camera import BLACK_DN, HAND_OVER_DN, K_DN_PER_E, RATIOS, READ_DN, SeriesCamera


def model_of(curve, noise, stimulus):
    return general_model(
        [("", 0.01, x, float(curve(x)), float(noise(x)) ** 2, 10_000) for x in stimulus], float(noise(0)), "lx s", True
    )


def test_noise_at_the_input_is_that_at_the_output_over_the_slope():
    stimulus = np.geomspace(1, 1e4, 60)
    # A logarithmic camera: y = 500 ln(1 + x), y' = 500 / (1 + x).
    model = model_of(lambda x: 500 * np.log1p(x), lambda x: 2 + 0 * x, stimulus)
    for point in model.points[8:-8]:
        slope = 500 / (1 + point.stimulus)
        assert point.slope == pytest.approx(slope, rel=0.02)
        assert point.noise_stimulus == pytest.approx(2 / slope, rel=0.02)
        assert point.snr == pytest.approx(point.stimulus * slope / 2, rel=0.02)


def test_of_a_linear_camera_it_is_the_linear_model():
    k, read, r = 0.25, 2.0, 40.0
    noise = lambda x: np.sqrt(k * r * x + read**2)  # noqa: E731
    model = model_of(lambda x: r * x, noise, np.geomspace(0.5, 1e4, 40))
    for point in model.points:
        assert point.snr == pytest.approx(r * point.stimulus / noise(point.stimulus), rel=1e-9)
    # x = s(x) / r: r^2 x^2 - k r x - read^2 = 0.
    threshold = (k * r + sqrt((k * r) ** 2 + 4 * (r * read) ** 2)) / (2 * r**2)
    assert model.threshold == pytest.approx(threshold, rel=1e-6)
    assert model.dynamic_range == pytest.approx(1e4 / threshold, rel=1e-6)
    assert model.dips == ()


def test_slopes_of_noisy_points_have_the_error_of_their_noise():
    rng, x = np.random.default_rng(1), np.geomspace(1, 1e3, 40)
    slopes = np.array([local_slopes(x, 7 * x * rng.normal(1, 0.01, x.size)) for _ in range(200)])
    assert slopes.mean(axis=0) == pytest.approx(7, rel=4 * 0.05 / sqrt(200))
    assert slopes.std(axis=0)[5:-5].max() < 0.02 * 7


def test_too_little_is_refused():
    with pytest.raises(CalibrationError, match="2 points are above the dark signal, a characteristic curve needs 3"):
        model_of(lambda x: x, lambda x: 1 + x, [1.0, 2.0])


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    camera = SeriesCamera(luminances_cd_m2=tuple(np.geomspace(0.3, 3000, 24).tolist()))
    return imported(tmp_path_factory.mktemp("general"), camera)


def noise_dn(net_dn):
    """Noise of the capture that counts at a signal, with the step of its codes."""
    ratio = next(r for r in RATIOS if net_dn / r < HAND_OVER_DN - BLACK_DN)
    value = net_dn + BLACK_DN
    step = 1 if value < 2048 else 64 if value < 65536 else 1024
    return sqrt(ratio * K_DN_PER_E * net_dn + ratio**2 * (READ_DN**2 + 1 / 12) + step**2 / 12)


def test_a_series_camera_has_its_curve_and_dips_and_neither_k_nor_full_well(session):
    found = characterise_camera(session)
    model, per_stimulus = found.model, SeriesCamera().dn_s_cd_m2
    edges = [ratio * (HAND_OVER_DN - BLACK_DN) for ratio in RATIOS] + [2048 - BLACK_DN, 65536 - BLACK_DN]
    compared = 0
    for point in model.points:
        net = per_stimulus * point.stimulus
        # Where a patch lies on an edge, some of its pixels are on either side; below a step noise is not normal.
        if all(abs(net / edge - 1) > 0.1 for edge in edges) and noise_dn(net) > 0.6 * (64 if 2048 < net < 4000 else 1):
            # Slopes of the darkest points have the noise of their means.
            assert point.snr == pytest.approx(net / noise_dn(net), rel=0.06 if net > 20 else 0.15)
            compared += 1
    assert compared > 40
    falls = {round(per_stimulus * dip.stimulus) for dip in model.dips}
    for edge in edges[:2]:
        assert any(0.7 * edge < fall <= edge for fall in falls)
    # Dark noise of the first capture, and the slope of all: the stimulus at which the SNR is 1.
    a = K_DN_PER_E / per_stimulus
    dark_dn2 = READ_DN**2 + 1 / 12
    threshold = a / 2 + sqrt(a**2 / 4 + dark_dn2 / per_stimulus**2)
    assert model.threshold == pytest.approx(threshold, rel=0.05)
    result = general_result(found)
    rows = {row["key"]: row for row in result.table("characterisation").rows()}
    assert not {"k_dn_per_e", "full_well_e"} & rows.keys()
    assert rows["general_dynamic_range_db"]["value"] == pytest.approx(20 * log10(model.dynamic_range))
    assert {"snr-dip"} <= {finding.code for finding in found.findings}
    assert {"results.json", "report.html"} <= general_files(found, result).keys()


def test_linear_has_general_beside_it(recorded):
    found = characterise_session(recorded)
    rows = {point.label: point for point in found.general.points}
    for point in found.series:
        if point.label in rows and rows[point.label].exposure_s == point.exposure_s:
            assert rows[point.label].net_dn == point.net_dn
    best = max(found.general.points, key=lambda point: point.snr)
    # The full well's shot noise, by the linear model.
    assert best.snr == pytest.approx(sqrt(best.net_dn / found.k_dn_per_e.value), rel=0.1)
    assert found.general.dips == ()
