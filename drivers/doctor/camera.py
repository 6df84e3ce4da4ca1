"""Checks of an opened camera: control, stream settings, temperature, frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace

from ..aravis import gvcp
from ..aravis.camera import AravisCamera
from ..aravis.chunks import ChunkData
from ..aravis.connection import restore_snapshot, take_snapshot
from ..aravis.features import available, read_feature, readable_features, writable, write_feature
from ..aravis.frames import NOT_AS_SET
from ..aravis.library import CameraInfo
from ..aravis.link import Link, connect
from ..aravis.settings import layout_of, read_settings, temperature_c
from ..camera import CameraBusyError, CameraError, IncompleteFrameError, StreamStatistics
from ..camera_settings import CameraSettings, FeatureValue
from ..check import Check
from ..device import size
from ..network import (
    GIGABIT_MBIT_S,
    Interface,
    interface_to,
    network_check,
    packet_size_check,
    path_check,
    resend_check,
)
from .link import ETHERNET_BYTES, HEADERS_BYTES, PlannedStream, carried_bytes_per_s, plan_check

#: Number of test frames, and their exposure, within the camera's range.
N_FRAMES = 5
_EXPOSURE_S = 0.01

#: Device temperature above which a notice is given. A camera without heat sink at 22.5 °C reaches 50 °C inside
#: (SMARTEK Vision, twentynine user manual 1.0.2, figure 4); 10 °C more is our choice. Data sheets allow different
#: temperatures.
WARM_C = 60.0

#: Size of a packet where neither camera nor interface tell.
_SMALL_PACKET_BYTES = 1500

#: Features that limit the stream, in bytes per second: Allied Vision's name and that of the SFNC.
_BANDWIDTH_FEATURES = ("StreamBytesPerSecond", "DeviceLinkThroughputLimit")


@dataclass(frozen=True)
class CameraFacts:
    """State of an opened camera.

    Parameters
    ----------
    settings : CameraSettings
        In force.
    features : mapping
        Its GenICam features by name.
    temperature_c : float or None
        Of the device.
    address : str
        Network address; empty if it is not on a network.
    interface : Interface or None
        Interface that leads to it, if known.
    statistics : StreamStatistics
        Counters after the frames.
    came : int or None
        Number of complete frames; None if none were taken.
    refused : int
        Number of incomplete frames.
    problem : CameraError or None
        Error that ended the frames early.
    formats : tuple of str
        Pixel formats of the camera.
    path_bytes : int or None
        Largest packet that came through; None if no test packet was sent.
    planned : PlannedStream or None
        Frames that a plan asks for.
    chunk_data : ChunkData
        Values that came with the last frame.
    """

    settings: CameraSettings
    features: Mapping[str, FeatureValue]
    temperature_c: float | None
    address: str = ""
    interface: Interface | None = None
    statistics: StreamStatistics = field(default_factory=StreamStatistics)
    came: int | None = None
    refused: int = 0
    problem: CameraError | None = None
    formats: tuple[str, ...] = ()
    path_bytes: int | None = None
    planned: PlannedStream | None = None
    chunk_data: ChunkData = field(default_factory=ChunkData)

    def number(self, name: str) -> float | None:
        """Return a feature that is a number and not 0; None without it."""
        value = self.features.get(name)
        return None if not value or isinstance(value, str | bool) else float(value)


def check_camera(
    info: CameraInfo, known: Sequence[Interface], *, stream: bool = False, planned: PlannedStream | None = None
) -> list[Check]:
    """Open a camera, read it, and close it again; its errors are returned as findings.

    Parameters
    ----------
    info : CameraInfo
        As discovered.
    known : sequence of Interface
        The computer's.
    stream : bool
        Whether to take some frames, with the settings of `AravisCamera`; those found are restored. Without,
        nothing is written to the camera.
    planned : PlannedStream or None
        Frames that a plan asks for.
    """
    address = info.address if info.protocol == "GigEVision" else ""
    interface = _way_to(info, known) if address else None
    try:
        with closing(connect(info, prepare=False)) as link:
            with link.using("it cannot be read") as camera:
                facts = CameraFacts(read_settings(camera), dict(readable_features(camera)), temperature_c(camera))
                facts = replace(facts, formats=tuple(camera.dup_available_pixel_formats_as_strings()))
            before = (take_snapshot(link, stream=True), _trigger_modes(link)) if stream else None
        if before is not None:
            try:
                facts = _streamed(info, facts)
            finally:
                with closing(connect(info, prepare=False)) as link:
                    _restore_trigger_modes(link, before[1])
                    restore_snapshot(link, before[0])
    except CameraError as error:
        topic = "controller" if isinstance(error, CameraBusyError) else "camera"
        return [Check.failed(topic, error), *_network(address, interface)]
    return camera_checks(replace(facts, address=address, interface=interface, planned=planned))


def _way_to(info: CameraInfo, known: Sequence[Interface]) -> Interface | None:
    """Return the interface that leads to a camera; if it is in no network of this computer, that where it answers."""
    route = interface_to(info.address, known)
    if route is not None and network_check(info.address, route) is None:
        return route
    for interface in known:
        with suppress(OSError):
            if not interface.is_loopback and any(
                seen.serial == info.serial for seen in gvcp.announce_all(interface.name)
            ):
                return interface
    return route


def _trigger_modes(link: Link) -> dict[str, FeatureValue]:
    """Read the mode of every trigger that the camera can select."""
    modes: dict[str, FeatureValue] = {}
    with link.using("its triggers cannot be read") as camera:
        if available(camera, "TriggerMode") is None or not writable(camera, "TriggerSelector"):
            return modes
        selected = read_feature(camera, "TriggerSelector")
        for trigger in camera.dup_available_enumerations_as_strings("TriggerSelector"):
            write_feature(camera, "TriggerSelector", trigger)
            modes[trigger] = read_feature(camera, "TriggerMode")
        write_feature(camera, "TriggerSelector", selected)
    return modes


def _restore_trigger_modes(link: Link, modes: Mapping[str, FeatureValue]) -> None:
    """Write the modes of `_trigger_modes`; the selection is left at the last one."""
    with link.using("its triggers cannot be restored") as camera:
        for trigger, mode in modes.items():
            write_feature(camera, "TriggerSelector", trigger)
            if read_feature(camera, "TriggerMode") != mode:
                write_feature(camera, "TriggerMode", mode)


def _streamed(info: CameraInfo, facts: CameraFacts) -> CameraFacts:
    """Take some frames."""
    refused: list[IncompleteFrameError] = []
    came, problem = 0, None
    with AravisCamera(info.serial or info.address) as camera:
        shortest_s, longest_s = camera.exposure_range_s
        camera.configure(exposure_s=min(max(_EXPOSURE_S, shortest_s), longest_s))
        try:
            for _ in camera.grab(N_FRAMES, on_refused=refused.append):
                came += 1
        except CameraError as error:
            problem = error
        features, statistics = camera.features(), camera.statistics
        facts = replace(facts, settings=camera.settings, features=features, statistics=statistics)
        facts = replace(facts, path_bytes=camera.path_packet_bytes, chunk_data=camera.chunk_data)
        # The last of too many is raised instead of reported.
        n_refused = len(refused) + isinstance(problem, IncompleteFrameError)
        return replace(facts, came=came, refused=n_refused, problem=problem)


def camera_checks(facts: CameraFacts) -> list[Check]:
    """Evaluate an opened camera."""
    optional = [_packets(facts), _link(facts), *_bandwidth(facts), _plan(facts), _temperature(facts.temperature_c)]
    optional += [path_check(facts.path_bytes, facts.interface), resend_check(facts.statistics), _chunks(facts)]
    return [
        Check("controller", "good", "this program could take control of it"),
        *_network(facts.address, facts.interface),
        *(finding for finding in optional if finding is not None),
        _frames(facts),
    ]


def _network(address: str, interface: Interface | None) -> list[Check]:
    if not address:
        return []
    if interface is None:
        return [Check("network", "unknown", f"no interface of this computer is known to lead to {address}")]
    reached = f"{address} is reached by {interface.name} ({interface.address})"
    return [network_check(address, interface) or Check("network", "good", reached)]


def _packets(facts: CameraFacts) -> Check | None:
    packet, interface = facts.number("GevSCPSPacketSize"), facts.interface
    if packet is None or interface is None:
        return None
    text = f"packets of {packet:.0f} bytes, and {interface.name} takes {interface.mtu_bytes}"
    # Half of the possible size: a negotiated size slightly below the MTU is as good.
    small = not interface.is_loopback and packet < interface.mtu_bytes / 2
    remedy = "check that the camera and every switch between take jumbo frames" if small else None
    text += ": small packets cost computing time" if small else ""
    return packet_size_check(int(packet), interface) or Check.judged("packet size", text, remedy)


def _link(facts: CameraFacts) -> Check | None:
    # GigE Vision counts in Mbit/s, the SFNC's newer name in bytes per second.
    speed = facts.number("GevLinkSpeed") or (facts.number("DeviceLinkSpeed") or 0.0) * 8e-6
    if not speed:
        return None
    remedy = "use a cable of category 5e or better, and a gigabit port at its other end"
    text = f"the camera's link runs at {speed:g} Mbit/s"
    return Check.judged("link speed", text, remedy if speed < GIGABIT_MBIT_S else None)


def _bandwidth(facts: CameraFacts) -> list[Check]:
    """Compare the camera's bandwidth limit and what its frames need with the capacity of the link for packets."""
    settings, interface, rate_hz = facts.settings, facts.interface, facts.settings.frame_rate_hz
    limit = next(((name, value) for name in _BANDWIDTH_FEATURES if (value := facts.number(name))), None)
    carried, packet, checks = None, facts.number("GevSCPSPacketSize"), []
    if interface is not None and interface.speed_mbit_s is not None:
        packet = packet or interface.mtu_bytes
        carried = interface.speed_mbit_s * 1e6 / 8 * packet / (packet + ETHERNET_BYTES)
    if limit is not None and carried is not None:
        text = f"{limit[0]} is {size(limit[1])}/s, and the computer's interface carries {size(carried)}/s"
        remedy = f"set the camera's {limit[0]} to {carried * 0.95:.0f}"
        checks.append(Check.judged("bandwidth", text, remedy if limit[1] > carried else None))
    tightest = min((value for value in (limit and limit[1], carried) if value is not None), default=None)
    if rate_hz is not None and tightest is not None:
        packet = packet or _SMALL_PACKET_BYTES
        payload = facts.number("PayloadSize") or layout_of(settings).payload_bytes(settings.width * settings.height)
        per_frame = payload * packet / max(1, packet - HEADERS_BYTES)
        text = (
            f"{settings.width} x {settings.height} pixels of {settings.pixel_format} at {rate_hz:.4g} frames/s need "
            f"{size(per_frame * rate_hz)}/s of {size(tightest)}/s"
        )
        remedy = f"lower the frame rate to {tightest / per_frame:.3g} frames/s, or take fewer pixels or bits"
        checks.append(Check.judged("frame rate", text, remedy if per_frame * rate_hz > tightest else None))
    return checks


def _plan(facts: CameraFacts) -> Check | None:
    """Compare what a plan asks for with what the link carries; without a known speed, with Gigabit Ethernet."""
    if facts.planned is None:
        return None
    interface, settings = facts.interface, facts.settings
    speed = None if interface is None else interface.speed_mbit_s
    packet = facts.number("GevSCPSPacketSize") or _SMALL_PACKET_BYTES
    carried = carried_bytes_per_s(packet, speed or GIGABIT_MBIT_S)
    limits = [value for name in _BANDWIDTH_FEATURES if (value := facts.number(name))]
    whole = [facts.number(name) for name in ("HeightMax", "WidthMax")]
    height, width = whole if facts.planned.shape is None else facts.planned.shape
    shape = (int(height or settings.height), int(width or settings.width))
    return plan_check(facts.planned, shape, settings.frame_rate_hz, min([carried, *limits]), facts.formats)


def _chunks(facts: CameraFacts) -> Check | None:
    """State what the camera says of each frame; None where it says nothing, or frames were refused for it."""
    data, problem = facts.chunk_data, facts.problem
    if isinstance(problem, IncompleteFrameError) and problem.status == NOT_AS_SET:
        return None
    values = {
        "exposure time": None if data.exposure_us is None else f"{data.exposure_us * 1e-3:.6g} ms",
        "gain": None if data.gain_db is None else f"{data.gain_db:.4g} dB",
        "timestamp": data.timestamp,
        "frame counter": data.counter,
    }
    sent = ", ".join(f"{name} {value}" for name, value in values.items() if value is not None)
    return Check("chunk data", "good", f"each frame comes with {sent}, compared with what is set") if sent else None


def _temperature(temperature_c: float | None) -> Check | None:
    if temperature_c is None:
        return None
    warm = temperature_c > WARM_C
    text = f"the camera is at {temperature_c:.1f} °C{', which adds dark current and noise' if warm else ''}"
    remedy = "mount it on metal that carries the heat away, and compare with its data sheet"
    return Check.judged("temperature", text, remedy if warm else None)


def _frames(facts: CameraFacts) -> Check:
    statistics = facts.statistics
    if facts.came is None:
        return Check("frames", "unknown", "no frames were taken", "run labcdp doctor --stream-test SERIAL to take some")
    counters = f"{statistics.missing} packets missing, {statistics.resent} sent again, {statistics.underruns} underruns"
    text = f"{facts.came} of {N_FRAMES} frames arrived complete, {facts.refused} incomplete ({counters})"
    if facts.problem is not None:
        return Check("frames", "fault", f"{text}; {facts.problem.cause}", facts.problem.remedy)
    remedy = "check the receive buffer, packet size and cable, or lower the frame rate"
    return Check.judged("frames", text, remedy if facts.refused else None)
