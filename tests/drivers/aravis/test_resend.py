"""Packets that come again, rightly or not, and packets that a switch does not take, on a simulated camera's wire."""

import socket
from ipaddress import IPv4Interface
from itertools import pairwise

import numpy as np
import pytest

from labcdp.drivers.aravis import transport
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.packet_size import path_packet_bytes
from labcdp.drivers.camera import IncompleteFrameError
from labcdp.drivers.camera_settings import CameraSetup
from labcdp.drivers.network import Interface, resend_check
from labcdp.drivers.simulated.commands import RESEND_KINDS
from labcdp.drivers.simulated.gige_camera import SimulatedDevice, SimulatedGigECamera

from ..conftest import Ramp

#: Frames of 26 packets.
WIDTH, HEIGHT = 400, 90
DEVICE = SimulatedDevice("SIM-1", width=WIDTH, height=HEIGHT, black_level_dn=7, frame_rate_hz=50)


class Rows(Ramp):
    """Frames whose pixels are the number of their row, so that pixels in a wrong place are seen."""

    def expose(self, exposure_s, gain_db, key):
        return np.repeat(np.arange(self.shape[0], dtype=np.uint16)[:, None], self.shape[1], axis=1)


@pytest.fixture
def sender(aravis):
    with SimulatedGigECamera(DEVICE, Rows((HEIGHT, WIDTH))) as camera:
        yield camera


def received(sender, kind, n=30, share=0.02, **options):
    """Frames, how many of them are damaged, how many were refused, and the counters of a stream with lost packets."""
    sender.set_faults({"resend": float(RESEND_KINDS.index(kind))})
    refused = []
    with AravisCamera(sender.address, **options) as camera:
        camera.configure(exposure_s=1e-3, pixel_format="Mono12")
        sender.set_faults({"resend": float(RESEND_KINDS.index(kind)), "lose": share})
        right = np.arange(HEIGHT, dtype=np.uint16)[:, None]
        damaged = sum(bool((frame.dn != right).any()) for frame in camera.grab(n, on_refused=refused.append))
        return damaged, len(refused), camera.statistics


def test_packets_that_come_again_rightly_complete_their_frames(sender):
    damaged, _, counted = received(sender, "right")
    assert damaged == 0
    assert counted.requested > 0
    assert counted.resent > 0


def test_packets_with_the_number_of_another_put_stripes_into_complete_frames_and_are_found(sender, caplog):
    damaged, _, counted = received(sender, "wrong")
    assert damaged > 0
    check = resend_check(counted)
    assert check.topic == "resent packets"
    assert 'set packet_resend = "never" in [camera]' in check.remedy
    assert "may have stripes" in caplog.text


@pytest.mark.parametrize("kind", ["twice", "late"])
def test_packets_that_come_twice_or_late_are_found(sender, kind):
    damaged, _, counted = received(sender, kind)
    assert damaged == 0
    assert resend_check(counted) is not None


def test_never_asked_for_again_no_frame_has_stripes(sender):
    damaged, refused, counted = received(sender, "wrong", packet_resend="never")
    assert damaged == 0
    assert refused > 0
    assert (counted.requested, counted.resent) == (0, 0)
    assert resend_check(counted) is None


def test_it_is_a_setting_of_a_measurement(sender):
    sender.set_faults({"resend": float(RESEND_KINDS.index("wrong")), "lose": 0.3})
    with AravisCamera(sender.address) as camera:
        camera.prepare(CameraSetup(packet_resend="never"))
        with pytest.raises(IncompleteFrameError):
            list(camera.grab(5))
        assert camera.statistics.requested == 0


@pytest.mark.parametrize("switch_bytes", [1500, 4000, 9000, 16000])
def test_test_packets_find_what_a_switch_takes_and_leave_the_stream_as_it_was(sender, switch_bytes):
    sender.set_faults({"path": float(switch_bytes)})
    with AravisCamera(sender.address) as camera:
        before = camera.feature("GevSCPSPacketSize")
        with camera._connection.link.using("test packets") as opened:
            found = path_packet_bytes(opened, "127.0.0.1", 9000)
        assert switch_bytes - 4 < found <= min(switch_bytes, 9000) or found == 9000
        assert camera.feature("GevSCPSPacketSize") == before
        # As opening sets it where the path is not loopback.
        camera.set_feature("GevSCPSPacketSize", found)
        assert camera.snap().dn.shape == (HEIGHT, WIDTH)


def test_a_camera_without_test_packets_says_nothing(sender):
    with AravisCamera(sender.address) as camera, camera._connection.link.using("test packets") as opened:
        assert path_packet_bytes(opened, "127.0.0.1", 9000) is None


def test_no_socket_is_left(sender):
    sender.set_faults({"resend": 0.0, "path": 1500.0})
    sender.set_faults({})
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((sender.address, 0))
    assert (sender._resend, sender._path) == (None, None)


@pytest.mark.parametrize("packet_resend", ["always", "never"])
def test_frames_of_one_packet_come_on_where_their_ids_of_16_bits_run_over(aravis, packet_resend):
    """Aravis' simulator counts from about 65401."""
    device = SimulatedDevice("SIM-1", width=32, height=16, frame_rate_hz=400)
    with SimulatedGigECamera(device, Rows((16, 32))), AravisCamera("127.0.0.1", packet_resend=packet_resend) as camera:
        camera.configure(exposure_s=1e-4, pixel_format="Mono12")
        assert camera.feature("GevSCPSPacketSize") - 36 > 32 * 16 * 2
        ids = [frame.frame_id for frame in camera.grab(200)]
    assert ids[0] > ids[-1] > 0
    assert all(after == before % 0xFFFF + 1 for before, after in pairwise(ids))


@pytest.mark.parametrize(("switch_bytes", "size_bytes"), [(1500, 1500), (9000, 9000)])
def test_opening_takes_the_packets_that_a_switch_lets_through_and_names_it(
    sender, monkeypatch, caplog, switch_bytes, size_bytes
):
    """Loopback stands for an interface with jumbo frames, whose cameras are asked for test packets."""
    jumbo = Interface("eth0", IPv4Interface("127.0.0.1/8"), mtu_bytes=9000)
    monkeypatch.setattr(transport, "interface_to", lambda *_: jumbo)
    sender.set_faults({"path": float(switch_bytes)})
    with AravisCamera(sender.address) as camera:
        assert size_bytes - 4 <= camera.path_packet_bytes <= size_bytes
        assert camera.feature("GevSCPSPacketSize") == camera.path_packet_bytes
        right = np.arange(HEIGHT, dtype=np.uint16)[:, None]
        camera.configure(exposure_s=1e-3, pixel_format="Mono12")
        assert (camera.snap().dn == right).all()
    named = [record.message for record in caplog.records if "do not come through" in record.message]
    assert [text.startswith("packets above ") and "a switch between" in text for text in named] == (
        [True] if switch_bytes < 9000 else []
    )
