from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.dn import pixel_format
from labcdp.drivers.aravis.frames import FrameCheck, FrameIds
from labcdp.drivers.camera import CameraSettingError
from labcdp.drivers.camera_settings import CameraSettings


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


@pytest.mark.parametrize(
    ("name", "n_bytes"), [("Mono8", 64 * 48), ("Mono12Packed", 64 * 48 * 3 // 2), ("Mono12", 64 * 48 * 2)]
)
def test_frames_with_fewer_bytes_than_their_pixels_are_refused(aravis, name, n_bytes):
    layout = pixel_format(name)
    check = FrameCheck(CameraSettings(0.01, 0.0, name, 64, 48), layout, reserves_zero=True)
    # Aravis says SUCCESS of a frame whose last packets the camera never announced.
    buffer = SimpleNamespace(
        get_status=lambda: aravis.BufferStatus.SUCCESS,
        get_frame_id=lambda: 7,
        get_image_width=lambda: 64,
        get_image_height=lambda: 48,
        get_image_pixel_format=lambda: layout.code,
    )
    assert check.fault(buffer, n_bytes - 1) == ("SIZE_MISMATCH", f"{n_bytes - 1} bytes of {n_bytes} came")
    buffer.get_frame_id = lambda: 8
    assert check.fault(buffer, n_bytes) is None
    with pytest.raises(CameraSettingError, match=f"PayloadSize is {n_bytes - 1} bytes, but 64 x 48 pixels of {name}"):
        check.require_payload(n_bytes - 1)
