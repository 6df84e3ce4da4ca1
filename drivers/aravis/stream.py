"""Receiving frames through Aravis: one stream from the start of acquisition to its stop."""

from __future__ import annotations

import contextlib
import logging
import time
from typing import Any, NoReturn, Self

from ...core.frame import Frame
from ..camera import MOST_REFUSED, CameraError, FrameTimeoutError, Refused, StreamStatistics
from ..camera_settings import CameraSettings, PacketResend
from ..computer import enlarge_receive_buffer, may_open_packet_sockets, overload, raise_priority, threads_named
from ..device import on_error
from ..network import resend_check, stream_causes
from .chunks import REMEDY, ChunkCheck, ChunkData
from .frames import NOT_AS_SET, BufferPool, FrameCheck, arrival, gather_s, pool_size, refusal
from .library import aravis, received_bytes
from .link import Link
from .settings import layout_of, temperature_c
from .stream_filter import filtered_stream
from .transport import ask_neighbours, find_neighbours, set_up_transport

_log = logging.getLogger(__name__)

#: Silence after which a camera is checked, also during an exposure, and interval of the checks; also the latency for
#: noticing a close from another thread.
_ASKED_AFTER_S = 0.15

#: Time for other cameras to answer before each stream: those on a wire take a few milliseconds.
_LOOK_S = 0.05

#: Pause in the packets of a frame after which it is given up, in µs. With Aravis' default of 100 ms, frames were
#: incomplete when a busy computer did not run the sender or the receiver for that long.
_FRAME_RETENTION_US = 500_000

#: Age at which the temperature of the device is read again; it changes by less than 0.1 degrees C meanwhile.
_TEMPERATURE_EVERY_S = 2.0

#: Most causes named in an error.
_MOST_CAUSES = 2

#: Aravis' counters for `StreamStatistics`.
_COUNTERS = {
    "completed": "n_completed_buffers",
    "failed": "n_failures",
    "underruns": "n_underruns",
    "resent": "n_resent_packets",
    "missing": "n_missing_packets",
    "requested": "n_resend_requests",
    "duplicated": "n_duplicated_packets",
    "ignored": "n_ignored_packets",
}


class FrameStream:
    """One stream and its buffers; a context manager.

    Each stream has its own port and is created while the camera is stopped, so it receives no earlier frames.

    Parameters
    ----------
    link : Link
        Link to the camera, with its final settings.
    settings : CameraSettings
        In force.
    chosen : frozenset of str
        GenICam features set by the user, which must not be changed.
    n_frames : int
        Number of frames wanted.
    timeout_s : float or None
        As of `CameraSettings.longest_wait_s`.
    on_refused : callable or None
        Called for incomplete frames; None raises them.
    packet_resend : {'always', 'never'}
        Whether missing packets are asked for again.
    """

    def __init__(
        self,
        link: Link,
        settings: CameraSettings,
        chosen: frozenset[str],
        n_frames: int,
        timeout_s: float | None,
        on_refused: Refused | None,
        packet_resend: PacketResend = "always",
    ) -> None:
        self._packet_resend = packet_resend
        self._link = link
        self._settings = settings
        self._chosen = chosen
        self._n_frames = n_frames
        self._on_refused = on_refused
        self._layout = layout_of(settings)
        self._cleared = aravis().BufferStatus.CLEARED
        self._timeout_s = timeout_s
        self._gather_s = gather_s(settings, n_frames)
        self._wait_s = settings.longest_wait_s(timeout_s, overload())
        self._stream: Any = None
        self._pool: BufferPool | None = None
        self._counted = StreamStatistics()
        self._n_refused = 0
        self._known_causes: str | None = None
        self._granted_bytes: int | None = None
        self._temperature_c: float | None = None
        self._temperature_due_s = 0.0

    def __enter__(self) -> Self:
        with on_error(self.stop), self._link.using("no stream can be opened") as camera:
            self._start(camera)
        return self

    def _start(self, camera: Any) -> None:
        settings = self._settings
        is_gige = bool(camera.is_gv_device())
        self._check = FrameCheck(settings, self._layout, reserves_zero=is_gige)
        self._chunk_check = ChunkCheck(camera, settings)
        if is_gige:
            link = self._link
            # With those that were plugged in since.
            neighbours = ask_neighbours(link.neighbours | find_neighbours(link.info.address, _LOOK_S))
            link.neighbours = frozenset(neighbours)
            n_sharing = 1 + sum(neighbours.values())
            set_up_transport(camera, link.info.address, settings.frame_rate_hz, self._chosen, n_sharing)
        self._packet_bytes = camera.gv_get_packet_size() if is_gige else None
        self._payload_bytes = camera.get_payload()
        self._check.require_payload(self._payload_bytes)
        if is_gige:
            address, pixel_bytes = self._link.info.address, self._check.pixel_bytes
            self._stream = filtered_stream(camera, address, self._payload_bytes, pixel_bytes)
        else:
            self._stream = camera.create_stream(None, None)
        n_buffers = pool_size(self._payload_bytes, settings.frame_rate_hz, self._n_frames)
        typestr = self._layout.typestr
        shape = (self._payload_bytes,) if typestr is None else (settings.height, settings.width)
        self._pool = BufferPool(self._stream, n_buffers, self._payload_bytes, typestr or "|u1", shape)
        if is_gige:
            self._stream.set_property("frame-retention", _FRAME_RETENTION_US)
            if self._packet_resend == "never":
                self._stream.set_property("packet-resend", aravis().GvStreamPacketResend.NEVER)
            self._link.stream_port = self._stream.get_port()
            # Aravis would do so only at the first packet, too late for the first frame.
            granted = enlarge_receive_buffer(self._stream.get_port(), self._payload_bytes)
            self._granted_bytes = None if may_open_packet_sockets() else granted
            # Packets that are not fetched in time are lost: small frames in 80 ms, in the ring of a packet socket.
            raise_priority(*threads_named("arv_gv_stream"))
        camera.set_acquisition_mode(aravis().AcquisitionMode.CONTINUOUS)
        camera.start_acquisition()

    def __exit__(self, *exc: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Stop the acquisition and close the stream; may be called twice, and from another thread."""
        stream, self._stream = self._stream, None
        self._link.stream_port = None
        if stream is not None:
            # Closing during acquisition can abort the process; a lost camera cannot be stopped.
            with contextlib.suppress(CameraError), self._link.using("acquisition cannot be stopped") as camera:
                camera.stop_acquisition()
            self._counted = _count(stream)
            if (resent := resend_check(self._counted)) is not None:
                _log.warning("%s: %s", self._link.identity, resent)
            if self._link.lost:
                self._link.defer_release(stream)
        if self._pool is not None:
            self._pool.close()

    @property
    def statistics(self) -> StreamStatistics:
        """Counters of this stream."""
        stream = self._stream
        return self._counted if stream is None else _count(stream)

    @property
    def chunk_data(self) -> ChunkData:
        """Values that the camera sent with the last frame."""
        return self._chunk_check.data

    def next(self) -> Frame:
        """Wait for the next complete frame; raises as `AravisCamera.grab`."""
        while True:
            self._running()
            if self._settings.trigger.source == "Software":
                with self._link.using("no trigger can be sent") as camera:
                    camera.software_trigger()
            buffer = self._received()
            fault = self._check.fault(buffer, received_bytes(buffer))
            if fault is None and (difference := self._chunk_check.fault(buffer)) is not None:
                fault = NOT_AS_SET, difference
            if fault is None:
                self._n_refused = 0
                return self._frame(buffer)
            self._refuse(buffer, fault)

    def _received(self) -> Any:
        """Wait for a frame, complete or not."""
        began_s = time.monotonic()
        while True:
            waited_s = time.monotonic() - began_s
            buffer = self._pop(max(0.0, min(self._wait_s - waited_s, _ASKED_AFTER_S)))
            if buffer is None and waited_s >= _ASKED_AFTER_S and self._link.silent_s >= _ASKED_AFTER_S:
                buffer = self._ask_after()
            if buffer is not None and buffer.get_status() == self._cleared:
                # Without any packet it is not a frame: on a busy computer Aravis may return such a buffer.
                self._lender().take_back(buffer)
                buffer = None
            if buffer is not None:
                self._link.seen_alive()
                return buffer
            if waited_s >= self._wait_s:
                # The computer may have become busy since.
                self._wait_s = self._settings.longest_wait_s(self._timeout_s, overload())
                if waited_s >= self._wait_s:
                    self._explain_silence()

    def _pop(self, wait_s: float) -> Any:
        if self._gather_s:
            if (buffer := self._running().try_pop_buffer()) is not None:
                return buffer
            time.sleep(min(self._gather_s, wait_s))
        return self._running().timeout_pop_buffer(int(wait_s * 1e6))

    def _running(self) -> Any:
        stream = self._stream
        if stream is None:
            raise CameraError(
                f"{self._link.identity} was closed while it was grabbing", "open it again and restart grabbing"
            )
        return stream

    def _ask_after(self) -> Any:
        """Check that a late camera is alive; returns a frame that arrived in the meantime, if any."""
        if self._link.answers():
            return None
        # A frame is a sign of life, too.
        buffer = self._running().try_pop_buffer()
        if buffer is None:
            raise self._link.give_up("no frame came")
        return buffer

    def _explain_silence(self) -> NoReturn:
        # Always checked: a short time-out may end before a frame is due.
        self._link.require_life("no frame came")
        source = self._settings.trigger.source
        if source is None:
            default = "check packet size and firewall"
        elif source == "Software":
            default = "it was sent a software trigger"
        else:
            default = f"it waits for an edge on {source}; check that line, or set the trigger to free-running"
        causes = [] if source not in (None, "Software") else self._causes()
        raise FrameTimeoutError(
            f"no frame came from {self._link.identity} within {self._wait_s:.1f} s, although it answers",
            f"{'; '.join(causes) or default} ({self._counters()})",
        )

    def _refuse(self, buffer: Any, fault: tuple[str, str]) -> None:
        """Report an incomplete frame, or raise; its buffer is returned."""
        if fault[0] != NOT_AS_SET and self._known_causes is None:
            # Only once: reading the computer's settings takes longer than some frames.
            self._known_causes = "; ".join(self._causes())
        causes = self._known_causes or "lower the frame rate or packet size, or raise net.core.rmem_max"
        advice = REMEDY if fault[0] == NOT_AS_SET else f"{causes} ({self._counters()})"
        error = refusal(self._link.identity, buffer, fault, advice)
        self._lender().take_back(buffer)
        self._n_refused += 1
        if self._on_refused is None or self._n_refused >= MOST_REFUSED:
            raise error
        self._on_refused(error)

    def _causes(self) -> list[str]:
        """Return possible transport problems, the most likely first, each with its remedy."""
        address, packet_bytes = self._link.info.address, self._packet_bytes
        causes = stream_causes(address, self._payload_bytes, packet_bytes, self._granted_bytes, self.statistics)
        return [str(finding) for finding in causes[:_MOST_CAUSES]]

    def _counters(self) -> str:
        n = self.statistics
        return (
            f"completed {n.completed}, failed {n.failed}, underruns {n.underruns}, missing packets {n.missing}, "
            f"missing frames {self._check.n_left_out}"
        )

    def _temperature_now(self) -> float | None:
        """Temperature of the device, read anew once it is older than `_TEMPERATURE_EVERY_S`."""
        now_s = time.monotonic()
        if now_s >= self._temperature_due_s:
            self._temperature_due_s = now_s + _TEMPERATURE_EVERY_S
            # A camera that is lost by now is noticed by the next frame.
            with contextlib.suppress(CameraError), self._link.using("its temperature cannot be read") as camera:
                self._temperature_c = temperature_c(camera)
        return self._temperature_c

    def _lender(self) -> BufferPool:
        self._running()
        assert self._pool is not None
        return self._pool

    def _frame(self, buffer: Any) -> Frame:
        settings, layout = self._settings, self._layout
        frame_id, camera_timestamp_ns, timestamp = buffer.get_frame_id(), buffer.get_timestamp(), arrival(buffer)
        dn = self._lender().lend(buffer)
        if layout.typestr is None:
            dn = layout.unpack(dn, (settings.height, settings.width))
        return Frame(
            dn=dn,
            exposure_s=settings.exposure_s,
            gain_db=settings.gain_db,
            bit_depth=layout.bit_depth,
            saturation_dn=2**layout.bit_depth - 1,
            black_level_dn=None,
            pixel_format=layout.name,
            colour_filter=layout.colour_filter,
            temperature_c=self._temperature_now(),
            timestamp=timestamp,
            camera_timestamp_ns=camera_timestamp_ns,
            frame_id=frame_id,
            camera=self._link.identity,
            readout=settings.readout,
            black_level_register=settings.black_level,
        )


def _count(stream: Any) -> StreamStatistics:
    counters = {stream.get_info_name(i): stream.get_info_uint64(i) for i in range(stream.get_n_infos())}
    return StreamStatistics(**{name: int(counters.get(counter, 0)) for name, counter in _COUNTERS.items()})
