"""Damaged videos: no frame that differs from the undamaged one goes unmarked."""

import sys
from threading import Event, Thread

import numpy as np
import pytest

from .video_files import bars, damaged, frames, moving, write

WRITTEN = {
    "h264.mp4": ("libx264", "yuv420p", {"g": "10"}),
    "slices.mkv": ("libx264", "yuv420p", {"g": "10", "x264-params": "cabac=0:slices=4"}),
    "bframes.avi": ("mpeg4", "yuv420p", {"g": "10", "bf": "2", "b": "4000000"}),
    "mpeg2.mkv": ("mpeg2video", "yuv420p", {"g": "10", "b": "4000000"}),
    "lossless.mkv": ("ffv1", "gray", {"level": "3", "slicecrc": "1"}),
    "hevc.mp4": ("libx265", "yuv420p", {"x265-params": "keyint=10:log-level=none"}),
}


def written(folder, name, n):
    codec, kind, options = WRITTEN[name]
    return write(folder / name, codec, kind, moving(n), options)


@pytest.mark.parametrize("name", WRITTEN)
def test_no_damaged_frame_goes_unmarked(tmp_path, name):
    path = written(tmp_path, name, 18)
    whole = frames(path)
    assert all(one.fault is None for one in whole)
    for seed in range(3):
        found = frames(damaged(path, 4 + 3 * seed, seed))
        assert [one.number for one in found] == [one.number for one in whole]
        assert [one.time_s for one in found] == pytest.approx([one.time_s for one in whole])
        assert any(one.fault is not None for one in found)
        for one, true in zip(found, whole, strict=True):
            assert one.frame is None or np.array_equal(one.frame.dn, true.frame.dn)


def test_damage_is_marked_while_other_threads_run(tmp_path):
    """With FFmpeg's own threads, one in ten damaged lossless videos had no mark here, and closing one could hang."""
    path = damaged(written(tmp_path, "lossless.mkv", 16), 4, 1)
    expected, done, interval_s = [one.fault for one in frames(path)], Event(), sys.getswitchinterval()
    other = Thread(target=lambda: [None for _ in iter(done.is_set, True)])
    sys.setswitchinterval(1e-4)
    other.start()
    try:
        found = [[one.fault for one in frames(path)] for _ in range(12)]
    finally:
        done.set()
        other.join()
        sys.setswitchinterval(interval_s)
    assert any(expected)
    assert found == [expected] * 12


def test_a_broken_image_costs_at_most_itself(tmp_path):
    """Some damage decodes to another picture without a contradiction."""
    path = write(tmp_path / "a.avi", "mjpeg", "yuvj420p", bars())
    whole = frames(path)
    for seed in range(4):
        for one, true in zip(frames(damaged(path, 5, seed)), whole, strict=True):
            assert one.number == 5 or (one.fault is None and np.array_equal(one.frame.dn, true.frame.dn))


def test_one_bad_key_frame_can_be_overruled(tmp_path):
    path = write(tmp_path / "a.mkv", "libx264", "yuv420p", moving(20), {"g": "250", "bf": "0"})
    path = damaged(path, 0, 1)
    lost, used = frames(path), frames(path, damaged=True)
    assert sum(one.frame is None for one in lost) >= 19
    assert sum(one.frame is not None for one in used) >= 19
    assert all(one.note is not None for one in used if one.frame is not None)


@pytest.mark.parametrize("suffix", ["avi", "mkv"])
def test_a_truncated_file_gives_its_whole_frames(tmp_path, suffix):
    path = write(tmp_path / f"a.{suffix}", "ffv1", "gray", bars())
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])
    found = [int(one.frame.dn[0, 0]) for one in frames(path) if one.frame is not None]
    # A message of a decoder may be about each of the packets that its threads have.
    assert 3 <= len(found) < 12
    assert found[:3] == [16, 32, 48]
