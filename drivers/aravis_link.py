"""The link to an opened camera: taking control, whether it is still there, and letting go of it quickly."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

from ..frame import CameraIdentity
from . import gvcp
from .aravis_library import CameraInfo, aravis, camera_errors, gerror
from .aravis_transport import find_packet_size, warn_of_small_receive_buffer
from .camera import CameraBusyError, CameraError, CameraLostError, CameraNotFoundError, CameraSettingError
from .sockets import shut_down, udp_socket_numbers

#: A camera that answered so lately is not asked again before it is used: an answer takes 0.1 to 1 ms.
_FRESH_S = 0.02

#: An access that takes longer is looked into: Aravis itself gives a camera up after seconds only.
_LONG_S = 0.1

#: Aravis' errors that tell of the way to the camera, not of what was asked of it.
_COMMUNICATION = ("NOT_CONNECTED", "TRANSFER_ERROR", "TIMEOUT", "NOT_CONTROLLER", "PROTOCOL_ERROR_ACCESS_DENIED")

#: Which sockets are Aravis' new ones can be told only while nobody else opens a camera.
_opening = threading.Lock()


class Link:
    """A camera under our control.

    Parameters
    ----------
    camera : Aravis.Camera
        Just opened.
    info : CameraInfo
        Where it is.
    sockets : frozenset of int
        Kernel numbers of the sockets by which Aravis controls it.
    """

    def __init__(self, camera: Any, info: CameraInfo, sockets: frozenset[int]) -> None:
        self.camera = camera
        self.info = info
        self.identity = CameraIdentity(info.vendor, info.model, info.serial)
        self.lost = False
        # Where the camera is to send its stream to, while there is one.
        self.stream_port: int | None = None
        self._arv = aravis()
        self._is_gige = bool(camera.is_gv_device())
        self._sockets = sockets
        self._streams: list[Any] = []
        self._obeys_others = False
        self._alive_at_s = time.monotonic()

    @contextlib.contextmanager
    def using(self, what: str) -> Iterator[Any]:
        """Use Aravis' camera for something; a camera that is gone is noticed before, and Aravis' errors are ours after.

        Parameters
        ----------
        what : str
            What could not be done if it goes wrong.

        Raises
        ------
        CameraLostError
            If the camera does not answer, or another program has taken it meanwhile.
        CameraBusyError
            If it answers, but another program controls it.
        CameraSettingError
            If it refuses what it was asked.
        """
        if self.lost or time.monotonic() - self._alive_at_s > _FRESH_S:
            self.require_life(what)
        camera = self.camera
        if camera is None:
            raise CameraError(f"{self.identity} was closed ({what}): open it again")
        try:
            with self._watched():
                yield camera
        except gerror() as error:
            raise self._explained(error, what) from error
        self.seen_alive()

    @contextlib.contextmanager
    def _watched(self) -> Iterator[None]:
        """Cut an access short if the camera dies in the middle of it."""
        if not self._is_gige:
            yield
            return
        done = threading.Event()
        watcher = threading.Thread(target=self._watch, args=(done,), name="camera watcher", daemon=True)
        watcher.start()
        try:
            yield
        finally:
            done.set()
            watcher.join()

    def _watch(self, done: threading.Event) -> None:
        while not done.wait(_LONG_S):
            if gvcp.read_register(self.info.address, gvcp.CONTROL_CHANNEL_PRIVILEGE) is None and not done.is_set():
                self.lost = True
                shut_down(self._sockets)
                return

    def seen_alive(self) -> None:
        """Note that the camera has just answered or sent something."""
        self._alive_at_s = time.monotonic()

    @property
    def silent_s(self) -> float:
        """Seconds since its last sign of life."""
        return time.monotonic() - self._alive_at_s

    def require_life(self, what: str) -> None:
        """Ask the camera whether it is there, for up to 0.75 s; raises as `using`."""
        if not self.answers():
            raise self.give_up(what)
        # Kept by Aravis' heartbeat, whose signal control-lost comes seconds later.
        camera = self.camera
        if self._is_gige and camera is not None and not camera.get_device().is_controller():
            raise CameraBusyError(
                f"{self.identity} was taken by another program ({what}): close that program, then open the camera again"
            )

    def answers(self) -> bool:
        """Ask the camera whether it is there and still under our control, for up to 0.75 s."""
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
        # Nobody controls it: it has been switched off and on, or was out of reach for longer than its heartbeat.
        self._obeys_others = answer.register == 0 or not self._sends_to_us()
        return not self._obeys_others

    def _sends_to_us(self) -> bool:
        """Whether a stream still has its place in the camera; a program that takes the camera gives it to itself."""
        if self.stream_port is None:
            return True
        answer = gvcp.read_register(self.info.address, gvcp.STREAM_CHANNEL_PORT)
        return answer is None or answer.register is None or answer.register & 0xFFFF == self.stream_port

    def give_up(self, what: str) -> CameraLostError:
        """Let go of a camera that is gone, and return the error to raise; Aravis would try to reach it for seconds."""
        self.lost = True
        shut_down(self._sockets)
        if self._obeys_others:
            return CameraLostError(
                f"{self.identity} no longer obeys this program ({what}): it was switched off and on, out of reach, or "
                "taken by another program; open it again"
            )
        return CameraLostError(f"{self.identity} stopped answering ({what}): check power and cable, then open it again")

    def _explained(self, error: Any, what: str) -> CameraError:
        device_error = self._arv.DeviceError
        codes = [int(getattr(device_error, name)) for name in _COMMUNICATION]
        if error.domain != "arv-device-error-quark" or error.code not in codes:
            return CameraSettingError(f"{self.identity} refuses: {what} [{error.message}]")
        if not self.answers():
            return self.give_up(f"{what} [{error.message}]")
        return CameraBusyError(
            f"{self.identity} answers, but takes no orders ({what}): another program has taken control of it; close "
            f"that program, then open the camera again [{error.message}]"
        )

    def bury(self, stream: Any) -> None:
        """Keep a stream of a camera that is gone until `close`: Aravis takes half a second to end it."""
        self._streams = [*self._streams, stream]

    def close(self) -> None:
        """Let the camera go, so that others can have it."""
        camera, self.camera, streams, self._streams = self.camera, None, self._streams, []
        if camera is None:
            return
        if not self.lost and self._is_gige and gvcp.announce(self.info.address) is not None:
            # Said in so many words: somebody's traceback may keep Aravis' object alive.
            with contextlib.suppress(CameraError), camera_errors("", CameraError):
                camera.get_device().leave_control()
        self.lost = True
        shut_down(self._sockets)
        # Before the camera.
        del streams


def connect(info: CameraInfo) -> Link:
    """Open a camera, take control, and bring it to a known state.

    Raises
    ------
    CameraNotFoundError
        If it cannot be opened, or is another one than announced.
    CameraBusyError
        If another program controls it.
    CameraLostError
        If it stops answering meanwhile.
    """
    arv = aravis()
    is_gige = info.protocol == "GigEVision"
    if is_gige and gvcp.announce(info.address) is None:
        raise CameraNotFoundError(
            f"camera {info.serial} does not answer at {info.address}: check power and cable, and that this computer "
            "has an address of its network"
        )
    with _opening, camera_errors(f"camera {info.serial} at {info.address} cannot be opened", CameraNotFoundError):
        before = udp_socket_numbers()
        camera = arv.Camera.new(info.address if is_gige else info.serial)
        link = Link(camera, info, udp_socket_numbers() - before)
    try:
        _check_who(link)
        _bring_to_known_state(link)
    except BaseException:
        link.close()
        raise
    return link


def _check_who(link: Link) -> None:
    info = link.info
    with link.using("it does not tell who it is") as camera:
        if camera.is_gv_device() and not camera.get_device().is_controller():
            raise CameraBusyError(
                f"camera {info.serial} at {info.address} is controlled by another program: close that program, "
                "or wait a few seconds if it was killed"
            )
        serial = camera.get_device_serial_number()
        if serial != info.serial:
            raise CameraNotFoundError(
                f"the camera at {info.address} has serial number {serial}, not {info.serial}: two cameras "
                "share the address; give each its own"
            )
        link.identity = CameraIdentity(info.vendor, info.model, info.serial, simulated=_says_simulated(camera))


def _says_simulated(camera: Any) -> bool:
    name = "DeviceManufacturerInfo"
    text = camera.get_string(name) if camera.is_feature_available(name) else ""
    return "simulated" in (text or "").lower() or camera.get_vendor_name() == "Aravis"


def _bring_to_known_state(link: Link) -> None:
    """Undo what another program may have left: acquisition, triggers, automatics, gamma, binning and region."""
    with link.using("it cannot be brought to a known state") as camera:
        camera.stop_acquisition()
        camera.clear_triggers()
        for name in ("ExposureAuto", "GainAuto"):
            if camera.is_feature_available(name):
                camera.set_string(name, "Off")
        if camera.is_feature_available("Gamma"):
            camera.set_float("Gamma", 1.0)
        if camera.is_binning_available():
            camera.set_binning(1, 1)
        camera.set_region(0, 0, *camera.get_sensor_size())
        if camera.is_gv_device():
            find_packet_size(camera, link.info.address)
            warn_of_small_receive_buffer(camera.get_payload())
