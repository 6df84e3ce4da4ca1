"""Receiving frames through Aravis: one stream from the start of acquisition to its stop."""

from __future__ import annotations

import contextlib
import logging
import time
from dataclasses import dataclass
from typing import Any, NoReturn, Self

from ..frame import Frame
from .aravis_frames import FrameCheck, arrival, refusal
from .aravis_library import aravis
from .aravis_link import Link
from .aravis_pool import BufferPool, pool_size
from .aravis_settings import layout_of
from .aravis_transport import set_up_transport
from .camera import (
    CameraError,
    CameraSettings,
    FrameTimeoutError,
    Refused,
    StreamStatistics,
)
from .diagnosis import StreamFacts, stream_causes
from .sockets import enlarge_receive_buffer, has_packet_sockets

_log = logging.getLogger(__name__)

#: Longest wait in one go: how soon a close from another thread, or silence, is noticed.
_SLICE_S = 0.05

#: Pause between two questions to a silent camera.
_PAUSE_S = 0.15

#: A camera that sends nothing for so long is asked whether it still lives, also while it exposes.
_ASKED_AFTER_S = 0.15

#: Frames refused in a row after which no whole one is to be hoped for.
_MOST_REFUSED = 20

#: Causes named in an error.
_MOST_CAUSES = 2

#: Where Aravis counts what `StreamStatistics` holds.
_COUNTERS = {
    "completed": "n_completed_buffers",
    "failed": "n_failures",
    "underruns": "n_underruns",
    "resent": "n_resent_packets",
    "missing": "n_missing_packets",
}


@dataclass(frozen=True)
class Conditions:
    """Under which a camera takes its frames.

    Parameters
    ----------
    settings : CameraSettings
        In force.
    temperature_c : float or None
        Of the device, at the start.
    chosen : frozenset of str
        GenICam features that the user has set, and that are to stay so.
    """

    settings: CameraSettings
    temperature_c: float | None
    chosen: frozenset[str] = frozenset()


class Reception:
    """One stream and its buffers; a context manager.

    Each stream has a port of its own, and is made while the camera stands still: no frame from before can arrive.

    Parameters
    ----------
    link : Link
        To the camera, with its settings made.
    conditions : Conditions
        For the frames.
    timeout_s : float
        Longest wait for a frame beyond the exposure time.
    on_refused : callable or None
        Told of incomplete frames; None raises them.
    """

    def __init__(self, link: Link, conditions: Conditions, timeout_s: float, on_refused: Refused | None) -> None:
        settings = conditions.settings
        self._link = link
        self._conditions = conditions
        self._on_refused = on_refused
        self._layout = layout_of(settings)
        self._wait_s = timeout_s + settings.exposure_s
        self._stream: Any = None
        self._pool: BufferPool | None = None
        self._counted = StreamStatistics()
        self._n_refused = 0
        self._known_causes: str | None = None
        self._granted_bytes: int | None = None

    def __enter__(self) -> Self:
        try:
            with self._link.using("no stream can be opened") as camera:
                self._start(camera)
        except BaseException:
            self.stop()
            raise
        return self

    def _start(self, camera: Any) -> None:
        settings = self._conditions.settings
        is_gige = bool(camera.is_gv_device())
        self._check = FrameCheck(settings, self._layout, reserves_zero=is_gige)
        self._packet_bytes = None
        if is_gige:
            set_up_transport(camera, self._link.info.address, settings.frame_rate_hz, self._conditions.chosen)
            self._packet_bytes = camera.gv_get_packet_size()
        self._payload_bytes = camera.get_payload()
        self._stream = camera.create_stream(None, None)
        n_buffers = pool_size(self._payload_bytes, settings.frame_rate_hz)
        self._pool = BufferPool(self._stream, n_buffers, self._payload_bytes)
        if is_gige:
            self._link.stream_port = self._stream.get_port()
            # Aravis would do so at the first packet, too late for the first frame.
            granted = enlarge_receive_buffer(self._stream.get_port(), self._payload_bytes)
            self._granted_bytes = None if has_packet_sockets() else granted
        camera.set_acquisition_mode(aravis().AcquisitionMode.CONTINUOUS)
        camera.start_acquisition()

    def __exit__(self, *exc: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Stop the acquisition and give up the stream; may be called twice, and from another thread."""
        stream, self._stream = self._stream, None
        self._link.stream_port = None
        if stream is not None:
            # Leaving in mid-acquisition can abort the process; a camera that is lost cannot be told.
            with contextlib.suppress(CameraError), self._link.using("acquisition cannot be stopped") as camera:
                camera.stop_acquisition()
            self._counted = _count(stream)
            if self._link.lost:
                self._link.bury(stream)
        if self._pool is not None:
            self._pool.close()

    @property
    def statistics(self) -> StreamStatistics:
        """Counters of this stream."""
        stream = self._stream
        return self._counted if stream is None else _count(stream)

    def next(self) -> Frame:
        """Wait for the next whole frame.

        Raises
        ------
        FrameTimeoutError, IncompleteFrameError, CameraLostError
            As `AravisCamera.grab`.
        """
        while True:
            self._running()
            if self._conditions.settings.trigger.source == "Software":
                with self._link.using("no trigger can be sent") as camera:
                    camera.software_trigger()
            buffer = self._received()
            fault = self._check.fault(buffer)
            if fault is None:
                self._n_refused = 0
                return self._frame(buffer)
            self._refuse(buffer, fault)

    def _received(self) -> Any:
        """Wait for a frame, whole or not."""
        began_s = time.monotonic()
        while True:
            waited_s = time.monotonic() - began_s
            buffer = self._running().timeout_pop_buffer(int(max(0.0, min(self._wait_s - waited_s, _SLICE_S)) * 1e6))
            if buffer is None and waited_s >= _ASKED_AFTER_S and self._link.silent_s >= _PAUSE_S:
                buffer = self._ask_after()
            if buffer is not None:
                self._link.seen_alive()
                return buffer
            if waited_s >= self._wait_s:
                self._explain_silence()

    def _running(self) -> Any:
        stream = self._stream
        if stream is None:
            raise CameraError(f"{self._link.identity} was closed while it was grabbing: open it again and grab anew")
        return stream

    def _ask_after(self) -> Any:
        """Make sure that a camera that is late still lives; returns the frame that came meanwhile, if one did."""
        if self._link.answers():
            return None
        # A frame is a sign of life, too.
        buffer = self._running().try_pop_buffer()
        if buffer is None:
            raise self._link.give_up("no frame came")
        return buffer

    def _explain_silence(self) -> NoReturn:
        # Asked in any case: a short time-out may be over before a frame is due.
        self._link.require_life("no frame came")
        source = self._conditions.settings.trigger.source
        if source is None:
            default = "check packet size and firewall"
        elif source == "Software":
            default = "it was sent a software trigger"
        else:
            default = f"it waits for an edge on {source}; check that line, or set the trigger to free-running"
        causes = [] if source not in (None, "Software") else self._causes()
        raise FrameTimeoutError(
            f"no frame came from {self._link.identity} within {self._wait_s:.1f} s, though it answers: "
            f"{'; '.join(causes) or default} ({self._counters()})"
        )

    def _refuse(self, buffer: Any, fault: tuple[str, str]) -> None:
        """Tell of a frame that is not whole, or raise; its buffer goes back."""
        if self._known_causes is None:
            # Once: looking at the computer's settings takes longer than some frames.
            self._known_causes = "; ".join(self._causes())
        causes = self._known_causes or "lower the frame rate or packet size, or raise net.core.rmem_max"
        error = refusal(self._link.identity, buffer, fault, f"{causes} ({self._counters()})")
        self._lender().take_back(buffer)
        self._n_refused += 1
        if self._on_refused is None or self._n_refused >= _MOST_REFUSED:
            raise error
        self._on_refused(error)

    def _causes(self) -> list[str]:
        """Return what may be wrong on the way, the likeliest first, each with its remedy."""
        counted = self.statistics
        facts = StreamFacts(
            address=self._link.info.address,
            payload_bytes=self._payload_bytes,
            packet_size_bytes=self._packet_bytes,
            socket_buffer_bytes=self._granted_bytes,
            completed=counted.completed,
            failed=counted.failed,
            underruns=counted.underruns,
            missing=counted.missing,
        )
        return [str(finding) for finding in stream_causes(facts)[:_MOST_CAUSES]]

    def _counters(self) -> str:
        counted = self.statistics
        return (
            f"completed {counted.completed}, failed {counted.failed}, underruns {counted.underruns}, "
            f"missing packets {counted.missing}, missing frames {self._check.n_left_out}"
        )

    def _lender(self) -> BufferPool:
        self._running()
        assert self._pool is not None
        return self._pool

    def _frame(self, buffer: Any) -> Frame:
        settings = self._conditions.settings
        layout = self._layout
        frame_id, camera_timestamp_ns, timestamp = buffer.get_frame_id(), buffer.get_timestamp(), arrival(buffer)
        shape = (settings.height, settings.width)
        if layout.typestr is not None:
            dn = self._lender().lend(buffer, layout.typestr, shape)
        else:
            dn = layout.unpack(self._lender().lend(buffer, "|u1", (self._payload_bytes,)), shape)
        return Frame(
            dn=dn,
            exposure_s=settings.exposure_s,
            gain_db=settings.gain_db,
            bit_depth=layout.bit_depth,
            saturation_dn=2**layout.bit_depth - 1,
            black_level_dn=settings.black_level_dn,
            pixel_format=layout.name,
            colour_filter=layout.colour_filter,
            temperature_c=self._conditions.temperature_c,
            timestamp=timestamp,
            camera_timestamp_ns=camera_timestamp_ns,
            frame_id=frame_id,
            camera=self._link.identity,
        )


def _count(stream: Any) -> StreamStatistics:
    counters = {stream.get_info_name(i): stream.get_info_uint64(i) for i in range(stream.get_n_infos())}
    return StreamStatistics(**{name: int(counters.get(counter, 0)) for name, counter in _COUNTERS.items()})
