"""The budget: split out of what intervals are made of, complete, and nothing hidden."""

from dataclasses import replace
from datetime import timedelta
from math import hypot, sqrt

import pytest

from labcdp.calibration import fit, patch_luminance
from labcdp.calibration.budget import SOURCES, budget, budget_exposure_s, combined
from labcdp.calibration.converter import common_errors

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
    whole = combined(budget(calibration, luminance, exposure_s, *SIZE))
    # The budget takes K from photon transfer and the luminance as given; both within a part in a thousand.
    assert whole.standard_uncertainty_rel == pytest.approx(hypot(patch.random_rel, patch.common_rel), rel=2e-3)
    assert whole.expanded_95_rel == pytest.approx(patch.half_width_95_rel, rel=2e-3)


def test_rows_make_the_common_errors(calibration):
    net_dn = calibration.net_dn(8.0, 0.01)
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
