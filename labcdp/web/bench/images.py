"""Images of a live camera: each newest one to be shown, and measured four times a second."""

from __future__ import annotations

from collections.abc import Callable
from threading import Thread
from time import monotonic, sleep
from typing import TYPE_CHECKING

from ...core.errors import CalibrationError
from ...core.frame import Frame
from ...core.roi import Roi
from ..regions.page_image import PageImage
from ..regions.workspace import Workspace
from .focus import Focus
from .live_camera import LiveCamera

if TYPE_CHECKING:
    from ...evaluate.picture.light.picture import PictureConversion

#: Most images per second; more are not seen.
_MOST_HZ = 12.0
#: Seconds between two measurements; digits that change faster cannot be read.
_MEASURE_S = 0.25
#: How often it is looked whether frames are overdue.
_LOOK_S = 0.5


class LiveImages:
    """The newest image of a camera.

    Parameters
    ----------
    camera : LiveCamera
        The camera.
    conversion : PictureConversion
        To cd/m^2, or to relative luminance.
    call : function of a function
        Calls a function in the thread of the pages.
    """

    def __init__(
        self, camera: LiveCamera, conversion: PictureConversion, call: Callable[[Callable[[], None]], None]
    ) -> None:
        self._camera, self._conversion, self._call = camera, conversion, call
        self.newest: PageImage | None = None
        #: Why there is no cd/m^2 with a calibration.
        self.mismatch = ""
        self.paused = False
        self.focus = Focus()
        #: Place x, y in the image that the pointer is at; empty outside.
        self.pointer: list[int] = []
        self._bit_depth = 16
        self._listeners: list[Callable[[], None]] = []
        self._told = True

    @property
    def highest_dn(self) -> float:
        """Highest DN of the camera's converter."""
        return 2.0**self._bit_depth - 1

    def image(self, frame: Frame) -> PageImage:
        """Return the image of a frame, in relative luminance where the calibration is not for it."""
        self._bit_depth = frame.bit_depth
        try:
            image = PageImage.of_frame("live", frame, self._conversion)
            self.mismatch = ""
        except CalibrationError as error:
            from ...evaluate.picture.light.picture import picture_conversion

            image = PageImage.of_frame("live", frame, picture_conversion(None, None, None))
            self.mismatch = f"The calibration does not apply: {error}"
        return image

    def listen(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call `listener` for each new image; returns a function that unsubscribes it."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def start(self, workspace: Workspace, measure: Callable[[PageImage | None], None]) -> None:
        """Hand on images until the camera is stopped; `measure` gets one, or None, now and then."""
        Thread(target=self._run, args=(workspace, measure), name="live images", daemon=True).start()

    def _run(self, workspace: Workspace, measure: Callable[[PageImage | None], None]) -> None:
        live, frame, measured, measured_s = self._camera.live, None, None, 0.0
        while not self._camera.ended:
            live = self._camera.wait_for_news(live, _LOOK_S)
            began_s = monotonic()
            if live.frame is not None and live.frame is not frame and not self.paused:
                frame = live.frame
                self.newest = self.image(frame)
                self._call(self._tell)
            # Not faster than the page's thread.
            if self._told and began_s - measured_s > _MEASURE_S:
                self._told, measured_s = False, began_s
                image = self.newest if self.newest is not measured else None
                measured = self.newest
                if image is not None and frame is not None:
                    self.focus = self.focus.after(frame, self._focused(workspace))
                self._call(lambda image=image: self._hand_on(measure, image))
            sleep(max(0.0, 1 / _MOST_HZ - (monotonic() - began_s)))

    def _focused(self, workspace: Workspace) -> Roi | None:
        """Return the region under the pointer, or else the selected one."""
        rois = workspace.drawing.rois
        under = [roi for roi in rois if len(self.pointer) == 2 and _holds(roi, *self.pointer)]
        return next((roi for roi in (*under, *rois) if under or roi.name == workspace.selected), None)

    def _tell(self) -> None:
        for listener in tuple(self._listeners):
            listener()

    def _hand_on(self, measure: Callable[[PageImage | None], None], image: PageImage | None) -> None:
        self._told = True
        measure(image)


def _holds(roi: Roi, x: float, y: float) -> bool:
    left, top, right, bottom = roi.bounds
    return left <= x < right and top <= y < bottom
