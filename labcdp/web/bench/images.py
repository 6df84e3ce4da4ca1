"""Images of a live camera: each newest one to be shown, measured four times a second; and the exposure that suits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from threading import Thread
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError, InputError
from ...core.frame import Frame
from ...core.roi import Roi
from ...core.vignetting import Lens
from ..regions.page_image import PageImage
from ..regions.workspace import Workspace
from .live_camera import LiveCamera

if TYPE_CHECKING:
    from ...evaluate.picture.converter import Converter


#: Most images per second; more are not seen.
_MOST_HZ = 12.0
#: Seconds between two measurements; digits that change faster cannot be read.
_MEASURE_S = 0.25
#: Largest side of the middle of an image, where no region is meant.
_MIDDLE_PX = 600
#: How often it is looked whether frames are overdue, or have another exposure.
_LOOK_S = 0.5


@dataclass(frozen=True)
class Focus:
    """Sharpness of a region, and the largest of the same region so far.

    Parameters
    ----------
    region : str
        Its name; empty for the middle of the image.
    setting : (float, float)
        Exposure and gain of the image; others make the noise another.
    now, best : float
        As of `sharpness`.
    """

    region: str = ""
    setting: tuple[float, float] = (0.0, 0.0)
    now: float = 0.0
    best: float = 0.0

    def after(self, frame: Frame, roi: Roi | None) -> Focus:
        """Return the focus after another frame: of a region, or of the middle."""
        values = frame.dn
        rows, columns = (_middle(length) for length in values.shape)
        if roi is not None:
            try:
                rows, columns = roi.window((values.shape[0], values.shape[1]))
            except InputError:
                rows = slice(0)
        name, now = "" if roi is None else roi.name, sharpness(values[rows, columns])
        setting = frame.exposure_s, frame.gain_db
        same = (name, setting) == (self.region, self.setting)
        return Focus(name, setting, now, max(now, self.best if same else 0.0))


def _middle(length: int) -> slice:
    side = min(length // 2, _MIDDLE_PX)
    return slice((length - side) // 2, (length + side) // 2)


def sharpness(values: NDArray[Any]) -> float:
    """Compute the variance of the Laplacian over the squared mean.

    The Laplacian is that of means of 2 x 2 pixels: a Bayer pattern does not count, and noise counts less. The value
    compares images of the same scene and exposure; the sharpest has the largest one.

    Parameters
    ----------
    values : ndarray of int or float, shape (height, width)
        The part, of at least 6 x 6 pixels.

    Returns
    -------
    float
        0 for a smaller part, or one without light.
    """
    import cv2

    height, width = (length // 2 * 2 for length in values.shape)
    if min(height, width) < 6:
        return 0.0
    blocks = cv2.resize(values[:height, :width], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    blocks = blocks.astype(np.float32)
    mean = float(blocks.mean())
    if mean <= 0:
        return 0.0
    inner = cv2.Laplacian(blocks, cv2.CV_32F)[1:-1, 1:-1]
    return float(inner.var()) / mean**2


class LiveImages:
    """The newest image of a camera.

    Parameters
    ----------
    camera : LiveCamera
        The camera.
    converter : Converter
        To cd/m^2, or to relative luminance.
    lens : Lens or None
        For the vignetting of relative luminance; None for not known.
    call : function of a function
        Calls a function in the thread of the pages.
    """

    def __init__(
        self,
        camera: LiveCamera,
        converter: Converter,
        lens: Lens | None,
        call: Callable[[Callable[[], None]], None],
    ) -> None:
        self._camera, self._converter, self._call = camera, converter.with_lens(lens), call
        self.lens = lens
        self.newest: PageImage | None = None
        #: Why there is no cd/m^2 with a calibration.
        self.mismatch = ""
        #: Kind of the frames for which that was said.
        self._mismatched: tuple[object, ...] = ()
        self.paused = False
        self.focus = Focus()
        #: Place x, y in the image that the pointer is at; empty outside.
        self.pointer: list[int] = []
        self._bit_depth = 16
        #: Black level by the calibration, else what it probably is.
        self.black_dn = 0.0
        self._listeners: list[Callable[[], None]] = []
        self._told = True

    @property
    def highest_dn(self) -> float:
        """Highest DN of the camera's converter."""
        return 2.0**self._bit_depth - 1

    def image(self, frame: Frame) -> PageImage:
        """Return the image of a frame, in relative luminance where the calibration is not for it."""
        self._bit_depth, self.black_dn = frame.bit_depth, frame.nominal_black_dn
        try:
            image = PageImage.live(frame, self._converter)
            self.mismatch, self._mismatched = "", ()
            self.black_dn = self._converter.options.black_level_dn or self.black_dn
        except CalibrationError as error:
            from ...evaluate.picture.converter import make_converter

            image = PageImage.live(frame, make_converter().with_lens(self.lens))
            kind = (frame.shape, frame.pixel_format, frame.gain_db, frame.readout)
            if kind != self._mismatched:
                # Names one frame: another text for each would not let a person read it.
                self.mismatch, self._mismatched = f"The calibration does not apply: {error}", kind
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
                # A recording covers the lens: noise alone looks sharp.
                if image is not None and frame is not None and not live.lent:
                    self.focus = self.focus.after(frame, self._focused(workspace))
                self._call(partial(self._hand_on, measure, image))
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


#: Where the brightest pixels should be, as a share of the saturation.
TARGET = 0.8
#: Shares of the range within which an exposure is good enough.
_GOOD = (0.7, 0.9)
#: Quantile that stands for the brightest pixels: single hot ones do not count.
_BRIGHTEST = 0.99
#: Step while pixels are saturated and nothing can be computed.
_STEP = 0.25
#: Attempts to fit the exposure, and time for a frame with the new one.
_MOST_ATTEMPTS, _ATTEMPT_S = 10, 20.0


def better_exposure_s(
    values: NDArray[Any], exposure_s: float, saturation_dn: float, limits_s: tuple[float, float]
) -> float | None:
    """Compute an exposure with which the brightest pixels are nearer to 80 % of the range.

    The black level is unknown and counted as light: a dark image needs several steps.

    Parameters
    ----------
    values : ndarray of int
        DN of the pixels that matter.
    exposure_s : float
        Exposure with which they were taken.
    saturation_dn : float
        DN from which a pixel is saturated.
    limits_s : (float, float)
        Shortest and longest exposure of the camera.

    Returns
    -------
    float or None
        The exposure; None if the present one is good, or no other is possible.
    """
    brightest = float(np.quantile(values, _BRIGHTEST))
    share = brightest / saturation_dn
    if _GOOD[0] <= share <= _GOOD[1]:
        return None
    factor = _STEP if share > 0.99 else TARGET * saturation_dn / max(brightest, 1.0)
    wanted_s = float(np.clip(exposure_s * factor, *limits_s))
    return None if np.isclose(wanted_s, exposure_s, rtol=0.01) else wanted_s


def fit_exposure(camera: LiveCamera, rois: Callable[[], Sequence[Roi]]) -> Iterator[str]:
    """Change the exposure of a camera until the brightest region, or the image, fills the range; yield what failed."""
    for _ in range(_MOST_ATTEMPTS):
        live = camera.live
        if live.frame is None or live.settings is None:
            break
        frame = live.frame
        inside = []
        for roi in rois():
            # Some may be outside a smaller part of the sensor.
            with suppress(InputError):
                inside.append(roi.select(frame.dn))
        inside = inside or [frame.dn.ravel()]
        brightest = max(inside, key=lambda values: float(values.mean()))
        better_s = better_exposure_s(brightest, frame.exposure_s, frame.saturation_dn, live.exposure_range_s)
        if better_s is None:
            yield ""
            return
        camera.request(exposure_s=better_s)
        if not _has_another_exposure(camera, frame.exposure_s):
            yield "The exposure cannot be fitted: the camera does not take it"
            return
    yield "The exposure cannot be fitted: there is too much or too little light"


def _has_another_exposure(camera: LiveCamera, exposure_s: float) -> bool:
    """Wait for a frame with another exposure; False if none comes."""
    until_s = monotonic() + _ATTEMPT_S
    while (live := camera.live).frame is None or live.frame.exposure_s == exposure_s:
        if live.error or monotonic() > until_s:
            return False
        camera.wait_for_news(live, _LOOK_S)
    return True
