import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.evaluate.sweep.plan import Axis, parse_axis


@given(
    start=st.floats(1e-6, 1e6),
    ratio=st.floats(1.01, 1e6),
    count=st.integers(2, 50),
    logarithmic=st.booleans(),
)
def test_spaced_axes_have_their_count_and_ends(start, ratio, count, logarithmic):
    text = f"a.b={start!r}:{start * ratio!r}:{count}" + (":log" if logarithmic else "")
    values = parse_axis(text).values
    assert len(values) == count
    assert math.isclose(values[0], start, rel_tol=1e-12)
    assert math.isclose(values[-1], start * ratio, rel_tol=1e-12)


@pytest.mark.parametrize("text", ["", "a.b", "a.b=", "=1,2", "a.b=1:2", "a.b=1:2:3:4", "a.b=1:x:3", "a.b=1:2:3:lin"])
def test_what_is_not_an_axis_is_refused(text):
    with pytest.raises(InputError, match=r"is no axis: give NAME=a,b,c or NAME=start:stop:count"):
        parse_axis(text)


@pytest.mark.parametrize("text", ["a.b=1:1:5", "a.b=1:2:1", "a.b=1:2:2.5", "a.b=1:inf:5", "a.b=nan:2:5", "a.b=1:2:1e9"])
def test_ends_and_count_are_checked(text):
    with pytest.raises(InputError, match=r"give two different finite ends and a whole count of 2 to 100000"):
        parse_axis(text)


@pytest.mark.parametrize("values", [np.array([1, 2]), [np.int64(1), 2], (1, 2)])
def test_axis_takes_arrays_and_lists(values):
    assert Axis("sensor.bits", values).values == (1, 2)
    assert [type(one) for one in Axis("sensor.bits", values).values] == [int, int]
