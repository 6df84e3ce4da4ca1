"""The mean of readings, its scatter and its uncertainty."""

from dataclasses import replace
from datetime import UTC, datetime
from math import hypot, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.reading import MeterIdentity, Reading, ReadingSeries

READING = Reading(
    value=100.0,
    unit="cd/m2",
    resolution=0.1,
    scale_half_width_rel=0.02,
    digits_half_width=0.1,
    repeatability_rel=0.002,
    peak=False,
    correction="preset",
    held=True,
    meter=MeterIdentity("LS-110", "73323007"),
    timestamp=datetime(2026, 3, 2, 12, tzinfo=UTC),
    raw="OK00,CcPH 100.0",
)


def series(*values, **changes):
    return ReadingSeries(tuple(replace(READING, value=value, **changes) for value in values))


def test_mean_and_scatter_of_a_known_sample():
    # Sum 40, squares of the differences to 5 sum to 32: NIST's textbook sample of 8.
    one = series(2, 4, 4, 4, 5, 5, 7, 9)
    assert one.mean_cd_m2 == 5
    assert one.scatter_cd_m2 == pytest.approx(sqrt(32 / 7))
    assert one.scatter_rel == pytest.approx(sqrt(32 / 7) / 5)


def test_readings_that_scatter_set_the_uncertainty_themselves():
    one = series(90, 100, 110)
    assert one.standard_uncertainty_random_cd_m2 == pytest.approx(10 / sqrt(3))


def test_readings_that_agree_keep_the_uncertainty_of_the_data_sheet():
    one = series(100, 100, 100, 100)
    assert one.scatter_cd_m2 == 0
    assert one.standard_uncertainty_random_cd_m2 == pytest.approx(hypot(0.2 / sqrt(4), 0.1 / sqrt(3)))


def test_the_scale_is_common_and_does_not_average_down():
    readings = (READING, replace(READING, scale_half_width_rel=0.03))
    assert ReadingSeries(readings).standard_uncertainty_common_rel == pytest.approx(0.03 / sqrt(3))


@given(st.lists(st.floats(0.01, 1e6), min_size=2, max_size=30))
def test_mean_and_scatter_agree_with_numpy(values):
    one = series(*values)
    assert one.mean_cd_m2 == pytest.approx(np.mean(values))
    assert one.scatter_cd_m2 == pytest.approx(np.std(values, ddof=1), abs=1e-9 * max(values))


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (
            {"unit": "fL", "raw": "OK00,CfPH 29.18"},
            r"'OK00,CcPH 100.0' and 'OK00,CfPH 29.18' are in cd/m2 and fL: leave",
        ),
        ({"correction": "colour"}, r"have the corrections .* and 'colour': leave the meter's correction alone"),
        ({"unit": "%"}, r"ratio in %, not a luminance: set the meter to ABS"),
        ({"meter": MeterIdentity("LS-100", "1")}, r"meters LS-110 73323007 and LS-100 1: average the readings of one"),
    ],
)
def test_what_has_no_mean_is_refused(other, message):
    with pytest.raises(InputError, match=message):
        ReadingSeries((READING, replace(READING, **other)))
