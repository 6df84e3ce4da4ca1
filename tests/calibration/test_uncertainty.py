from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import t as student

from labcdp.calibration import coverage_probability, expanded_half_width
from labcdp.calibration.uncertainty import effective_dof, expanded_uncertainty, variance_from_one_estimate

half_widths = st.floats(0.05, 10.0)


@given(a=half_widths, s=half_widths, w=half_widths)
def test_probability_is_the_mean_of_the_normal_one_over_the_rectangle(a, s, w):
    integral, _ = quad(
        lambda u: ndtr((w - u) / s) - ndtr((-w - u) / s), -a, a, points=[-min(w, a), 0.0, min(w, a)], limit=200
    )
    assert coverage_probability(w, a, s) == pytest.approx(integral / (2 * a), abs=1e-6)


@given(a=half_widths, s=half_widths)
def test_half_width_has_a_probability_of_95_percent(a, s):
    assert coverage_probability(expanded_half_width(a, s), a, s) == pytest.approx(0.95, abs=1e-9)


def test_degrees_of_freedom_of_independent_and_of_joint_variances():
    """Closed forms: two equal variances of two estimates have twice the degrees of freedom, of one estimate its own."""
    assert effective_dof([(1.0, 5.0), (1.0, 5.0)]) == pytest.approx(10)
    assert variance_from_one_estimate([(1.0, 5.0), (2.0, 5.0)]) == pytest.approx((3, 5))
    # A standard deviation of four values, with t of three degrees of freedom.
    assert expanded_uncertainty([(0.01**2, 3.0)]) == pytest.approx(0.01 * student.isf(0.025, 3), rel=1e-6)
    # The larger of two rectangular errors counts as such.
    assert expanded_uncertainty([], [0.01, 0.0]) == pytest.approx(0.95 * sqrt(3) * 0.01)
