import numpy as np
import pytest

from labcdp.core.errors import InputError
from labcdp.core.vignetting import FlatField, RadialVignetting, middle_of


def test_polynomial_over_the_radius_relative_to_half_the_diagonal():
    # The centre of the corner pixel is (1.5, 1) pixels off the middle, half the diagonal 2.5.
    assert RadialVignetting(0, 0, 0).squared_radius((3, 4))[0, 0] == pytest.approx((1.5**2 + 1) / 2.5**2)
    v = RadialVignetting(-0.3, -0.1, 0.05, centre_px=(0.5, 0.5)).relative_illuminance((30, 40))
    r2 = (10**2 + 20**2) / 25**2
    assert v[0, 0] == 1
    assert v[10, 20] == pytest.approx(1 - 0.3 * r2 - 0.1 * r2**2 + 0.05 * r2**3)


def test_patterns_have_the_variance_of_the_covariance():
    jacobian = np.random.default_rng(1).normal(size=(3, 3)) * 0.01
    covariance = jacobian @ jacobian.T
    vignetting = RadialVignetting(-0.3, -0.1, 0.05, covariance=tuple(map(tuple, covariance)))
    patterns = vignetting.common_patterns((30, 40))
    r2, v = vignetting.squared_radius((30, 40))[3, 7], vignetting.relative_illuminance((30, 40))[3, 7]
    by_coefficient = np.array([r2, r2**2, r2**3]) / v
    assert sum(p[3, 7] ** 2 for p in patterns) == pytest.approx(by_coefficient @ covariance @ by_coefficient)


def test_flat_fields_are_equal_by_content_and_cannot_be_changed():
    values = 1 + 0.01 * np.random.default_rng(1).normal(size=(40, 60))
    values /= values[middle_of(values.shape)].mean()
    a, b = FlatField(values, 0.001, 0.01, 4), FlatField(values.copy(), 0.001, 0.01, 4)
    assert (a, hash(a)) == (b, hash(b))
    assert a != FlatField(values, 0.002, 0.01, 4)
    with pytest.raises(InputError, match=r"the middle of the flat field is 1\.1, not 1"):
        FlatField(values * 1.1, 0.001, 0.01, 4)
    values[0, 0] = 7
    assert a == b != FlatField(values, 0.001, 0.01, 4)
    with pytest.raises(ValueError, match="read-only"):
        a.relative[0, 0] = 7
