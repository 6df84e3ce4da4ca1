"""Link to an opened camera: control, detection of loss, quick release."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

from ...core.frame import CameraIdentity
from ..camera import CameraBusyError, CameraError, CameraLostError, CameraNotFoundError, CameraSettingError
from ..computer import shut_down, udp_socket_numbers
from ..device import on_error
from . import gvcp
from .description import check_description
from .features import text_of
from .known_state import bring_to_known_state
from .library import CameraInfo, aravis, camera_errors, gerror, is_of_transport
from .transport import find_neighbours, find_packet_size, warn_of_small_receive_buffer

#: Time after an answer in which the camera is not checked again before use; a check takes 0.1 to 1 ms.
_FRESH_S = 0.02

#: Time for other cameras to answer when one is opened; some answer to broadcasts after a random delay.
_LOOK_S = 1.0

#: New sockets of Aravis can be identified only while no other thread opens a camera.
_opening = threading.Lock()


class Link:
    """A camera controlled by this process.

    Parameters
    ----------
    camera : Aravis.Camera
        Opened camera of Aravis.
    info : CameraInfo
        Network address.
    sockets : frozenset of int
        Inodes of the sockets by which Aravis controls it.
    """

    def __init__(self, camera: Any, info: CameraInfo, sockets: frozenset[int]) -> None:
        self.camera = camera
        self.info = info
        self.identity = CameraIdentity(info.vendor, info.model, info.serial)
        self.lost = False
        # Destination of the stream, while there is one.
        self.stream_port: int | None = None
        # Addresses of the other cameras behind the same interface.
        self.neighbours: frozenset[str] = frozenset()
        # Largest packet that came through when it was opened, if test packets were sent.
        self.path_packet_bytes: int | None = None
        self._is_gige = bool(camera.is_gv_device())
        self._sockets = sockets
        self._streams: list[Any] = []
        self._controlled_by_others = False
        self._alive_at_s = time.monotonic()

    @contextlib.contextmanager
    def using(self, what: str) -> Iterator[Any]:
        """Context of an access to Aravis' camera: checks for loss before, and converts Aravis' errors.

        Parameters
        ----------
        what : str
            Name of the operation in error messages.

        Raises
        ------
        CameraLostError
            If the camera does not answer, or another program has taken control in the meantime.
        CameraBusyError
            If it answers, but another program controls it.
        CameraSettingError
            If it rejects the request.
        """
        if self.lost or time.monotonic() - self._alive_at_s > _FRESH_S:
            self.require_life(what)
        camera = self.camera
        if camera is None:
            raise CameraError(f"{self.identity} was closed ({what})", "open it again")
        try:
            yield camera
        except gerror() as error:
            raise self._explained(error, what) from error
        self.seen_alive()

    def seen_alive(self) -> None:
        """Record a sign of life of the camera."""
        self._alive_at_s = time.monotonic()

    @property
    def silent_s(self) -> float:
        """Seconds since its last sign of life."""
        return time.monotonic() - self._alive_at_s

    def require_life(self, what: str) -> None:
        """Check that the camera answers, for up to 2.5 s; raises as `using`."""
        if not self.answers():
            raise self.give_up(what)
        # Maintained by Aravis' heartbeat, whose signal control-lost arrives seconds later.
        camera = self.camera
        if self._is_gige and camera is not None and not camera.get_device().is_controller():
            raise CameraBusyError(
                f"{self.identity} was taken by another program ({what})",
                "close that program, then open the camera again",
            )

    def answers(self) -> bool:
        """Check that the camera answers and is still controlled by this process, for up to 2.5 s."""
        if self.lost or not self._answers():
            return False
        self.seen_alive()
        return True

    def _answers(self) -> bool:
        if not self._is_gige:
            with contextlib.suppress(CameraError), camera_errors("", CameraLostError):
                self.camera.get_payload()
                return True
            return False
        answer = gvcp.read_register(self.info.address, gvcp.CONTROL_CHANNEL_PRIVILEGE)
        if answer is None:
            return False
        # Not controlled by any program: power-cycled, or unreachable for longer than its heartbeat.
        self._controlled_by_others = answer.register == 0 or not self._sends_to_us()
        return not self._controlled_by_others

    def _sends_to_us(self) -> bool:
        """Whether the camera still sends to this stream; a program that takes control redirects it."""
        if self.stream_port is None:
            return True
        answer = gvcp.read_register(self.info.address, gvcp.STREAM_CHANNEL_PORT)
        return answer is None or answer.register is None or answer.register & 0xFFFF == self.stream_port

    def give_up(self, what: str) -> CameraLostError:
        """Release a lost camera and return the error to raise; Aravis would try to reach it for seconds."""
        self.lost = True
        shut_down(self._sockets)
        if self._controlled_by_others:
            return CameraLostError(
                f"{self.identity} is no longer controlled by this program ({what})",
                "it was switched off and on, out of reach, or taken by another program; open it again",
            )
        return CameraLostError(
            f"{self.identity} stopped answering ({what})", "check power and cable, then open it again"
        )

    def _explained(self, error: Any, what: str) -> CameraError:
        if not is_of_transport(error, "PROTOCOL_ERROR_ACCESS_DENIED"):
            return CameraSettingError(f"{self.identity} refuses: {what} [{error.message}]")
        if not self.answers():
            return self.give_up(f"{what} [{error.message}]")
        return CameraBusyError(
            f"{self.identity} answers but refuses control ({what})",
            f"another program controls it; close that program, then open the camera again [{error.message}]",
        )

    def defer_release(self, stream: Any) -> None:
        """Keep a stream of a lost camera until `close`: Aravis takes half a second to stop it."""
        self._streams = [*self._streams, stream]

    def close(self) -> None:
        """Release the camera for other programs."""
        camera, self.camera, streams, self._streams = self.camera, None, self._streams, []
        if camera is None:
            return
        if not self.lost and self._is_gige and gvcp.announce(self.info.address) is not None:
            # Explicitly: a traceback may keep Aravis' object alive.
            with contextlib.suppress(CameraError), camera_errors("", CameraError):
                camera.get_device().leave_control()
        self.lost = True
        shut_down(self._sockets)
        # Before the camera.
        del streams


def connect(info: CameraInfo, *, prepare: bool = True) -> Link:
    """Open a camera, take control, and bring it to a known state.

    Parameters
    ----------
    info : CameraInfo
        As discovered.
    prepare : bool
        False leaves all its settings as they are.

    Raises
    ------
    CameraNotFoundError
        If it cannot be opened, or differs from the announced one.
    CameraBusyError
        If another program controls it.
    CameraLostError
        If it stops answering in the meantime.
    """
    arv = aravis()
    is_gige = info.protocol == "GigEVision"
    if is_gige:
        _require_free(info)
        check_description(info.address)
    with _opening, camera_errors(f"camera {info.serial} at {info.address} cannot be opened", CameraNotFoundError):
        before = udp_socket_numbers()
        camera = arv.Camera.new(info.address if is_gige else info.device_id)
        link = Link(camera, info, udp_socket_numbers() - before)
    with on_error(link.close):
        _check_who(link)
        if prepare:
            _prepare(link)
    return link


def _require_free(info: CameraInfo) -> None:
    """Refuse a camera that is absent or controlled before Aravis tries for seconds to take control of it."""
    controlled = gvcp.is_controlled(info.address)
    if controlled is None:
        raise CameraNotFoundError(
            f"camera {info.serial} does not answer at {info.address}",
            "check power and cable, and that this computer "
            "has an address of its network (labcdp doctor names the command)",
        )
    if controlled:
        raise _busy(info)


def _busy(info: CameraInfo) -> CameraBusyError:
    return CameraBusyError(
        f"camera {info.serial} at {info.address} is controlled by another program",
        "close that program, or wait a few seconds if it was killed",
    )


def _check_who(link: Link) -> None:
    info = link.info
    with link.using("it does not identify itself") as camera:
        if camera.is_gv_device():
            if not camera.get_device().is_controller():
                raise _busy(info)
            # As it was discovered: a GenICam description need not have it.
            seen = gvcp.announce(info.address)
            if seen is not None and seen.serial != info.serial:
                raise CameraNotFoundError(
                    f"the camera at {info.address} has serial number {seen.serial}, not {info.serial}",
                    "two cameras share the address; give each its own",
                )
        simulated = "simulated" in text_of(camera, "DeviceManufacturerInfo").lower() or info.vendor == "Aravis"
        link.identity = CameraIdentity(info.vendor, info.model, info.serial, simulated=simulated)


def _prepare(link: Link) -> None:
    """Reset settings left by other programs, and set up the stream."""
    with link.using("it cannot be brought to a known state") as camera:
        bring_to_known_state(camera)
        if camera.is_gv_device():
            link.path_packet_bytes = find_packet_size(camera, link.info.address)
            warn_of_small_receive_buffer(camera.get_payload())
    if link.info.protocol == "GigEVision":
        link.neighbours = find_neighbours(link.info.address, _LOOK_S)
