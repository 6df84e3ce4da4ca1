from dataclasses import replace
from datetime import timedelta
from math import hypot, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.calibration.readings import combine_readings

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
def test_one_bad_reading_of_three_is_named_and_left_out(bad, why):
    reading, (found,) = combine_readings("grey", at_times([make_reading(v) for v in (100.0, bad, 100.1)]))
    assert reading.luminance_cd_m2 == pytest.approx(100.05)
    assert [(row.patch, row.reading) for row in reading.left_out] == [("grey", 2)]
    assert (found.code, found.subject, found.values["number"]) == (f"reading-contradicts{why}", "grey", 2)


def test_copied_rows_count_once():
    one = make_reading(100.0)
    reading, (found,) = combine_readings("grey", [one, one, *at_times([make_reading(100.1)] * 3)[1:]])
    assert found.code == "readings-repeated"
    assert (reading.n_readings, [row.reading for row in reading.left_out]) == (3, [2])
