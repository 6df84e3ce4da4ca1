"""What the link to a camera carries: frames per second of a pixel format, and what would fit instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...core.dn import PIXEL_FORMATS
from ...core.errors import InputError
from ...session import SessionConfiguration
from ..check import Check
from ..device import size

#: Bytes of a stream packet that carry no pixels: headers of IP (20), UDP (8) and GVSP (8).
HEADERS_BYTES = 36
#: Ethernet overhead of an IP packet on the wire: preamble (8), header (14), checksum (4) and gap (12).
ETHERNET_BYTES = 38


@dataclass(frozen=True)
class PlannedStream:
    """Frames that a plan asks for; None takes what the camera has.

    Parameters
    ----------
    pixel_format : str
        GenICam PFNC name.
    frame_rate_hz : float or None
        Frames per second.
    shape : (int, int) or None
        Height and width in pixels.
    """

    pixel_format: str
    frame_rate_hz: float | None = None
    shape: tuple[int, int] | None = None


def planned_stream(configuration: SessionConfiguration) -> PlannedStream:
    """Return the frames that a configuration asks for.

    Examples
    --------
    >>> from labcdp.drivers.doctor.link import planned_stream
    >>> from labcdp.session import SessionConfiguration, example_configuration
    >>> planned_stream(SessionConfiguration.from_toml(example_configuration(), "example")).pixel_format
    'Mono12'
    """
    camera = configuration.camera
    shape = None if camera.region is None else (camera.region[3], camera.region[2])
    return PlannedStream(configuration.plan.pixel_format, camera.frame_rate_hz, shape)


def carried_bytes_per_s(packet_bytes: float, speed_mbit_s: float) -> float:
    """Bytes of pixels that a link carries per second in packets of a size, headers of IP and above included.

    Examples
    --------
    Gigabit Ethernet with an MTU of 1500 and of 9000 bytes, in MB/s:

    >>> from labcdp.drivers.doctor.link import carried_bytes_per_s
    >>> [round(carried_bytes_per_s(mtu, 1000) / 1e6, 1) for mtu in (1500, 9000)]
    [119.0, 124.0]
    """
    return speed_mbit_s * 1e6 / 8 * max(1.0, packet_bytes - HEADERS_BYTES) / (packet_bytes + ETHERNET_BYTES)


def frame_rate_hz(pixel_format: str, shape: tuple[int, int], bytes_per_s: float) -> float:
    """Most frames per second of a format and size at so many bytes of pixels per second.

    Raises
    ------
    InputError
        If the format is not known.

    Examples
    --------
    >>> from labcdp.drivers.doctor.link import carried_bytes_per_s, frame_rate_hz
    >>> gige = carried_bytes_per_s(1500, 1000)
    >>> [round(frame_rate_hz(name, (2056, 2452), gige), 1) for name in ("Mono12", "Mono12Packed", "Mono8")]
    [11.8, 15.7, 23.6]
    """
    if pixel_format not in PIXEL_FORMATS:
        raise InputError(f"the pixel format {pixel_format!r} is not known: give one of {', '.join(PIXEL_FORMATS)}")
    return bytes_per_s / PIXEL_FORMATS[pixel_format].payload_bytes(shape[0] * shape[1])


def plan_check(
    planned: PlannedStream,
    shape: tuple[int, int],
    rate_hz: float | None,
    bytes_per_s: float,
    offered: Sequence[str] = (),
) -> Check | None:
    """Compare what a plan asks for with what the link carries, and name what would fit.

    Parameters
    ----------
    planned : PlannedStream
        Of the plan.
    shape : (int, int)
        Height and width of the camera's frames, if the plan states none.
    rate_hz : float or None
        Frames per second of the camera, if the plan states none.
    bytes_per_s : float
        Bytes of pixels that the link carries, or the camera's limit if that is less.
    offered : sequence of str
        Pixel formats of the camera.

    Returns
    -------
    Check or None
        None if the format is not known here; opening the camera says so.
    """
    height, width = planned.shape or shape
    wanted_hz = planned.frame_rate_hz or rate_hz
    if planned.pixel_format not in PIXEL_FORMATS or wanted_hz is None:
        return None
    layout = PIXEL_FORMATS[planned.pixel_format]
    most_hz = frame_rate_hz(planned.pixel_format, (height, width), bytes_per_s)
    frame_bytes = layout.payload_bytes(height * width)
    text = (
        f"the plan asks for {width} x {height} pixels of {planned.pixel_format} at {wanted_hz:.4g} frames/s, "
        f"{size(frame_bytes * wanted_hz)}/s, and the link carries {size(bytes_per_s)}/s of pixels: "
        f"{most_hz:.3g} frames/s"
    )
    if wanted_hz <= most_hz:
        return Check("plan", "good", text)
    kind = layout.bit_depth, layout.colour_filter
    known = {name: PIXEL_FORMATS[name] for name in offered if name in PIXEL_FORMATS}
    same_kind = [name for name, other in known.items() if (other.bit_depth, other.colour_filter) == kind]
    rates = {name: frame_rate_hz(name, (height, width), bytes_per_s) for name in same_kind}
    fitting = {name: hz for name, hz in rates.items() if hz > most_hz}
    formats = [f'pixel_format = "{name}" ({hz:.3g} frames/s)' for name, hz in fitting.items()][:1]
    rows = int(height * most_hz / wanted_hz)
    remedies = [*formats, f"frame_rate_hz = {_below(most_hz)} in [camera]", f"a region of at most {rows} rows"]
    return Check("plan", "notice", text, f"give {', or '.join(remedies)}")


def _below(rate_hz: float) -> str:
    """Return a rate of three digits that is not above a rate."""
    text = f"{rate_hz:.3g}"
    return text if float(text) <= rate_hz else f"{rate_hz * 0.995:.3g}"
