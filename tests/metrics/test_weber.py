import numpy as np
import pytest

from labcdp.metrics import weber_contrast, weber_contrast_of_means


def test_weber_contrast_is_the_ratio_less_one():
    assert weber_contrast([110, 1100, 100], 100).tolist() == pytest.approx([0.1, 10, 0])
    # Patches of the thesis' experiment: 412 against 33.6 cd/m^2.
    assert float(weber_contrast(412, 33.6)) == pytest.approx(11.2619, abs=5e-5)


def test_weber_contrast_without_light_in_the_dark_is_unbounded_or_undefined():
    assert weber_contrast([5, 5, 0, -1], [0, -1, 0, -2]).tolist() == pytest.approx(
        [np.inf, np.inf, np.nan, np.nan], nan_ok=True
    )


def test_weber_contrast_of_means_is_that_of_the_brighter_region():
    assert weber_contrast_of_means([90, 110], [[120, 130], [110, 120]]) == pytest.approx(0.2)
    assert weber_contrast_of_means([120], [100]) == weber_contrast_of_means([100], [120])
    assert weber_contrast_of_means([100], [100]) == 0
    assert weber_contrast_of_means([100], [-1, 0, 1]) == np.inf
    assert np.isnan(weber_contrast_of_means([-9, 3], [-9, 3]))
