from dataclasses import replace
from datetime import timedelta
from math import hypot, inf, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student

from labcdp.calibration.readings import combine_patches, combine_readings, expanded_of_readings

from ..conftest import make_reading


def at_times(readings):
    """Return the same readings, a second apart."""
    return [replace(r, timestamp=r.timestamp + timedelta(seconds=i)) for i, r in enumerate(readings)]


@given(n=st.integers(1, 50), value=st.floats(0.1, 9000))
def test_repeatability_averages_down_and_digits_do_not(n, value):
    reading, findings = combine_readings("grey", at_times([make_reading(value, digits_half_width=0.02)] * n))
    assert findings == []
    assert reading.luminance_cd_m2 == pytest.approx(value)
    assert reading.random_cd_m2 == pytest.approx(hypot(0.002 * value / sqrt(n), 0.02 / sqrt(3)))


def test_unsteady_light_is_reported_and_counted():
    values = [100.0, 110.0, 90.0, 105.0]
    reading, (found,) = combine_readings("grey", [make_reading(v) for v in values])
    assert (found.code, found.subject) == ("readings-scatter", "grey")
    assert reading.random_cd_m2 == pytest.approx(hypot(np.std(values, ddof=1) / 2, 0.01 / sqrt(3)))


@pytest.mark.parametrize(("bad", "why"), [(1000.0, "-decimal-point"), (29.19, "-unit"), (130.0, "")])
def test_one_bad_reading_of_three_is_named_and_makes_the_mean_uncertain(bad, why):
    values = 100.0, bad, 100.1
    reading, (found,) = combine_readings("grey", at_times([make_reading(v) for v in values]))
    assert (reading.luminance_cd_m2, reading.left_out) == (pytest.approx(np.mean(values)), ())
    assert reading.random_cd_m2 == pytest.approx(np.std(values, ddof=1) / sqrt(3), rel=1e-3)
    assert (found.code, found.subject, found.values["number"]) == (f"reading-contradicts{why}", "grey", 2)


def test_copied_rows_count_once():
    one = make_reading(100.0)
    reading, (found,) = combine_readings("grey", [one, one, *at_times([make_reading(100.1)] * 3)[1:]])
    assert found.code == "readings-repeated"
    assert (reading.n_readings, [row.reading for row in reading.left_out]) == (3, [2])


def test_own_scatter_has_its_degrees_of_freedom():
    """Student's t for three readings; the digit is known, so that Welch and Satterthwaite give a little more."""
    values = [100.0, 108.0, 93.0]
    reading, _ = combine_readings("grey", at_times([make_reading(v, digits_half_width=1e-6) for v in values]))
    assert reading.dof == pytest.approx(2, rel=1e-6)
    expected = student.isf(0.025, 2) * np.std(values, ddof=1) / sqrt(3) / np.mean(values)
    assert expanded_of_readings([reading]) == pytest.approx(expected, rel=1e-6)
    assert combine_readings("grey", at_times([make_reading(100.0)] * 3))[0].dof == inf


def noisy(rng, n_patches, n_readings, size_rel):
    """Readings of 100 cd/m^2 by a meter that states 0.2 %, by patch."""
    values = 100 * (1 + size_rel * rng.normal(size=(n_patches, n_readings)))
    return {f"P{i}": at_times([make_reading(v, digits_half_width=1e-6) for v in own]) for i, own in enumerate(values)}


@pytest.mark.parametrize(("n_patches", "n_readings"), [(8, 2), (4, 3), (8, 3)])
@pytest.mark.parametrize("size_rel", [0.002, 0.01, 0.02])
@pytest.mark.parametrize("n", [100, pytest.param(400, marks=pytest.mark.long)])
def test_intervals_of_two_and_three_readings_hold_in_95_percent(n, n_patches, n_readings, size_rel):
    rng, inside = np.random.default_rng(11), 0.0
    for _ in range(n):
        combined, _ = combine_patches(noisy(rng, n_patches, n_readings, size_rel))
        inside += np.mean([abs(r.luminance_cd_m2 / 100 - 1) <= expanded_of_readings([r]) for r in combined.values()])
    assert abs(inside / n - 0.95) <= 3 * sqrt(0.95 * 0.05 / n)


def test_a_noisy_meter_loses_no_reading_and_is_named_once():
    readings = noisy(np.random.default_rng(2), 6, 3, 0.02)
    assert any(
        combine_readings(name, own)[1][0].code.startswith("reading-contradicts") for name, own in readings.items()
    )
    combined, (found,) = combine_patches(readings)
    assert all((r.n_readings, r.left_out, r.of_all) == (3, (), True) for r in combined.values())
    assert (found.code, found.values["dof"]) == ("readings-scatter-all", 12)
    scatter = sqrt(np.mean([np.var([r.value for r in own], ddof=1) for own in readings.values()])) / 100
    assert found.values["ratio"] == pytest.approx(scatter / 0.002, rel=0.01)


def test_a_patch_that_scatters_alone_widens_no_other():
    readings = noisy(np.random.default_rng(4), 5, 2, 0.002)
    readings["P2"] = at_times([make_reading(v) for v in (100.0, 120.0)])
    combined, (found,) = combine_patches(readings)
    assert (found.code, found.subject) == ("readings-scatter", "P2")
    assert combined["P2"].dof == pytest.approx(1, rel=0.01)
    for name in readings.keys() - {"P2"}:
        assert (combined[name].dof, combined[name].random_cd_m2) == (
            inf,
            pytest.approx(0.002 * 100 / sqrt(2), rel=0.02),
        )


def test_readings_that_agree_exactly_scatter_as_stated():
    readings = {f"P{i}": at_times([make_reading(10.0 * i)] * 2) for i in range(1, 13)}
    combined, findings = combine_patches(readings)
    assert findings == []
    assert [combined[patch] for patch in readings] == [combine_readings(*item)[0] for item in readings.items()]
