"""Values of camera and meter: pixel formats, black levels, series of readings; and what is quoted of wrong ones."""

from math import hypot, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.dn import PIXEL_FORMATS, pixel_format
from labcdp.core.errors import InputError
from labcdp.core.frame import nominal_black_dn
from labcdp.core.reading import MeterIdentity, ReadingSeries
from labcdp.core.vignetting import FlatField, RadialVignetting, middle_of


def test_codes_are_those_of_aravis(aravis):
    for name, known in PIXEL_FORMATS.items():
        # Names in Aravis' headers are not the PFNC name in capitals; Mono12p it does not know.
        theirs = name.upper().replace("MONO", "MONO_").replace("PACKED", "_PACKED")
        if name.startswith("Bayer"):
            theirs = f"BAYER_{name[5:7]}_{theirs[7:]}"
        if name != "Mono12p":
            assert known.code == getattr(aravis, f"PIXEL_FORMAT_{theirs}"), name


@pytest.mark.parametrize(
    ("name", "dn"),
    [
        # GigE Vision: high bytes of the two pixels outside, their low nibbles in the middle byte.
        ("Mono12Packed", [[0xABC, 0xDE3]]),
        # PFNC p: a stream of bits, least significant first.
        ("Mono12p", [[0xCAB, 0xDE3]]),
    ],
)
def test_packed_bytes_by_hand(name, dn):
    assert pixel_format(name).unpack(np.array([0xAB, 0x3C, 0xDE], dtype=np.uint8), (1, 2)).tolist() == dn


@given(st.sampled_from(sorted(PIXEL_FORMATS)), st.integers(1, 7), st.integers(1, 7), st.integers(0, 2**32))
def test_unpack_undoes_pack(name, height, width, seed):
    layout = PIXEL_FORMATS[name]
    kind = np.uint8 if layout.bit_depth == 8 else np.uint16
    dn = np.random.default_rng(seed).integers(0, 2**layout.bit_depth, (height, width)).astype(kind)
    payload = layout.pack(dn)
    assert payload.nbytes == layout.payload_bytes(dn.size)
    np.testing.assert_array_equal(layout.unpack(payload, dn.shape), dn)


def test_nominal_black_level_is_the_stated_one_or_near_that_of_dark_frames_of_a_register_of_64():
    for bits, measured_dn in ((8, 3.6), (12, 63.9), (16, 1022.7)):
        assert nominal_black_dn(None, 64, bits) == pytest.approx(measured_dn, abs=0.5 * 2 ** (bits - 12) + 0.5)
    for stated_dn, register, expected in ((512.0, None, 512), (0.0, 64, 0), (None, None, 0)):
        assert nominal_black_dn(stated_dn, register, 12) == expected


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


@pytest.mark.parametrize("given", ["a" * 10**6, "a b " * 10**6, "'a " * 10**6, "a\x1b\n" * 10**6], ids=range(4))
def test_a_message_quotes_little_and_what_is_printable(given):
    message = str(InputError(f"stage is {given!r}: give one of the camera's"))
    assert message.startswith("stage is ")
    assert message.endswith(": give one of the camera's")
    assert len(message) < 140
    assert message.isprintable()


# Vignetting and flat fields


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
