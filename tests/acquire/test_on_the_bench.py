"""Whole acquisitions on the simulated bench, in simulated time."""

import threading
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest

from labcdp.acquire import AcquisitionStoppedError, Control, Unattended
from labcdp.drivers.camera import (
    MOST_REFUSED,
    CameraLostError,
    IncompleteFrameError,
)
from labcdp.drivers.replay import ReplayCamera, ReplayMeter

from .conftest import Hands

TWO = ["P12", "lower left"]
#: Of very different luminance.
FAR = ["P01", "lower left"]


def test_patches_one_by_one(changed, on_bench):
    configuration = changed(patches=FAR, target={"presentation": "one by one"}, plan={"exposures_s": (0.002, 0.032)})
    with on_bench(configuration) as on:
        hands = Hands(on.bench)
        assert on.acquire(hands) == ()
        assert hands.done == ["uncover", "show P01", "show lower left", "cover", "uncover"]
        assert hands.found == []
        # Two exposures of two frames for each patch; two readings before its frames and two after.
        assert on.counts == (8, 8, 4)
        light = {name: [r for r in on.session.frames("light") if r.patch == name] for name in FAR}
        read = {name: [r.sequence for r in on.session.readings() if r.patch == name] for name in FAR}
        for name in FAR:
            assert [r.exposure_s for r in light[name]] == [0.002, 0.002, 0.032, 0.032]
            assert read[name][1] < light[name][0].sequence < light[name][-1].sequence < read[name][2]
        assert {r.patch for r in on.session.frames("dark")} == {None}
        # Each patch was there alone: where the other one is, there was dark background only.
        region = {patch.name: patch.region() for patch in configuration.target.patches}
        frame = on.session.load(light["P01"][-1])
        assert region["lower left"].select(frame.dn).mean() < 1000
        on.session.verify()


def test_a_camera_that_stays_away_ends_the_run_and_the_next_one_resumes(changed, on_bench):
    configuration = changed(plan={"frames_per_exposure": 30})
    with on_bench(configuration, patience_s=5) as on:
        on.bench.schedule("at 2 s vanish")
        with pytest.raises(CameraLostError, match="is lost"):
            on.acquire()
        taken = on.counts[0]
        assert 0 < taken < 90
        on.session.verify()
    with on_bench(configuration) as on:
        on.acquire()
        assert on.counts == (90, 32, 6)
        assert len(on.events("camera features")) == 2


def test_incomplete_frames_are_taken_again_and_noted_until_too_many_in_a_row_end_the_run(changed, on_bench):
    with on_bench(changed()) as on:
        on.bench.schedule("at 0.1 s wrong size for 0.3 s\nat 0.9 s wrong size")
        with pytest.raises(IncompleteFrameError, match="incomplete"):
            on.acquire()
        taken = on.counts[0]
        assert 1 < taken < 12
        refused = on.events("refused frame")
        assert len(refused) > MOST_REFUSED - 1
        assert refused[0].keys() == {"role", "exposure_s", "reason", "status", "frame_id"}
        assert refused[0]["status"] == "SIZE_MISMATCH"


def test_light_that_drifts_is_found_and_the_patch_repeated(changed, on_bench):
    configuration = changed(patches=TWO, target={"presentation": "one by one"})
    with on_bench(configuration) as on:
        hands = Hands(on.bench, lambda what, findings: True)
        on.bench.schedule("at 2 s light -10% in 0 s")
        on.acquire(hands)
        (what, checks) = hands.found[0]
        assert what == "patch P12"
        assert "meter drift" in checks
        assert len(hands.found) == 1
        assert hands.done.count("show P12") == 2
        # What was taken in the changing light is on the disk and does not count.
        assert on.counts == (12, 8, 6)
        (superseded,) = on.events("superseded")
        assert len(superseded["lines"]) == 10
        assert "went from" in superseded["reason"]
        drifted, *others = on.events("check")
        assert drifted["unit"] == "patch P12"
        assert drifted["repeat"]
        assert all(not event["findings"] for event in others)
        readings = [r.reading.luminance_cd_m2 for r in on.session.readings()]
        nominal = on.bench.luminance_cd_m2["P12"]
        assert readings[0] == pytest.approx(0.9 * 1.006 * nominal, rel=0.01)


def test_a_unit_that_was_complete_but_not_checked_is_checked_by_the_next_run(changed, on_bench):
    configuration = changed(patches=TWO, plan={"exposures_s": (0.03, 0.06)})

    class Gone(Hands):
        def repeat(self, what, findings):
            raise KeyboardInterrupt

    with on_bench(configuration) as on, pytest.raises(KeyboardInterrupt):
        on.acquire(Gone(on.bench))
    with on_bench(configuration) as on:
        assert on.counts == (4, 0, 0)
        hands = Hands(on.bench)
        on.acquire(hands)
        assert hands.found == [("light frames", ["saturation", "saturation"])]
        assert hands.done[0] == "point P12"


def test_a_night_of_frames_on_a_schedule(changed, on_bench):
    """Eight hours of a frame every ten minutes, with the camera away for 25 of them."""
    configuration = changed(
        patches=["P12"], plan={"exposures_s": (0.002,), "frames_per_exposure": 48, "interval_s": 600.0}
    )
    with on_bench(configuration, patience_s=3600) as on:
        on.bench.schedule("at 120 min vanish for 25 min")
        on.acquire(Hands(on.bench))
        times = [datetime.fromisoformat(r.metadata["timestamp"]) for r in on.session.frames("light")]
        steps = np.array([(b - a).total_seconds() for a, b in pairwise(times)])
        late = np.abs(steps - 600) > 1
        # The frames that were missed are not made up for: only the steps around the gap are others.
        assert 1 <= late.sum() <= 2
        assert times[-1] - times[0] > timedelta(hours=8)
        assert len(on.events("camera lost and back")) == 1


def test_a_pause_takes_nothing_and_resuming_takes_the_rest(changed, on_bench):
    with on_bench(changed(plan={"frames_per_exposure": 10})) as on:
        control = Control()
        counts = []

        def pause(progress):
            if (progress.step, progress.done) == ("light frames", 5):
                control.pause()
                threading.Timer(0.3, resume).start()
            counts.append((progress.step, progress.done))

        def resume():
            counts.append("resumed")
            control.resume()

        on.acquire(report=pause, control=control)
        at = counts.index("resumed")
        assert counts[at - 1] == ("light frames", 5)
        assert on.counts == (30, 32, 6)


@pytest.mark.parametrize(("step", "counts"), [("light frames", (3, 0, 0)), ("meter readings", (6, 3, 0))])
def test_stopping_keeps_all_that_was_taken(changed, on_bench, step, counts):
    configuration, control = changed(), Control()

    def stop(progress):
        if (progress.step, progress.done) == (step, 3):
            control.stop()

    with on_bench(configuration) as on:
        with pytest.raises(AcquisitionStoppedError, match="recorded data are safe"):
            on.acquire(report=stop, control=control)
        assert on.counts == counts
        assert on.events("complete") == []
        on.session.verify()
    with on_bench(configuration) as on:
        on.acquire()
        assert on.counts == (6, 32, 6)


def test_unattended_does_what_needs_no_hand_and_tells_the_rest(changed, on_bench):
    configuration = changed(patches=TWO)
    with on_bench(configuration) as on:
        left = on.acquire(Unattended())
        assert on.counts == (6, 0, 0)
        assert [(thing.what, thing.hand) for thing in left] == [
            ("readings of P12", "point the luminance meter at each patch"),
            ("readings of lower left", "point the luminance meter at each patch"),
            ("dark frames", "cover the lens"),
        ]
        assert on.events("complete") == []
    with on_bench(configuration) as on:
        on.bench.cover_lens()
        left = on.acquire(Unattended("covered"))
        assert on.counts == (6, 0, 6)
        assert [thing.what for thing in left] == ["readings of P12", "readings of lower left"]
    with on_bench(configuration) as on:
        hands = Hands(on.bench)
        assert on.acquire(hands) == ()
        assert hands.done == ["point P12", "point lower left"]
        assert on.counts == (6, 4, 6)
        assert on.events("complete") == [{}]


def test_a_camera_warms_up_until_its_temperature_is_steady_and_first_frames_are_dropped(changed, on_bench):
    plan = {"warm_up_s": 3600.0, "stable_within_c": 0.15, "discard_frames": 3, "exposures_s": (0.002, 0.008)}
    with on_bench(changed(patches=TWO, plan=plan)) as on:
        on.bench.run_command("temperature +8 C in 40 s")
        on.acquire()
        (warm,) = on.events("warm-up")
        # 40 s of change, of which the last 0.75 s are within 0.15 degrees, and a minute that is steady.
        assert 96 < warm["duration_s"] < 106
        assert (warm["temperature_c"], warm["stable"]) == (pytest.approx(43, abs=0.01), True)
        ids = [record.metadata["frame_id"] for record in on.session.frames("light")]
        # Two frames of each exposure, behind three that were dropped.
        assert [after - before for before, after in pairwise(ids)] == [1, 4, 1]
        # A recording has neither.
        with (
            ReplayCamera(on.session) as camera,
            ReplayMeter(on.session) as meter,
            on_bench(on.session.configuration, name="replayed") as replayed,
        ):
            replayed.camera, replayed.meter = camera, meter
            replayed.acquire()
            assert replayed.counts == on.counts


def test_a_warm_up_ends_with_its_time(changed, on_bench):
    with on_bench(changed(patches=TWO, plan={"warm_up_s": 70.0, "stable_within_c": 0.1})) as on:
        on.bench.run_command("temperature +8 C in 3 min")
        on.acquire()
        (warm,) = on.events("warm-up")
    assert warm["stable"] is False
    assert warm["duration_s"] == pytest.approx(70, abs=1)
