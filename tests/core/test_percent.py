"""Contrasts with a percent sign, and those without one that are no fractions, wherever they are given."""

from decimal import Decimal

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import labcdp
from labcdp.core.percent import of_percent
from labcdp.evaluate.sweep.plan import parse_axis
from labcdp.session import SessionConfiguration, example_configuration, example_session

BRIGHT, DARK = [150, 160, 170], [100, 101, 102]
CHAIN = labcdp.Chain.load("manta-g505").with_(scene__width=32, scene__height=24, scene__square_px=4)
PICTURE = np.kron([[100, 150], [150, 100]], np.ones((8, 8)))


def of_plan(contrast):
    written = f'"{contrast}"' if isinstance(contrast, str) else contrast
    text = example_configuration().replace("contrast = 10.0", f"contrast = {written}", 1)
    return SessionConfiguration.from_toml(text, "bench.toml").contrasts[0].contrast


def of_session(contrast):
    session = labcdp.Session.open(example_session())
    result = session.calibrate().evaluate(contrast, pairs=[("upper left", "lower right")])
    return float(result.to_dataset().contrast.values.ravel()[0])


def of_chain(contrast):
    return CHAIN.with_(scene__contrast=contrast).scene.contrast


def of_command_line(contrast):
    axis = parse_axis(f"scene.contrast={contrast}")
    return CHAIN.with_(**{axis.parameter: axis.values[0]}).scene.contrast


PLACES = {
    "cdp": lambda contrast: labcdp.cdp(BRIGHT, DARK, contrast).contrast,
    "cdp of several": lambda contrast: float(labcdp.cdp(BRIGHT, DARK, [contrast]).contrast[0]),
    "cdp beside fractions": lambda contrast: float(labcdp.cdp(BRIGHT, DARK, [0.25, contrast]).contrast[1]),
    "neighbours": lambda contrast: labcdp.cdp_neighbours(PICTURE, contrast).contrast,
    "plan": of_plan,
    "session": of_session,
    "chain": of_chain,
    "--set": of_command_line,
    "sweep": lambda contrast: float(CHAIN.sweep(scene__contrast=[contrast], exact=True)["scene.contrast"][0]),
}


@pytest.mark.parametrize("place", PLACES)
def test_a_contrast_has_its_sign_or_is_a_fraction(place):
    of = PLACES[place]
    assert of("50%") == of(0.5) == 0.5
    assert of("5000%") == of(50.0) == 50
    with pytest.raises(labcdp.InputError, match='50, which would be 5000 %: give it with its sign, "50%" or "5000%"'):
        of(50)


def test_an_array_of_whole_numbers_is_no_list_of_percentages():
    with pytest.raises(labcdp.InputError, match="50, which would be 5000 %"):
        labcdp.cdp(BRIGHT, DARK, np.array([10, 50]))


def test_a_tolerance_may_have_its_sign():
    with_sign, without = labcdp.cdp(BRIGHT, DARK, "50%", "20%"), labcdp.cdp(BRIGHT, DARK, 0.5, 0.2)
    assert (with_sign.cdp, with_sign.detected_range, with_sign.epsilon) == (without.cdp, without.detected_range, 0.2)
    by_sign = CHAIN.sweep(scene__luminance_cd_m2=[5.0], exact=True, contrast="50%", epsilon="20%")
    by_number = CHAIN.sweep(scene__luminance_cd_m2=[5.0], exact=True, contrast=0.5, epsilon=0.2)
    xr.testing.assert_equal(by_sign, by_number)


@given(st.decimals(-(10**6), 10**6, places=4))
def test_a_percentage_is_the_float_nearest_to_it(percent):
    assert of_percent(f"{percent}%") == of_percent(f"{percent} %") == float(Decimal(percent) / 100)


@pytest.mark.parametrize("text", ["", "%", "50", "x%", "nan%", "inf%", "1e999999999%", "\u0665%", "5%%"])
def test_what_is_no_percentage(text):
    assert of_percent(text) is None
