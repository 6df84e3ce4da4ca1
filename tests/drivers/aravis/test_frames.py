import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers.aravis.frames import FrameIds


def _told(ids, reserves_zero=True):
    order = FrameIds(reserves_zero)
    return [order.left_out(each) for each in ids]


@pytest.mark.parametrize(
    ("ids", "told"),
    [
        ([65401, 65402, 65403], [0, 0, 0]),
        # GigE Vision leaves out 0 when its 16 bits run over.
        ([65534, 65535, 1, 2], [0, 0, 0, 0]),
        ([65534, 2], [0, 2]),
        ([10, 14, 15], [0, 3, 0]),
        ([10, 10], [0, None]),
        ([5000, 3, 5002, 4, 5004], [0, None, 0, None, 0]),
        ([7, 0, 9], [0, None, 0]),
        # Extended ids have 64 bits.
        ([65535, 65536, 65537], [0, 0, 0]),
        ([2**40, 2**40 + 3], [0, 2]),
        ([2**40, 1], [0, None]),
    ],
)
def test_ids_of_gige_vision(ids, told):
    assert _told(ids) == told


@given(st.integers(1, 65535), st.lists(st.integers(1, 32767), min_size=1, max_size=20))
def test_ids_left_out_are_counted_through_the_wrap(first, steps):
    ids = [first]
    for step in steps:
        ids.append((ids[-1] - 1 + step) % 65535 + 1)
    assert _told(ids) == [0] + [step - 1 for step in steps]
