"""Flicker of regions of the live image: frames of a pulsed lamp, with camera timestamps, in the camera's thread."""

from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pytest

from labcdp.chain import PulsedLamp
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.roi import Roi
from labcdp.web.bench.cards import flicker_card
from labcdp.web.bench.flicker import FEWEST_FRAMES, FlickerTrace

LAMP = Roi.rectangle("lamp", 4, 4, 16, 16)
RATE_HZ, BLACK_DN = 31.0, 64.0


def frames(n, exposure_s=2e-3, first=0):
    lamp, rng = PulsedLamp(217.3, 0.3, 0.1), np.random.default_rng(first)
    begins = np.arange(first, first + n) / RATE_HZ
    for number, light in enumerate(lamp.collected(exposure_s, begins * 217.3) / exposure_s):
        dn = BLACK_DN + rng.normal(2000 * light, 5, (24, 32))
        yield Frame(
            np.clip(np.rint(dn), 0, 4095).astype(np.uint16),
            exposure_s=exposure_s,
            gain_db=0.0,
            bit_depth=12,
            saturation_dn=4095,
            black_level_dn=BLACK_DN,
            pixel_format="Mono12",
            colour_filter=None,
            temperature_c=None,
            timestamp=datetime.now(UTC),
            camera_timestamp_ns=int(1e9 * (begins[number] + 1)),
            frame_id=first + number,
            camera=CameraIdentity("maker", "model", "1", simulated=True),
        )


@pytest.fixture
def trace():
    return FlickerTrace(lambda: (LAMP,), lambda: BLACK_DN)


def test_flicker_is_that_of_all_frames(trace):
    for frame in frames(300):
        trace.add(frame)
    ((measured,),) = (tuple(trace.measured()),)
    truth = PulsedLamp(217.3, 0.3, 0.1).flicker(2e-3)
    low, high = measured["lamp"].fmi.interval
    assert low - 0.002 < truth.fmi < high + 0.002
    assert measured["lamp"].mmp.value == pytest.approx(truth.mmp, abs=0.02)
    assert measured["lamp"].beat_hz == pytest.approx(abs(217.3 - 7 * RATE_HZ), abs=0.01)
    card = flicker_card(SimpleNamespace(flicker=measured, flicker_trace=trace))
    assert "Flicker: lamp" in card
    assert "300 frames" in card


def test_other_settings_begin_anew(trace):
    for frame in frames(40):
        trace.add(frame)
    assert trace.n_frames == 40
    for frame in frames(5, exposure_s=1e-3, first=40):
        trace.add(frame)
    assert trace.n_frames == 5 < FEWEST_FRAMES
    assert [*trace.measured()] == [{}]
    assert "5 frames" in flicker_card(SimpleNamespace(flicker={}, flicker_trace=trace))
    assert flicker_card(SimpleNamespace(flicker=None, flicker_trace=trace)) == ""


def test_saturated_frames_have_no_value(trace):
    for number, frame in enumerate(frames(30)):
        trace.add(replace(frame, dn=np.full_like(frame.dn, 4095)) if number < 3 else frame)
    (measured,) = trace.measured()
    assert (measured["lamp"].n_frames, measured["lamp"].n_evaluated) == (30, 27)
