"""Acquisitions over GigE Vision and a serial line, and from recorded devices."""

import threading
from contextlib import contextmanager
from dataclasses import astuple

import pytest

from labcdp.acquire import Unattended, remaining
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import CameraSettingError
from labcdp.drivers.camera_settings import Trigger
from labcdp.drivers.meter import MeterReportedError
from labcdp.drivers.minolta.ls import MinoltaLS110
from labcdp.drivers.simulated.bench import SimulatedBench, SimulatedDevices
from labcdp.drivers.simulated.port import Fault
from labcdp.session import Session

from .conftest import SHAPE, Bench


@pytest.fixture
def on_the_wire(aravis, tmp_path):
    """Open a session, a camera and a meter on the real protocols; what serves them is theirs."""

    @contextmanager
    def opened(configuration, **of_the_meter):
        bench, path = SimulatedBench(configuration, SimulatedDevices.standard(), SHAPE), tmp_path / "s"
        with (
            Session.open(path, True) if path.exists() else Session.create(path, configuration) as session,
            bench.gige_camera() as server,
            AravisCamera("127.0.0.1") as camera,
            bench.pty_meter(0) as pty,
            MinoltaLS110(pty.port, **of_the_meter) as meter,
        ):
            on = Bench(session, bench, camera, meter, None)
            on.server, on.pty = server, pty
            yield on

    return opened


@pytest.mark.parametrize(("pixel_format", "black_dn", "full_dn"), [("Mono8", 3.56, 255), ("Mono16", 1024.0, 65520)])
def test_a_run_records_the_plan_with_the_black_level_in_dn_of_the_pixel_format(
    changed, on_the_wire, pixel_format, black_dn, full_dn
):
    """The register says 64 whatever the format is."""
    with on_the_wire(changed(plan={"pixel_format": pixel_format})) as on:
        seen = []
        on.acquire(report=seen.append)
        assert on.counts == (6, 32, 6)
        assert remaining(on.session).complete
        dark, light = (max(on.session.load(r).dn.max() for r in on.session.frames(role)) for role in ("dark", "light"))
        assert 20 * dark < full_dn
        assert light >= 0.99 * full_dn
        assert on.camera.settings.black_level == 64
        # By the darkest patch of 3600 pixels; the 8-bit converter cuts what it cannot show.
        for numbers in [p.live for p in seen if p.live is not None and p.live.role == "dark"][-1].patches:
            assert numbers.black_dn == pytest.approx(black_dn, rel=0.06)
            assert abs(numbers.signal_dn) < 0.1 * black_dn


def test_settings_of_the_configuration_reach_the_camera_and_are_read_back(changed, on_the_wire):
    features = {"StreamBytesPerSecond": 50_000_000, "BlackLevelAuto": "Off", "ReverseX": True, "Gamma": 1}
    wanted = {"black_level": 80.0, "frame_rate_hz": 40.0, "binning": (2, 2), "region": (2, 4, 200, 150)}
    configuration = changed(["P01"], camera={**wanted, "trigger": "Software", "features": features})
    with on_the_wire(configuration) as on:
        on.acquire(Unattended())
        now = on.camera.settings
        assert (now.black_level, now.frame_rate_hz, now.readout.binning) == (80, pytest.approx(40, rel=1e-3), (2, 2))
        assert (astuple(now.region), now.trigger) == (wanted["region"], Trigger("Software"))
        assert {name: on.camera.feature(name) for name in features} == features
        assert {on.session.load(record).shape for record in on.session.frames()} == {(150, 200)}
        assert on.events("camera setup")[0]["features"] == features
        assert Session.open(on.session.path).configuration == configuration


def test_a_setting_that_the_camera_does_not_keep_is_refused_before_the_first_frame(changed, on_the_wire):
    # A later one changes an earlier one.
    with on_the_wire(changed(camera={"binning": (2, 2), "features": {"BinningHorizontal": 4}})) as on:
        with pytest.raises(CameraSettingError, match=r"keeps binning at \(4, 2\), not \(2, 2\)"):
            on.acquire()
        assert on.counts == (0, 0, 0)


def test_troubles_of_the_meter_are_in_the_journal(changed, on_the_wire):
    with on_the_wire(changed(), timeout_s=10.0, attempts=2, patience_s=60) as on:
        troubles = {
            2: lambda: on.pty.inject(Fault(reply=b"\x00?\r\n")),
            4: lambda: (on.pty.unplug(), threading.Timer(0.5, on.pty.plug_in).start()),
            6: lambda: on.pty.inject(Fault(reply=b"ER30\r\n")),
        }

        def disturb(progress):
            if progress.step == "meter readings":
                troubles.pop(progress.done, lambda: None)()

        with pytest.raises(MeterReportedError):
            on.acquire(report=disturb)
        _, (back,), (error,) = map(on.events, ("meter asked again", "meter lost and back", "meter error"))
        assert back["duration_s"] > 0.3
        assert "ER30" in error["reason"]
        assert on.counts == (6, 6, 0)
        on.acquire()
        assert on.counts == (6, 32, 6)
