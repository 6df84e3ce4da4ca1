import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labcdp.chain import Windscreen

luminances = arrays(np.float64, (3, 4), elements=st.floats(0, 1e5))


def test_energy_is_lost_and_glare_added_as_stated() -> None:
    scene = np.array([[1.0, 3.0], [2.0, 2.0]])  # mean 2
    behind = Windscreen(transmittance=0.96, glare_fraction=0.5).apply(scene)
    np.testing.assert_allclose(behind, [[0.96 * 2, 0.96 * 4], [0.96 * 3, 0.96 * 3]], rtol=1e-15)


@given(scene=luminances, glare=st.floats(0, 2))
def test_glare_raises_the_mean_by_its_fraction(scene: np.ndarray, glare: float) -> None:
    behind = Windscreen(0.8, glare).apply(scene)
    assert behind.mean() == pytest.approx(0.8 * (1 + glare) * scene.mean(), rel=1e-9, abs=1e-9)


def test_glare_lowers_the_weber_contrast() -> None:
    # Veil equal to the dark level halves the contrast.
    behind = Windscreen(0.9, glare_fraction=2 / 3).apply(np.array([[1.0, 2.0]]))
    assert behind[0, 1] / behind[0, 0] - 1 == pytest.approx(0.5)
