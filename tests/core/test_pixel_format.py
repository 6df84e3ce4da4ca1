import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.pixel_format import PIXEL_FORMATS, pixel_format

#: Names in Aravis' headers where they are not the PFNC name in capitals; Mono12p it does not know.
_ARAVIS = {name: name.upper().replace("MONO", "MONO_").replace("PACKED", "_PACKED") for name in PIXEL_FORMATS} | {
    name: f"BAYER_{name[5:7]}_{name[7:].upper().replace('PACKED', '_PACKED')}"
    for name in PIXEL_FORMATS
    if name.startswith("Bayer")
}


@pytest.mark.parametrize("name", sorted(set(PIXEL_FORMATS) - {"Mono12p"}))
def test_codes_are_those_of_aravis(aravis, name):
    assert PIXEL_FORMATS[name].code == getattr(aravis, f"PIXEL_FORMAT_{_ARAVIS[name]}")


def test_every_mono_format_asked_for_has_its_bayer_twins():
    suffixes = {name.removeprefix("Mono") for name in PIXEL_FORMATS if name.startswith("Mono")}
    assert suffixes == {"8", "10", "12", "12Packed", "12p", "16"}
    for pattern in ("RG", "GB", "GR", "BG"):
        for suffix in suffixes:
            assert PIXEL_FORMATS[f"Bayer{pattern}{suffix}"].colour_filter == pattern


def test_mono12packed_by_hand():
    # GigE Vision: high bytes of the two pixels outside, their low nibbles in the middle byte.
    payload = np.array([0xAB, 0x3C, 0xDE], dtype=np.uint8)
    assert pixel_format("Mono12Packed").unpack(payload, (1, 2)).tolist() == [[0xABC, 0xDE3]]


def test_mono12p_by_hand():
    # PFNC p: a stream of bits, least significant first.
    payload = np.array([0xAB, 0x3C, 0xDE], dtype=np.uint8)
    assert pixel_format("Mono12p").unpack(payload, (1, 2)).tolist() == [[0xCAB, 0xDE3]]


@given(st.sampled_from(sorted(PIXEL_FORMATS)), st.integers(1, 7), st.integers(1, 7), st.randoms(use_true_random=False))
def test_unpack_undoes_pack(name, height, width, random):
    layout = PIXEL_FORMATS[name]
    kind = np.uint8 if layout.bit_depth == 8 else np.uint16
    values = [random.randrange(2**layout.bit_depth) for _ in range(height * width)]
    dn = np.array(values, dtype=kind).reshape(height, width)
    payload = layout.pack(dn)
    assert payload.nbytes == layout.payload_bytes(dn.size)
    np.testing.assert_array_equal(layout.unpack(payload, dn.shape), dn)
