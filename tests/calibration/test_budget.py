"""The budget: split out of what intervals are made of, complete, and nothing hidden."""

from dataclasses import replace
from datetime import timedelta
from math import hypot, inf, sqrt

import pytest

from labcdp.calibration import common_errors, fit, patch_luminance
from labcdp.calibration.budget import SOURCES, budget, budget_exposure_s, combined, net_dn_at
from labcdp.calibration.findings import BudgetRow
from labcdp.errors import InputError
from labcdp.response import Response
from labcdp.vignetting import RadialVignetting

LUMINANCES = (0.5, 1.0, 2.5, 6.0, 15.0, 40.0, 100.0, 250.0)
EXPOSURES = (0.002, 0.01, 0.1)
SIZE = (400, 4)


def at_second(reading, second):
    """Tell readings of one value from a reading that is there twice."""
    return replace(reading, timestamp=reading.timestamp + timedelta(seconds=second))


@pytest.fixture(scope="module")
def calibration(camera, meter_class, setup):
    import numpy as np

    rng, meter = np.random.default_rng(5), meter_class()
    return fit(
        [camera.observe(f"P{i}", v, t, rng, SIZE) for i, v in enumerate(LUMINANCES) for t in EXPOSURES],
        [camera.dark(t, rng) for t in EXPOSURES],
        {f"P{i}": [at_second(meter.read(v, rng), second) for second in range(3)] for i, v in enumerate(LUMINANCES)},
        setup,
    )


def row(rows, source):
    return next(r for r in rows if r.source == source)


@pytest.mark.parametrize("luminance", [0.7, 8.0, 200.0])
def test_rows_make_the_uncertainty_of_a_patch(calibration, camera, luminance):
    exposure_s = budget_exposure_s(calibration, luminance)
    patch = patch_luminance(calibration, [camera.observe("P", luminance, exposure_s, None, SIZE)])
    whole = combined(budget(calibration, luminance, exposure_s, *SIZE), len(LUMINANCES))
    # The budget takes K from photon transfer and the luminance as given; both within a part in a thousand.
    assert whole.standard_uncertainty_rel == pytest.approx(hypot(patch.random_rel, patch.common_rel), rel=2e-3)
    assert whole.expanded_95_rel == pytest.approx(patch.half_width_95_rel, rel=2e-3)


def test_rows_make_the_common_errors(calibration):
    net_dn = net_dn_at(calibration, 8.0, 0.01)
    squares = {}
    for error in common_errors(calibration, net_dn, 0.01):
        squares[error.source] = squares.get(error.source, 0.0) + float(error.relative) ** 2
    rows = budget(calibration, 8.0, 0.01)
    assert row(rows, "dark and temperature").standard_uncertainty_rel == pytest.approx(
        sqrt(squares["dark and temperature"])
    )
    parts = [row(rows, source).standard_uncertainty_rel for source in ("fit", "meter repeatability")]
    assert hypot(*parts) == pytest.approx(sqrt(squares["fit"]))
    assert row(rows, "meter scale").standard_uncertainty_rel == pytest.approx(0.02 / sqrt(3))
    assert row(rows, "meter scale").distribution == "rectangular"


def test_every_source_has_a_row_and_what_is_not_known_says_why(calibration):
    rows = budget(calibration, 8.0)
    assert [r.source for r in rows] == list(SOURCES)
    for r in rows:
        assert r.basis
        if not r.included and r.source not in ("glare", "flat field"):
            assert r.standard_uncertainty_rel == 0
    assert row(rows, "meter f1'").basis == "not stated for the LS-110"
    assert not row(rows, "glare").included
    assert row(rows, "glare").standard_uncertainty_rel > 0
    assert "depends on the scene" in row(rows, "glare").basis


def test_noise_averages_over_pixels_and_frames(calibration):
    one, many = (row(budget(calibration, 8.0, 0.01, *size), "shot and read noise") for size in ((1, 1), (400, 4)))
    assert one.standard_uncertainty_rel == pytest.approx(40 * many.standard_uncertainty_rel)
    assert "one pixel of one frame at 0.01 s" in one.basis
    net_dn = 1200 * 8.0 * 0.01
    assert one.standard_uncertainty_rel == pytest.approx(sqrt(0.25 * net_dn + 1.5**2) / net_dn, rel=0.02)


def test_noise_of_a_bent_response_is_stretched(calibration):
    top = calibration.range_net_dn[1]
    bent = replace(calibration, response=Response("quadratic", (0.0, top), (0.0, 1.2 * top)))
    n = net_dn_at(bent, 8.0, 0.1)
    r = bent.responsivity.responsivity_dn_s_cd_m2
    assert float(bent.response.linearise(n)) == pytest.approx(r * 0.1 * 8.0)
    found = row(budget(bent, 8.0, 0.1), "shot and read noise").standard_uncertainty_rel
    step = 1e-3 * n
    luminance = [float(bent.response.linearise(v)) / (r * 0.1) for v in (n - step, n + step)]
    stretch = (luminance[1] - luminance[0]) / (2 * step) / 8.0
    assert found == pytest.approx(stretch * sqrt(bent.noise.variance_dn2(n)), rel=1e-4)
    assert "contained in fit" in row(budget(bent, 8.0, 0.1), "linearity").basis


def test_a_measured_fall_off_tells_what_it_is_worth(calibration):
    radial = replace(calibration, vignetting=RadialVignetting(-0.2, 0.0, 0.0, slow_rel=0.004))
    found = row(budget(radial, 8.0), "flat field")
    assert found.standard_uncertainty_rel == 0.004
    assert not found.included


def test_the_exposure_leaves_headroom(calibration):
    assert budget_exposure_s(calibration, 0.5) == 0.1
    assert budget_exposure_s(calibration, 250.0) == 0.01
    # 1200 * 250 * 0.01 + 64 is below 80 % of 4095, at 0.1 s it is far above; nothing fits 1e6 cd/m^2.
    assert budget_exposure_s(calibration, 1e6) == 0.002


def test_combination_by_hand():
    rows = [
        BudgetRow("meter scale", 0.012, "rectangular", True, "B", ""),
        BudgetRow("fit", 0.004, "normal", True, "A", ""),
        BudgetRow("patch uniformity", 0.003, "normal", False, "A", ""),
        BudgetRow("glare", 0.5, "normal", True, "A", "", included=False),
    ]
    whole = combined(rows, 9)
    assert whole.standard_uncertainty_rel == pytest.approx(0.013)
    # Welch-Satterthwaite with eight degrees of freedom of one row.
    assert whole.effective_degrees_of_freedom == pytest.approx(0.013**4 / (0.003**4 / 8))
    assert combined(rows[:2], 9).effective_degrees_of_freedom == inf
    # A rectangular part of 0.012 sqrt 3 and a normal one of 0.005: less than 1.96 times the combined one.
    assert 0.022 < whole.expanded_95_rel < 1.96 * 0.013


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0.0,), "luminance_cd_m2 is 0.0: give a positive number"),
        ((float("nan"),), "luminance_cd_m2 is nan"),
        ((1.0, -1.0), "exposure_s is -1.0: give a positive number of seconds"),
        ((1.0, 0.01, 0), "n_pixels is 0: give a positive number"),
    ],
)
def test_refusals(calibration, arguments, words):
    with pytest.raises(InputError, match=words):
        budget(calibration, *arguments)
