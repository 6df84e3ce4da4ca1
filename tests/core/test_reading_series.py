"""The mean of readings, its scatter and its uncertainty."""

from math import hypot, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.reading import MeterIdentity, ReadingSeries


@pytest.fixture(scope="session")
def series(new_reading):
    own = {"repeatability_rel": 0.002, "digits_half_width": 0.1, "scale_half_width_rel": 0.02}
    return lambda *values, **last: ReadingSeries(
        tuple(new_reading(value, **own | (last if n == len(values) else {})) for n, value in enumerate(values, start=1))
    )


@given(st.lists(st.floats(0.01, 1e6), min_size=2, max_size=30))
def test_mean_and_scatter_agree_with_numpy(series, values):
    one = series(*values)
    assert one.mean_cd_m2 == pytest.approx(np.mean(values))
    assert one.scatter_cd_m2 == pytest.approx(np.std(values, ddof=1), abs=1e-9 * max(values))


def test_the_random_uncertainty_is_that_of_scatter_or_data_sheet_and_the_scale_is_common(series):
    # Readings that scatter set the uncertainty themselves; those that agree keep that of the data sheet.
    assert series(90, 100, 110).standard_uncertainty_random_cd_m2 == pytest.approx(10 / sqrt(3))
    agreeing = series(*[100] * 4).standard_uncertainty_random_cd_m2
    assert agreeing == pytest.approx(hypot(0.2 / sqrt(4), 0.1 / sqrt(3)))
    # It does not average down.
    assert series(100, 100, scale_half_width_rel=0.03).standard_uncertainty_common_rel == pytest.approx(0.03 / sqrt(3))


@pytest.mark.parametrize(
    "other", [{"unit": "fL"}, {"correction": "colour"}, {"unit": "%"}, {"meter": MeterIdentity("LS-100", "1")}]
)
def test_what_has_no_mean_is_refused(series, other):
    with pytest.raises(InputError, match=r"cd/m2 and fL|corrections|ratio in %|meters LS-110"):
        series(100.0, 100.0, **other)
