import threading
from contextlib import ExitStack
from dataclasses import astuple

import pytest

from labcdp.acquire import Unattended, acquire, remaining
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import CameraLostError, CameraSettingError
from labcdp.drivers.camera_settings import Trigger
from labcdp.drivers.meter import MeterReportedError
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.replay import ReplayCamera, ReplayMeter
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.drivers.simulated.port import Fault
from labcdp.session import EventRecord, Session, example_session

SHAPE = (400, 480)


@pytest.fixture
def bench(small_configuration):
    return SimulatedBench(small_configuration, BenchDevices.standard(), SHAPE)


@pytest.fixture
def stack():
    with ExitStack() as opened:
        yield opened


def counts(session):
    return len(session.frames("light")), len(session.readings()), len(session.frames("dark"))


def test_a_run_records_the_plan(bench, stack, small_configuration, tmp_path):
    session = stack.enter_context(Session.create(tmp_path / "s", small_configuration))
    camera = stack.enter_context(bench.in_process_camera())
    meter = stack.enter_context(MinoltaLS110(stack.enter_context(bench.pty_meter(0)).port))
    seen = []
    acquire(session, camera, meter, bench, seen.append)
    assert counts(session) == (6, 32, 6)
    assert remaining(session).complete
    assert not bench.covered
    ends = [("light frames", 6, 6), ("meter readings", 32, 32), ("dark frames", 6, 6)]
    assert [(p.step, p.done, p.total) for p in seen if p.done == p.total] == ends
    darkest = max(session.load(record).dn.max() for record in session.frames("dark"))
    brightest = max(session.load(record).dn.max() for record in session.frames("light"))
    assert darkest < 200 < 4000 < brightest
    session.verify()


def test_a_camera_unplugged_in_the_middle_costs_nothing(aravis, bench, stack, small_configuration, tmp_path):
    """On the real protocol: the camera vanishes after three frames; a second run takes only the rest."""
    path = tmp_path / "s"
    meter = stack.enter_context(MinoltaLS110(stack.enter_context(bench.pty_meter(0)).port))
    server = bench.gige_camera().open()

    def unplug(progress):
        if (progress.step, progress.done) == ("light frames", 3):
            server.close()

    with (
        Session.create(path, small_configuration) as session,
        AravisCamera("127.0.0.1") as camera,
        pytest.raises(CameraLostError, match=r"stopped answering .*check power and cable, then open it again"),
    ):
        acquire(session, camera, meter, bench, unplug)
    with Session.open(path) as session:
        session.verify()
        # The fourth, of the same exposure, may have been on its way.
        assert counts(session) in ((3, 0, 0), (4, 0, 0))
    with Session.open(path, writable=True) as session, bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
        acquire(session, camera, meter, bench)
        session.verify()
        assert counts(session) == (6, 32, 6)


def test_settings_of_the_configuration_reach_the_camera_and_are_read_back(
    aravis, bench, stack, small_configuration, tmp_path
):
    features = {"StreamBytesPerSecond": 50_000_000, "BlackLevelAuto": "Off", "ReverseX": True, "Gamma": 1}
    wanted = {"black_level": 80.0, "frame_rate_hz": 40.0, "binning": (2, 2), "region": (2, 4, 200, 150)}
    camera_table = small_configuration.camera.model_copy(update={**wanted, "trigger": "Software", "features": features})
    patch = small_configuration.target.patches[0].model_copy(update={"roi": (20, 20, 30, 30)})
    target = small_configuration.target.model_copy(update={"patches": (patch,)})
    configuration = small_configuration.model_copy(update={"camera": camera_table, "target": target, "contrasts": ()})
    stack.enter_context(bench.gige_camera())
    meter = stack.enter_context(bench.in_process_meter(0))
    path = tmp_path / "s"
    with Session.create(path, configuration) as session, AravisCamera("127.0.0.1") as camera:
        acquire(session, camera, meter, Unattended())
        now = camera.settings
        assert (now.black_level, now.frame_rate_hz, now.readout.binning) == (80, pytest.approx(40, rel=1e-3), (2, 2))
        assert astuple(now.region) == wanted["region"]
        assert now.trigger == Trigger("Software")
        assert {name: camera.feature(name) for name in features} == features
        assert {session.load(record).shape for record in session.frames()} == {(150, 200)}
    with Session.open(path) as session:
        assert session.configuration == configuration
        (setup,) = [r.content for r in session.records if isinstance(r, EventRecord) and r.kind == "camera setup"]
    assert setup["features"] == features


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"binning": (9, 9)}, "binning of columns is 9: the camera takes 1 to 4"),
        ({"features": {"TriggerSource": "Software", "PixelFormat": "Mono8", "Width": 63.5}}, "takes a whole number"),
        # A later one changes an earlier one.
        ({"binning": (2, 2), "features": {"BinningHorizontal": 4}}, r"keeps binning at \(4, 2\), not \(2, 2\)"),
    ],
)
def test_settings_that_the_camera_does_not_keep_are_refused_before_the_first_frame(
    aravis, bench, stack, small_configuration, tmp_path, wanted, message
):
    camera_table = small_configuration.camera.model_copy(update=wanted)
    session = stack.enter_context(
        Session.create(tmp_path / "s", small_configuration.model_copy(update={"camera": camera_table}))
    )
    stack.enter_context(bench.gige_camera())
    camera = stack.enter_context(AravisCamera("127.0.0.1"))
    with pytest.raises(CameraSettingError, match=message):
        acquire(session, camera, stack.enter_context(bench.in_process_meter(0)), bench)
    assert counts(session) == (0, 0, 0)


@pytest.mark.parametrize(
    ("pixel_format", "black_dn"),
    [("Mono8", 3.56), ("Mono16", 1024.0)],
)
def test_the_black_level_is_measured_in_dn_of_the_pixel_format(
    aravis, bench, stack, small_configuration, tmp_path, pixel_format, black_dn
):
    """The register says 64 whatever the format is."""
    plan = small_configuration.plan.model_copy(update={"pixel_format": pixel_format})
    session = stack.enter_context(Session.create(tmp_path / "s", small_configuration.model_copy(update={"plan": plan})))
    meter = stack.enter_context(bench.in_process_meter(0))
    stack.enter_context(bench.gige_camera())
    camera = stack.enter_context(AravisCamera("127.0.0.1"))
    seen = []
    acquire(session, camera, meter, bench, lambda progress: seen.append(progress.live))
    assert camera.settings.black_level == 64
    last = [live for live in seen if live is not None][-1]
    assert last.role == "dark"
    # By the darkest patch of 900 pixels; the 8-bit converter cuts what it cannot show.
    for numbers in last.patches:
        assert numbers.black_dn == pytest.approx(black_dn, rel=0.06)
        assert abs(numbers.signal_dn) < 0.1 * black_dn


def test_troubles_of_the_meter_are_in_the_journal(bench, stack, small_configuration, tmp_path):
    session = stack.enter_context(Session.create(tmp_path / "s", small_configuration))
    camera = stack.enter_context(bench.in_process_camera())
    pty = stack.enter_context(bench.pty_meter(0))
    meter = stack.enter_context(MinoltaLS110(pty.port, timeout_s=1.0, attempts=2, patience_s=60))
    troubles = {2: lambda: pty.inject(Fault(reply=b"\x00?\r\n")), 4: pty.unplug, 6: lambda: pty.inject(*lost)}
    lost = [Fault(reply=b"ER30\r\n")]

    def disturb(progress):
        if progress.step == "meter readings" and progress.done in troubles:
            troubles.pop(progress.done)()
            if progress.done == 4:
                threading.Timer(0.5, pty.plug_in).start()

    with pytest.raises(MeterReportedError):
        acquire(session, camera, meter, bench, disturb)
    events = [r for r in session.records if isinstance(r, EventRecord) and r.kind.startswith("meter ")]
    assert [event.kind for event in events] == ["meter asked again", "meter lost and back", "meter error"]
    assert events[1].content["duration_s"] > 0.3
    assert "ER30" in events[2].content["reason"]
    assert counts(session) == (6, 6, 0)
    acquire(session, camera, meter, bench)
    assert counts(session) == (6, 32, 6)


def test_a_complete_session_asks_nothing_of_the_devices(small_configuration):
    with Session.open(example_session()) as session:
        before = len(session.records)
        with ReplayCamera(session) as camera, ReplayMeter(session) as meter:
            acquire(session, camera, meter, None)
        assert len(session.records) == before


def test_recorded_devices_repeat_a_session(small_configuration, tmp_path):
    """Acquisition from the replayed example gives the same pixels and readings, and uses all of them."""

    class Still:
        def cover_lens(self):
            pass

        uncover_lens = cover_lens

        def point_meter(self, patch):
            pass

    with Session.open(example_session()) as recorded, Session.create(tmp_path / "s", small_configuration) as session:
        with ReplayCamera(recorded) as camera, ReplayMeter(recorded) as meter:
            acquire(session, camera, meter, Still())
            assert not camera.unused
            assert not meter.unused
        for new, old in zip(session.frames(), recorded.frames(), strict=True):
            assert session.load(new).metadata() == recorded.load(old).metadata()
            assert (session.load(new).dn == recorded.load(old).dn).all()
        assert [r.reading for r in session.readings()] == [r.reading for r in recorded.readings()]
