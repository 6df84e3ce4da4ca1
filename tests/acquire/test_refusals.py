"""What an acquisition refuses, and what it finds in its data, on the simulated bench in simulated time."""

from dataclasses import replace

import pytest

from labcdp.acquire import Unattended
from labcdp.core.errors import InputError, SessionError
from labcdp.drivers.camera import (
    CameraNotFoundError,
    CameraSettingError,
)
from labcdp.drivers.meter import MeterError

from .conftest import Hands

TWO = ["P12", "lower left"]


def test_saturated_patches_are_put_to_the_operator(changed, on_bench):
    with on_bench(changed(patches=TWO, plan={"exposures_s": (0.03, 0.06)})) as on:
        hands = Hands(on.bench)
        on.acquire(hands)
        assert hands.found == [("light frames", ["saturation", "saturation"])]
        findings = on.events("check")[0]["findings"]
        assert "patch 'P12' is saturated at every exposure" in findings[0]["cause"]
        assert findings[0]["value"] > findings[0]["limit"]


def test_unattended_repeats_once_what_may_be_better_then(changed, on_bench):
    with on_bench(changed(patches=TWO)) as on:
        # Between the first two frames, and between the first two of the repeat.
        on.bench.schedule("at 0.1 s light -10% in 0 s\nat 0.5 s light -10% in 0 s")
        on.acquire(Unattended())
        flickered, still = on.events("check")
        assert [finding["check"] for finding in flickered["findings"]] == ["flicker"]
        assert [flickered["repeat"], still["repeat"]] == [True, False]
        assert on.counts == (6, 0, 0)
        assert len(on.events("superseded")) == 1


@pytest.mark.parametrize(
    ("tables", "kind", "message"),
    [
        (
            {"plan": {"exposures_s": (0.002, 100.0)}},
            CameraSettingError,
            r"plan.exposures_s has 100 s, the camera takes \S+ to \d+ s: give an exposure within",
        ),
        ({"plan": {"pixel_format": "Mono11"}}, InputError, "pixel format 'Mono11' is not supported: choose one of"),
        (
            {"plan": {"frames_per_exposure": 10**9}},
            SessionError,
            r"needs 3000000006 frames of 0.392 MB, .* has room for \d+ .*: free the disk, or plan fewer frames",
        ),
        ({"camera": {"serial": "DEV-42"}}, CameraNotFoundError, "serial is 'SIM-503363706', .* says 'DEV-42'"),
    ],
)
def test_impossible_plans_are_refused_before_anything_is_recorded(changed, on_bench, tables, kind, message):
    with on_bench(changed(**tables)) as on:
        before = len(on.session.records)
        with pytest.raises(kind, match=message):
            on.acquire()
        assert len(on.session.records) == before


class Changed:
    """A device some of whose results are changed."""

    def __init__(self, device, **changes):
        self._device, self._changes = device, changes

    def __getattr__(self, name):
        return getattr(self._device, name)

    def measure(self):
        return replace(self._device.measure(), **self._changes)

    def grab(self, *args, **options):
        first = {}
        for frame in self._device.grab(*args, **options):
            yield replace(frame, dn=first.setdefault(frame.exposure_s, frame.dn))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"unit": "%", "correction": None}, "a ratio in %"),
        ({"peak": True}, "a held peak"),
        ({"correction": "colour"}, "a reading with the correction 'colour', not 'preset'"),
    ],
)
def test_a_reading_in_another_mode_is_not_recorded(changed, on_bench, changes, problem):
    configuration = changed(patches=TWO)
    with on_bench(configuration) as on:
        on.meter = Changed(on.meter, **changes)
        with pytest.raises(MeterError, match=rf"the meter gave {problem} \(.*\): it is not recorded"):
            on.acquire()
        assert on.counts == (6, 0, 0)
    with on_bench(configuration) as on:
        on.acquire()
        assert on.counts == (6, 4, 6)


def test_frames_that_repeat_are_found(changed, on_bench):
    with on_bench(changed(plan={"exposures_s": (0.002, 0.004), "frames_per_exposure": 3})) as on:
        on.camera = Changed(on.camera)
        on.acquire(Hands(on.bench))
        (light,) = (check for check in on.events("check") if check["unit"] == "light frames")
    (found,) = (finding for finding in light["findings"] if finding["check"] == "repeated frames")
    assert "4 of 6 frames are bit for bit the same as an earlier one" in found["cause"]
