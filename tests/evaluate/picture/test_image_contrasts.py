from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.cli.values import parse_pair
from labcdp.core.errors import InputError
from labcdp.evaluate.contrasts import parse_contrasts


@given(st.decimals("0.01", "9999", places=2), st.integers(1, 200), st.integers(1, 50), st.integers(1, 60))
def test_contrasts_are_the_floats_nearest_to_what_was_typed_and_each_once(percent, start, step, n):
    spaced = [Fraction(start + k * step, 100) for k in range(n + 1)]
    typed = [f" {percent} %,{start}%", f"{start}%:{start + n * step}%:{n + 1}"]
    assert parse_contrasts(typed) == tuple(map(float, sorted({Fraction(percent) / 100, *spaced})))
    assert parse_contrasts(["10%:1000%:3:log"]) == pytest.approx((0.1, 1.0, 10.0), rel=1e-15)


def test_pairs_are_two_names_that_may_hold_colons():
    assert parse_pair("a:b:c", ["a:b", "c", "b"]) == ("a:b", "c")
    for text, message in (("a", "by a colon"), ("a:x", "no 'x'"), ("a:a", "two different")):
        with pytest.raises(InputError, match=message):
            parse_pair(text, ["a", "b"])
