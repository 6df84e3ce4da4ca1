"""Checks of an opened camera: control, stream settings, temperature, frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..aravis.camera import AravisCamera
from ..aravis.library import CameraInfo
from ..aravis.settings import layout_of
from ..camera import (
    Camera,
    CameraBusyError,
    CameraError,
    CameraSettings,
    FeatureValue,
    IncompleteFrameError,
    StreamStatistics,
)
from ..host.finding import Finding
from ..host.network import GIGABIT_MBIT_S, Interface, interface_to, network_finding
from ..host.stream import packet_size_finding
from ..host.units import size

#: Number of test frames.
N_FRAMES = 5
#: Exposure of these frames, within the camera's range.
_EXPOSURE_S = 0.01

#: Device temperature above which a notice is given. A camera without heat sink at 22.5 degC reaches 50 degC inside
#: (SMARTEK Vision, twentynine user manual 1.0.2, figure 4); 10 degC more is our choice. Data sheets allow different
#: temperatures.
WARM_C = 60.0

#: Bytes of a stream packet that carry no pixels: headers of IP (20), UDP (8) and GVSP (8).
_HEADERS_BYTES = 36
#: Ethernet overhead of an IP packet on the wire: preamble (8), header (14), checksum (4) and gap (12).
_ETHERNET_BYTES = 38

#: Features that limit the stream, in bytes per second: Allied Vision's name and that of the SFNC.
_BANDWIDTH_FEATURES = ("StreamBytesPerSecond", "DeviceLinkThroughputLimit")


@dataclass(frozen=True)
class CameraFacts:
    """State of an opened camera.

    Parameters
    ----------
    address : str
        Network address; empty if it is not on a network.
    interface : Interface or None
        Interface that leads to it, if known.
    settings : CameraSettings
        In force.
    features : mapping
        Its GenICam features by name.
    temperature_c : float or None
        Of the device.
    statistics : StreamStatistics
        Counters after the frames.
    came, refused : int
        Numbers of complete and incomplete frames.
    problem : CameraError or None
        Error that ended the frames early.
    """

    address: str
    interface: Interface | None
    settings: CameraSettings
    features: Mapping[str, FeatureValue]
    temperature_c: float | None
    statistics: StreamStatistics
    came: int = N_FRAMES
    refused: int = 0
    problem: CameraError | None = None

    @property
    def payload_bytes(self) -> int:
        """Bytes of a frame."""
        return layout_of(self.settings).payload_bytes(self.settings.width * self.settings.height)

    @property
    def packet_bytes(self) -> int | None:
        """Bytes of a stream packet, headers included."""
        value = self.number("GevSCPSPacketSize")
        return None if value is None or value < 1 else int(value)

    def number(self, name: str) -> float | None:
        """Return a feature that is a number."""
        value = self.features.get(name)
        return None if value is None or isinstance(value, str | bool) else float(value)


def check_camera(info: CameraInfo, known: Sequence[Interface], timeout_s: float | None = None) -> list[Finding]:
    """Open a camera, take some frames with it, and close it again.

    Parameters
    ----------
    info : CameraInfo
        As discovered.
    known : sequence of Interface
        The computer's.
    timeout_s : float or None
        Longest wait for a frame beyond its exposure, as of `AravisCamera.grab`.

    Returns
    -------
    list of Finding
        Errors of the camera are returned as findings.
    """
    on_network = info.protocol == "GigEVision"
    address = info.address if on_network else ""
    try:
        with AravisCamera(info.serial or info.address) as camera:
            facts = camera_facts(camera, address, known, timeout_s)
    except CameraBusyError as error:
        return [Finding.of_error("controller", error), *_network(address, interface_to(address, known))]
    except CameraError as error:
        return [Finding.of_error("camera", error), *_network(address, interface_to(address, known))]
    return camera_findings(facts)


def camera_facts(camera: Camera, address: str, known: Sequence[Interface], timeout_s: float | None) -> CameraFacts:
    """Read an opened camera and take some frames; its exposure is restored afterwards."""
    before = camera.settings
    shortest_s, longest_s = camera.exposure_range_s
    camera.configure(exposure_s=min(max(_EXPOSURE_S, shortest_s), longest_s))
    refused: list[IncompleteFrameError] = []

    def refuse(error: IncompleteFrameError) -> None:
        refused.append(error)
        if len(refused) == N_FRAMES:
            raise error

    came, problem = 0, None
    try:
        for _ in camera.grab(N_FRAMES, timeout_s, refuse):
            came += 1
    except CameraError as error:
        problem = error
    statistics = camera.statistics
    settings = camera.configure(exposure_s=before.exposure_s)
    return CameraFacts(
        address=address,
        interface=interface_to(address, known),
        settings=settings,
        features=camera.features(),
        temperature_c=camera.temperature_c,
        statistics=statistics,
        came=came,
        refused=len(refused),
        problem=problem,
    )


def camera_findings(facts: CameraFacts) -> list[Finding]:
    """Evaluate an opened camera."""
    optional = [_link(facts), _bandwidth(facts), _need(facts), _temperature(facts)]
    return [
        Finding("controller", "good", "this program could take control of it"),
        *_network(facts.address, facts.interface),
        *_packets(facts),
        *(finding for finding in optional if finding is not None),
        _frames(facts),
    ]


def _network(address: str, interface: Interface | None) -> list[Finding]:
    if not address:
        return []
    if interface is None:
        return [Finding("network", "unknown", f"no interface of this computer is known to lead to {address}")]
    reached = f"{address} is reached by {interface.name} ({interface.address})"
    return [network_finding(address, interface) or Finding("network", "good", reached)]


def _packets(facts: CameraFacts) -> list[Finding]:
    packet, interface = facts.packet_bytes, facts.interface
    if packet is None or interface is None:
        return []
    too_large = packet_size_finding(packet, interface)
    if too_large is not None:
        return [too_large]
    text = f"packets of {packet} bytes, and {interface.name} takes {interface.mtu_bytes}"
    # Half of the possible size: a negotiated size slightly below the MTU is as good.
    if not interface.is_loopback and packet < interface.mtu_bytes / 2:
        remedy = "check that the camera and every switch between take jumbo frames"
        return [Finding("packet size", "notice", f"{text}: small packets cost computing time", remedy)]
    return [Finding("packet size", "good", text)]


def _link(facts: CameraFacts) -> Finding | None:
    # GigE Vision counts in Mbit/s, the SFNC's newer name in bytes per second.
    speed, newer = facts.number("GevLinkSpeed"), facts.number("DeviceLinkSpeed")
    speed = newer * 8e-6 if speed is None and newer is not None else speed
    if not speed:
        return None
    text = f"the camera's link runs at {speed:g} Mbit/s"
    if speed < GIGABIT_MBIT_S:
        remedy = "use a cable of category 5e or better, and a gigabit port at its other end"
        return Finding("link speed", "notice", text, remedy)
    return Finding("link speed", "good", text)


def _limit(facts: CameraFacts) -> tuple[str, float] | None:
    for name in _BANDWIDTH_FEATURES:
        value = facts.number(name)
        if value:
            return name, value
    return None


def _carried(facts: CameraFacts) -> float | None:
    """Capacity of the computer's interface for stream packets, in bytes per second."""
    interface = facts.interface
    if interface is None or interface.speed_mbit_s is None:
        return None
    packet = facts.packet_bytes or interface.mtu_bytes
    return interface.speed_mbit_s * 1e6 / 8 * packet / (packet + _ETHERNET_BYTES)


def _bandwidth(facts: CameraFacts) -> Finding | None:
    """Compare the camera's bandwidth limit with the link."""
    limit, carried = _limit(facts), _carried(facts)
    if limit is None or carried is None:
        return None
    text = f"{limit[0]} is {size(limit[1])}/s, and the computer's interface carries {size(carried)}/s"
    if limit[1] > carried:
        return Finding("bandwidth", "notice", text, f"set the camera's {limit[0]} to {carried * 0.95:.0f}")
    return Finding("bandwidth", "good", text)


def _need(facts: CameraFacts) -> Finding | None:
    """Compare the required bandwidth with the link and the camera's limit."""
    rate, limit, carried = facts.settings.frame_rate_hz, _limit(facts), _carried(facts)
    tightest = min((value for value in (limit and limit[1], carried) if value is not None), default=None)
    if rate is None or tightest is None:
        return None
    packet = facts.packet_bytes or 1500
    per_frame = facts.payload_bytes * packet / max(1, packet - _HEADERS_BYTES)
    settings = facts.settings
    text = (
        f"{settings.width} x {settings.height} pixels of {settings.pixel_format} at {rate:.4g} frames/s need "
        f"{size(per_frame * rate)}/s of {size(tightest)}/s"
    )
    if per_frame * rate > tightest:
        remedy = f"lower the frame rate to {tightest / per_frame:.3g} frames/s, or take fewer pixels or bits"
        return Finding("frame rate", "notice", text, remedy)
    return Finding("frame rate", "good", text)


def _temperature(facts: CameraFacts) -> Finding | None:
    temperature_c = facts.temperature_c
    if temperature_c is None:
        return None
    text = f"the camera is at {temperature_c:.1f} degC"
    if temperature_c > WARM_C:
        remedy = "mount it on metal that carries the heat away, and compare with its data sheet"
        return Finding("temperature", "notice", f"{text}, which adds dark current and noise", remedy)
    return Finding("temperature", "good", text)


def _frames(facts: CameraFacts) -> Finding:
    statistics = facts.statistics
    counters = f"{statistics.missing} packets missing, {statistics.resent} sent again, {statistics.underruns} underruns"
    text = f"{facts.came} of {N_FRAMES} frames came whole, {facts.refused} incomplete ({counters})"
    if facts.problem is not None:
        found = Finding.of_error("frames", facts.problem)
        return Finding("frames", "fault", f"{text}; {found.cause}", found.remedy)
    if facts.refused:
        remedy = "see receive buffer and packet size, check the cable, or lower the frame rate"
        return Finding("frames", "notice", text, remedy)
    return Finding("frames", "good", text)
