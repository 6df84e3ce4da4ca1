from typing import Any

import numpy as np
import pytest

from labcdp.chain import ExposureSettings


@pytest.mark.parametrize(
    ("given", "held"),
    [
        (0.01, (0.01,)),
        (1, (1.0,)),
        ([0.01, 0.002], (0.01, 0.002)),
        ((3, np.float32(0.5)), (3.0, 0.5)),
    ],
)
def test_times_are_held_as_floats_in_their_order(given: Any, held: tuple[float, ...]) -> None:
    settings = ExposureSettings(given)
    assert settings.exposure_s == held
    assert {type(time) for time in settings.exposure_s} == {float}
