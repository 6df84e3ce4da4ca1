"""DN as cameras send them, and what is known of their black level."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.dn import PIXEL_FORMATS, pixel_format
from labcdp.core.frame import nominal_black_dn


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
