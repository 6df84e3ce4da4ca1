"""Whole acquisitions on the simulated bench, in simulated time, and what they refuse and find in their data."""

import os
import threading
from dataclasses import replace
from datetime import date, datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest

from labcdp.acquire import AcquisitionStoppedError, Control, is_complete
from labcdp.cli.app import EndedBySignal
from labcdp.core.errors import InputError, SessionError
from labcdp.drivers.camera import MOST_REFUSED, CameraNotFoundError, CameraSettingError, IncompleteFrameError
from labcdp.drivers.file_meter import FileMeter
from labcdp.drivers.manual import ManualMeter
from labcdp.drivers.meter import MeterError
from labcdp.drivers.replay import ReplayMeter
from labcdp.session.configuration import ContrastConfiguration
from labcdp.session.tables import MeterCertificate

from .conftest import FAR, Hands

ONE_BY_ONE = {"presentation": "one by one"}
#: Exposures at which the brighter patch is saturated.
TOO_LONG = {"exposures_s": (0.03, 0.06)}
#: Exposures at which no patch is above the noise.
TOO_SHORT = {"exposures_s": (2.2e-5, 4.4e-5)}


def test_patches_one_by_one(changed, on_bench):
    configuration = changed(FAR, target=ONE_BY_ONE, plan={"exposures_s": (0.002, 0.032)})
    with on_bench(configuration) as on:
        hands = Hands(on.bench)
        assert on.acquire(hands) == ()
        assert hands.done == ["uncover_lens", "show_patch P01", "show_patch lower left", "cover_lens", "uncover_lens"]
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


def test_incomplete_frames_are_taken_again_and_noted_until_too_many_in_a_row_end_the_run(changed, on_bench):
    with on_bench(changed()) as on:
        on.bench.schedule("at 0.1 s wrong size for 0.3 s\nat 0.9 s wrong size")
        with pytest.raises(IncompleteFrameError, match="incomplete"):
            on.acquire()
        assert 1 < on.counts[0] < 12
        refused = on.events("refused frame")
        assert len(refused) > MOST_REFUSED - 1
        assert refused[0]["status"] == "SIZE_MISMATCH"


def test_light_that_drifts_is_found_and_the_patch_repeated(changed, on_bench):
    with on_bench(changed(["P12", "lower left"], target=ONE_BY_ONE)) as on:
        hands = Hands(on.bench, lambda what, findings: True)
        on.bench.schedule("at 2 s light -10% in 0 s")
        on.acquire(hands)
        ((what, checks),) = hands.found
        assert what == "patch P12"
        assert "meter drift" in checks
        assert hands.done.count("show_patch P12") == 2
        # What was taken in the changing light is on the disk and does not count.
        assert on.counts == (12, 8, 6)
        (superseded,) = on.events("superseded")
        assert len(superseded["lines"]) == 10
        assert [event["repeat"] for event in on.events("check")][:1] == [True]
        reading = on.session.readings()[0].reading.luminance_cd_m2
        assert reading == pytest.approx(0.9 * 1.006 * on.bench.luminance_cd_m2["P12"], rel=0.01)


def test_a_unit_that_was_complete_but_not_checked_is_checked_by_the_next_run(changed, on_bench):
    configuration = changed(["P01", "P12"], plan=TOO_SHORT)

    def gone(what, findings):
        raise KeyboardInterrupt

    with on_bench(configuration) as on, pytest.raises(KeyboardInterrupt):
        on.acquire(Hands(on.bench, gone))
    with on_bench(configuration) as on:
        assert on.counts == (4, 0, 0)
        hands = Hands(on.bench)
        on.acquire(hands)
        assert hands.found[0] == ("light frames", ["darkness"])
        assert hands.done[0] == "point_meter P01"
        assert [finding["check"] for finding in on.events("check")[0]["findings"]] == ["darkness"]


@pytest.mark.parametrize(
    ("patches", "target"), [(["lower left", "upper left"], {}), (["lower left"], {}), (["lower left"], ONE_BY_ONE)]
)
def test_exposures_in_the_wrong_unit_are_noticed_before_a_frame_is_recorded(changed, on_bench, patches, target):
    """1, 5 and 20, meant as ms, of patches that are saturated from 10 ms on."""
    plan = {"exposures_s": (1.0, 0.5, 0.2), "drift_check": True}
    with on_bench(changed(patches, target=target, plan=plan)) as on:
        hands = Hands(on.bench)
        if target:
            on.acquire(hands)
            assert hands.found[0] == ("look at the shortest exposure", ["saturation"])
        else:
            with pytest.raises(InputError, match=r"saturated at 200 ms, the shortest planned"):
                on.acquire(hands)
            assert on.counts == (0, 0, 0)


def test_a_patch_that_is_always_saturated_is_asked_about_before_the_first_frame(changed, on_bench):
    """The operator dims the light, once, and lets the frames be recorded then."""
    with on_bench(changed(FAR, plan=TOO_LONG)) as on:

        def dim(what, findings):
            assert on.counts[0] == (0 if what == "look at the shortest exposure" else 4)
            first = what == "look at the shortest exposure"
            if first:
                on.bench.run_command("light -90% in 0 s")
            return first

        hands = Hands(on.bench, dim)
        on.acquire(hands)
        assert hands.found[0] == ("look at the shortest exposure", ["saturation"])
        assert not any("saturation" in checks for what, checks in hands.found if what == "light frames")


def notes_before_recording(on):
    """What `acquire` notes before the first light frame, at which it is interrupted."""
    notes = []

    def stop(progress):
        if progress.note:
            notes.append(progress.note)
        elif progress.step == "light frames":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        on.acquire(report=stop)
    return notes


@pytest.mark.parametrize(
    ("contrast", "names", "warned"),
    [
        # Nominal luminances of 412 and 0.5 cd/m2: a contrast of 823.
        (8229.9, ("lower left", "P01"), False),
        (8230.0, ("lower left", "P01"), True),
        (8230.0, ("P01", "lower left"), True),
    ],
)
def test_a_target_contrast_ten_times_the_nominal_one_is_warned_of_before_recording(
    changed, on_bench, contrast, names, warned
):
    configuration = changed(FAR)
    pair = ContrastConfiguration(bright=names[0], dark=names[1], contrast=contrast)
    with on_bench(configuration.model_copy(update={"contrasts": (pair,)})) as on:
        assert len(notes_before_recording(on)) == warned


@pytest.mark.parametrize(("day", "warned"), [(date(2999, 1, 1), True), (date(2026, 3, 3), False)])
def test_a_certificate_of_the_future_is_warned_of_before_recording(changed, on_bench, day, warned):
    configuration = changed(FAR)
    certificate = MeterCertificate(number="1", laboratory="PTB", date=day, expanded_uncertainty_rel=0.008)
    meter = configuration.meter.model_copy(update={"certificate": certificate})
    with on_bench(configuration.model_copy(update={"meter": meter})) as on:
        assert len(notes_before_recording(on)) == warned


def test_a_night_of_frames_on_a_schedule(changed, on_bench):
    """Eight hours of a frame every ten minutes, with the camera away for 25 of them."""
    plan = {"exposures_s": (0.002,), "frames_per_exposure": 48, "interval_s": 600.0}
    with on_bench(changed(["P12"], plan=plan), patience_s=3600) as on:
        on.bench.schedule("at 120 min vanish for 25 min")
        on.acquire(Hands(on.bench))
        times = [datetime.fromisoformat(r.metadata["timestamp"]) for r in on.session.frames("light")]
        steps = np.array([(b - a).total_seconds() for a, b in pairwise(times)])
        # The frames that were missed are not made up for: only the steps around the gap are others.
        assert 1 <= (np.abs(steps - 600) > 1).sum() <= 2
        assert times[-1] - times[0] > timedelta(hours=8)
        assert len(on.events("camera lost and back")) == 1


def test_a_pause_takes_nothing_and_a_stop_keeps_what_was_taken(changed, on_bench):
    control = Control()

    def stop_in_a_pause(progress):
        if (progress.step, progress.done) == ("light frames", 3):
            control.pause()
            threading.Timer(0.5, control.stop).start()

    with on_bench(changed()) as on, pytest.raises(AcquisitionStoppedError):
        on.acquire(report=stop_in_a_pause, control=control)
    assert on.counts == (3, 0, 0)


@pytest.mark.parametrize(
    ("plan", "change", "duration_s", "stable"),
    [
        # 5 s of change, of which the last 0.1 s are within 0.15 degrees, and a minute of which 54 s are to be steady.
        ({"warm_up_s": 3600.0, "stable_within_c": 0.15}, "temperature +8 C in 5 s", (58, 66), True),
        ({"warm_up_s": 3600.0, "stable_within_c": 0.15}, "temperature +8 C in 1 h", (53, 62), True),
        ({"warm_up_s": 10.0, "stable_within_c": 0.1}, "temperature +8 C in 3 min", (9.9, 10.1), False),
    ],
)
def test_a_camera_warms_up_until_it_is_steady_or_for_its_time(changed, on_bench, plan, change, duration_s, stable):
    plan |= {"discard_frames": 3, "exposures_s": (0.002, 0.008)}
    with on_bench(changed(["P12"], plan=plan)) as on:
        on.bench.run_command(change)
        on.acquire()
        (warm,) = on.events("warm-up")
        assert duration_s[0] < warm["duration_s"] < duration_s[1]
        assert warm["stable"] == stable
        assert not stable or warm["temperature_c"] == pytest.approx(on.camera.temperature_c, abs=0.1)
        ids = [record.metadata["frame_id"] for record in on.session.frames("light")]
        # Two frames of each exposure, behind three that were dropped.
        assert np.diff(ids).tolist() == [1, 4, 1]


@pytest.mark.parametrize(
    ("tables", "kind"),
    [
        ({"plan": {"exposures_s": (0.002, 100.0)}}, CameraSettingError),
        ({"plan": {"pixel_format": "Mono11"}}, InputError),
        # More frames than the disk has room for.
        ({"plan": {"frames_per_exposure": 10**9}}, SessionError),
        ({"camera": {"serial": "DEV-42"}}, CameraNotFoundError),
    ],
)
def test_impossible_plans_are_refused_before_anything_is_recorded(changed, on_bench, tables, kind):
    with on_bench(changed(**tables)) as on:
        before = len(on.session.records)
        with pytest.raises(kind):
            on.acquire()
        assert len(on.session.records) == before


def test_another_camera_than_the_simulated_one_is_told_how_to_be_rehearsed(changed, on_bench):
    with (
        on_bench(changed(camera={"model": "acA1920-40gm"})) as on,
        pytest.raises(CameraNotFoundError, match="--simulated-bench"),
    ):
        on.acquire()


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


@pytest.mark.parametrize("changes", [{"unit": "%", "correction": None}, {"peak": True}, {"correction": "colour"}])
def test_a_reading_in_another_mode_is_not_recorded(changed, on_bench, changes):
    with on_bench(changed(FAR)) as on:
        meter, on.meter = on.meter, Changed(on.meter, **changes)
        with pytest.raises(MeterError, match="the reading is not used"):
            on.acquire()
        assert on.counts == (6, 0, 0)
        on.meter = meter
        on.acquire()
        assert on.counts == (6, 4, 6)


def test_frames_that_repeat_are_found(changed, on_bench):
    with on_bench(changed(plan={"exposures_s": (0.002, 0.004), "frames_per_exposure": 3})) as on:
        on.camera = Changed(on.camera)
        on.acquire(Hands(on.bench))
        (light,) = (check for check in on.events("check") if check["unit"] == "light frames")
    assert "repeated frames" in [finding["check"] for finding in light["findings"]]


@pytest.mark.parametrize("change", ["unlink", "truncate"])
def test_frames_that_are_deleted_or_cut_while_others_are_taken_are_named_at_the_end(changed, on_bench, change):
    def spoil(progress):
        path = next((on.session.path / "frames").glob("0003_*"), None)
        if path is not None and progress.step == "dark frames":
            path.unlink() if change == "unlink" else os.truncate(path, 100)

    with on_bench(changed()) as on:
        with pytest.raises(SessionError, match=r"is missing or was altered since it was recorded.*--replace-damaged"):
            on.acquire(report=spoil)
        assert not is_complete(on.session)


@pytest.mark.parametrize(
    ("end", "raised"),
    [
        (AcquisitionStoppedError("stopped"), SessionError),
        (EndedBySignal(15), SessionError),
        (CameraNotFoundError("gone"), CameraNotFoundError),
    ],
)
def test_frames_that_are_deleted_are_named_however_the_acquisition_ends(changed, on_bench, caplog, end, raised):
    def spoil(progress):
        path = next((on.session.path / "frames").glob("0003_*"), None)
        if path is not None and progress.step == "dark frames":
            path.unlink()
            raise end

    with on_bench(changed()) as on, pytest.raises(raised) as caught:
        on.acquire(report=spoil)
    assert "0003_" in (str(caught.value) if raised is SessionError else caplog.text)


def test_a_slow_meter_is_waited_for(changed, on_bench):
    with on_bench(changed(["P12", "P07"])) as on:
        engine = on.bench._meters[0]
        engine._errors = replace(engine._errors, lag=0.4)
        notes = []
        on.acquire(Hands(on.bench), report=lambda progress: notes.append(progress.note or ""))
        said = [note for note in notes if "waiting until they settle" in note]
        assert [note.split()[4] for note in said] == ["P07"]
        dropped = [event for event in on.events("superseded") if "still changed by" in event["reason"]]
        assert 2 <= len(dropped) < 20
        (dark,) = {r.patch for r in on.session.readings()} - {"P12"}
        values = [r.reading.luminance_cd_m2 for r in on.session.readings() if r.patch == dark]
        true = on.bench.luminance_cd_m2[dark] * (1 + engine._errors.scale_rel)
        assert len(values) == 2
        assert np.mean(values) == pytest.approx(true, rel=0.02)


def test_light_that_never_settles_ends_the_wait_after_some_readings(changed, on_bench):
    with on_bench(changed(["P12"])) as on:
        on.bench.schedule("at 0.1 s light -99% in 60 s")
        on.acquire(Hands(on.bench))
        dropped = [event for event in on.events("superseded") if "still changed by" in event["reason"]]
        assert len(dropped) == 20
        assert is_complete(on.session)


def test_readings_that_a_person_or_a_recording_gives_are_not_waited_for(changed, on_bench):
    with on_bench(changed(["P12"])) as on:
        on.bench.schedule("at 0.1 s light -99% in 60 s")
        on.meter.live = False
        on.acquire(Hands(on.bench))
        assert not [event for event in on.events("superseded") if "still changed by" in event["reason"]]
    assert {ReplayMeter.live, ManualMeter.live, FileMeter.live} == {False}
