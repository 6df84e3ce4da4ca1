from typing import Any

import numpy as np
import pytest

from labcdp.chain import ExposureSettings
from labcdp.errors import InputError


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


def test_defaults_are_0_db_and_25_degrees() -> None:
    assert ExposureSettings((0.01,)) == ExposureSettings((0.01,), gain_db=0.0, temperature_c=25.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"exposure_s": []}, r"^exposure_s is empty: give one exposure time in s, or several$"),
        ({"exposure_s": 0}, r"^exposure_s is 0: give a number from 1e-09 to 100000 s$"),
        ({"exposure_s": [0.01, -0.01]}, r"^exposure_s is -0.01: give a number from 1e-09 to 100000 s$"),
        ({"exposure_s": np.nan}, r"^exposure_s is nan: give a number from 1e-09 to 100000 s$"),
        ({"exposure_s": np.inf}, r"^exposure_s is inf: give a number from 1e-09 to 100000 s$"),
        ({"exposure_s": "0.01"}, r"^exposure_s is '0.01': give a number from 1e-09 to 100000 s$"),
        ({"exposure_s": [[0.01]]}, r"^exposure_s is \[0.01\]: give a number from 1e-09 to 100000 s$"),
        ({"exposure_s": None}, r"^exposure_s is None: give a number from 1e-09 to 100000 s$"),
        (
            {"exposure_s": [1, 0.5, 1.0]},
            r"^exposure_s has the times \[1, 0.5, 1.0\] s, of which two are equal: give each time once$",
        ),
        ({"exposure_s": 2e5}, r"^exposure_s is 200000.0: give a number from 1e-09 to 100000 s$"),
        ({"exposure_s": True}, r"^exposure_s is True: give a number from 1e-09 to 100000 s$"),
        ({"gain_db": 101}, r"^gain_db is 101: give a number from -100 to 100 dB$"),
        ({"gain_db": "0"}, r"^gain_db is '0': give a number from -100 to 100 dB$"),
        ({"temperature_c": 201.0}, r"^temperature_c is 201.0: give a number from -100 to 200 degC$"),
        ({"temperature_c": np.nan}, r"^temperature_c is nan"),
    ],
)
def test_value_out_of_range_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ExposureSettings(**({"exposure_s": 0.01} | values))
