from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.dn import pixel_format
from labcdp.drivers.aravis.frames import FrameCheck, FrameIds
from labcdp.drivers.camera import CameraSettingError
from labcdp.drivers.camera_settings import CameraSettings


@pytest.mark.parametrize(
    ("ids", "left_out"),
    [
        ([5000, 3, 5002, 4, 5004], [0, None, 0, None, 0]),
        ([7, 0, 9], [0, None, 0]),
        # Extended ids have 64 bits.
        ([65535, 65536, 65537, 2**40, 2**40 + 3, 1], [0, 0, 0, 2**40 - 65538, 2, None]),
    ],
)
def test_ids_that_do_not_follow(ids, left_out):
    order = FrameIds(reserves_zero=True)
    assert [order.left_out(each) for each in ids] == left_out


@given(st.integers(1, 65535), st.lists(st.integers(1, 32767), min_size=1, max_size=20))
def test_ids_left_out_are_counted_where_16_bits_run_over_and_leave_out_0(first, steps):
    order, last = FrameIds(reserves_zero=True), first
    assert order.left_out(first) == 0
    for step in steps:
        last = (last - 1 + step) % 65535 + 1
        assert order.left_out(last) == step - 1


@pytest.mark.parametrize(("name", "n_bytes"), [("Mono12Packed", 64 * 48 * 3 // 2), ("Mono12", 64 * 48 * 2)])
def test_frames_with_fewer_bytes_than_their_pixels_are_refused(aravis, name, n_bytes):
    layout = pixel_format(name)
    check = FrameCheck(CameraSettings(0.01, 0.0, name, 64, 48), layout, reserves_zero=True)
    ids = iter((7, 8))
    # Aravis says SUCCESS of a frame whose last packets the camera never announced.
    buffer = SimpleNamespace(
        get_status=lambda: aravis.BufferStatus.SUCCESS,
        get_frame_id=lambda: next(ids),
        get_payload_type=lambda: aravis.BufferPayloadType.IMAGE,
        get_image_width=lambda: 64,
        get_image_height=lambda: 48,
        get_image_pixel_format=lambda: layout.code,
    )
    assert check.fault(buffer, n_bytes - 1) == ("SIZE_MISMATCH", f"{n_bytes - 1} bytes of {n_bytes} came")
    assert check.fault(buffer, n_bytes) is None
    with pytest.raises(CameraSettingError, match=f"PayloadSize is {n_bytes - 1} bytes, but 64 x 48 pixels of {name}"):
        check.require_payload(n_bytes - 1)


@pytest.mark.parametrize(("width", "height", "payload_bytes"), [(0, 48, 0), (64, 0, 0), (2**31, 2**31, 2**62)])
def test_empty_and_huge_frames_are_refused(aravis, width, height, payload_bytes):
    check = FrameCheck(CameraSettings(0.01, 0.0, "Mono8", width, height), pixel_format("Mono8"), reserves_zero=True)
    with pytest.raises(CameraSettingError, match=f"states {width} x {height} pixels"):
        check.require_payload(payload_bytes)
