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
    value=100.0, unit="cd/m2", resolution=0.1, scale_half_width_rel=0.02, digits_half_width=0.1,
    repeatability_rel=0.002, peak=False, correction="preset", held=True, meter=MeterIdentity("LS-110", "73323007"),
    timestamp=datetime(2026, 3, 2, 12, tzinfo=UTC), raw="OK00,CcPH 100.0",
)  # fmt: skip


def series(*values):
    return ReadingSeries(tuple(replace(READING, value=value) for value in values))


@given(st.lists(st.floats(0.01, 1e6), min_size=2, max_size=30))
def test_mean_and_scatter_agree_with_numpy(values):
    one = series(*values)
    assert one.mean_cd_m2 == pytest.approx(np.mean(values))
    assert one.scatter_cd_m2 == pytest.approx(np.std(values, ddof=1), abs=1e-9 * max(values))
    assert one.scatter_rel == pytest.approx(one.scatter_cd_m2 / one.mean_cd_m2)


@pytest.mark.parametrize(
    ("values", "u_cd_m2"),
    [
        # Readings that scatter set the uncertainty themselves; those that agree keep that of the data sheet.
        ((90, 100, 110), 10 / sqrt(3)),
        ((100, 100, 100, 100), hypot(0.2 / sqrt(4), 0.1 / sqrt(3))),
    ],
)
def test_the_random_uncertainty_is_that_of_scatter_or_data_sheet(values, u_cd_m2):
    assert series(*values).standard_uncertainty_random_cd_m2 == pytest.approx(u_cd_m2)


def test_the_scale_is_common_and_does_not_average_down():
    readings = (READING, replace(READING, scale_half_width_rel=0.03))
    assert ReadingSeries(readings).standard_uncertainty_common_rel == pytest.approx(0.03 / sqrt(3))


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"unit": "fL", "raw": "OK00,CfPH 29.18"}, r"'OK00,CcPH 100.0' and 'OK00,CfPH 29.18' are in cd/m2 and fL"),
        ({"correction": "colour"}, r"have the corrections .* and 'colour': leave the meter's correction alone"),
        ({"unit": "%"}, r"ratio in %, not a luminance: set the meter to ABS"),
        ({"meter": MeterIdentity("LS-100", "1")}, r"meters LS-110 73323007 and LS-100 1: average the readings of one"),
    ],
)
def test_what_has_no_mean_is_refused(other, message):
    with pytest.raises(InputError, match=message):
        ReadingSeries((READING, replace(READING, **other)))
