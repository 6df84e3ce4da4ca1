"""Chunk data: what a camera says of each frame behind its pixels, compared with what is set.

Names are those of the GenICam Standard Features Naming Convention (SFNC 2.7), with those that Basler and Point Grey
have for the frame counter.
"""

from __future__ import annotations

import contextlib
import logging
from dataclasses import dataclass
from typing import Any, Final

from ..camera import CameraSettingError
from ..camera_settings import CameraSettings
from .features import available, kind_of, read_feature, unit_of, writable, write_feature
from .library import gerror, is_of_transport

_log = logging.getLogger(__name__)

#: Switch of all chunks.
CHUNK_MODE: Final = "ChunkModeActive"
_SELECTOR, _ENABLE = "ChunkSelector", "ChunkEnable"
#: Features of each value; the entry of the selector is called as the feature, without its first word.
_FEATURES: Final = {
    "exposure_us": ("ChunkExposureTime",),
    "gain_db": ("ChunkGain",),
    "timestamp": ("ChunkTimestamp",),
    "counter": ("ChunkFrameID", "ChunkFrameCounter", "ChunkFramecounter"),
}
_WORD: Final = "Chunk"
#: Units of values that are compared with settings; many cameras state none.
_UNITS: Final = {"exposure_us": ("us", "µs", ""), "gain_db": ("db", "")}
#: Differences from the settings that are rounding: an exposure of whole microseconds or rows, a gain in steps.
_EXPOSURE_REL, _EXPOSURE_US, _GAIN_DB = 2e-3, 2.0, 0.1
#: Most frames that a camera may count between two that it sends; more are another counter.
_MOST_UNSENT: Final = 10_000
#: What to do about frames that are not as set.
REMEDY: Final = (
    "switch off what changes it, such as a sequencer or a set of another program; "
    f"if the camera's chunk data are wrong, set {CHUNK_MODE} = false in [camera.features]"
)


@dataclass(frozen=True)
class ChunkData:
    """Values that a camera sent with a frame; None for those it did not send.

    Parameters
    ----------
    exposure_us, gain_db : float or None
        With which it was taken.
    timestamp : int or None
        On the camera's clock, in units of the camera.
    counter : int or None
        Number of the frame since the acquisition or power-on.
    """

    exposure_us: float | None = None
    gain_db: float | None = None
    timestamp: int | None = None
    counter: int | None = None


def switch_on_chunks(camera: Any) -> None:
    """Have a camera send exposure, gain, timestamp and counter with each frame, as far as it can select them.

    A camera that refuses sends no chunks. Raises errors of Aravis if it does not answer.
    """
    if not writable(camera, CHUNK_MODE) or available(camera, _SELECTOR) is None:
        return
    try:
        entries = camera.dup_available_enumerations_as_strings(_SELECTOR)
        named = {f"{_WORD}{entry}": entry for entry in entries}
        wanted = {named[name] for names in _FEATURES.values() for name in names if name in named}
        if not wanted:
            return
        write_feature(camera, CHUNK_MODE, True)
        for entry in entries:
            write_feature(camera, _SELECTOR, entry)
            if writable(camera, _ENABLE) and read_feature(camera, _ENABLE) != (entry in wanted):
                write_feature(camera, _ENABLE, entry in wanted)
                # Some cameras switch the mode off with a chunk.
                write_feature(camera, CHUNK_MODE, True)
    except (CameraSettingError, gerror()) as error:
        if not isinstance(error, CameraSettingError) and is_of_transport(error):
            raise
        _log.info("the camera sends no chunk data: %s", error)
        with contextlib.suppress(CameraSettingError, gerror()):
            write_feature(camera, CHUNK_MODE, False)


class ChunkCheck:
    """Compares the chunk data of the frames of one stream with the settings, and with those of the frame before.

    Parameters
    ----------
    camera : Aravis.Camera
        Open.
    settings : CameraSettings
        In force.
    """

    def __init__(self, camera: Any, settings: CameraSettings) -> None:
        self._settings = settings
        self._readers: dict[str, tuple[str, Any]] = {}
        self._before: tuple[int, ChunkData] | None = None
        #: Of the last frame.
        self.data = ChunkData()
        if available(camera, CHUNK_MODE) is None or not read_feature(camera, CHUNK_MODE):
            return
        parser = camera.create_chunk_parser()
        read = {"GcFloat": parser.get_float_value, "GcInteger": parser.get_integer_value}
        for quantity, names in _FEATURES.items():
            name = next((name for name in names if kind_of(camera, name) in read), None)
            units = _UNITS.get(quantity)
            if name is not None and (units is None or unit_of(camera, name).casefold() in units):
                self._readers[quantity] = name, read[kind_of(camera, name)]

    def fault(self, buffer: Any) -> str | None:
        """Return what of a complete frame is not as set; None if all is, or the camera says nothing."""
        if not self._readers or not buffer.has_chunks():
            return None
        frame_id = buffer.get_frame_id()
        self.data = data = ChunkData(**{name: self._value(buffer, name) for name in self._readers})
        before, self._before = self._before, (frame_id, data)
        return self._difference(data) or (None if before is None else self._order(*before, frame_id, data))

    def _value(self, buffer: Any, quantity: str) -> Any:
        name, read = self._readers[quantity]
        with contextlib.suppress(gerror()):
            return read(buffer, name)
        return None

    def _difference(self, data: ChunkData) -> str | None:
        wanted_us, wanted_db = self._settings.exposure_s * 1e6, self._settings.gain_db
        if data.exposure_us is not None:
            rounding_us = max(_EXPOSURE_US, _EXPOSURE_REL * wanted_us)
            if not abs(data.exposure_us - wanted_us) <= rounding_us:
                return f"it was exposed for {data.exposure_us * 1e-3:.6g} ms, not for the {wanted_us * 1e-3:.6g} ms set"
        if data.gain_db is not None and not abs(data.gain_db - wanted_db) <= _GAIN_DB:
            return f"its gain was {data.gain_db:.4g} dB, not the {wanted_db:.4g} dB set"
        return None

    def _order(self, id_before: int, before: ChunkData, frame_id: int, data: ChunkData) -> str | None:
        if (twice := repetition(before, data)) is not None:
            return twice
        if before.counter is not None and data.counter is not None:
            n_unsent = n_frames_unsent(id_before, before.counter, frame_id, data.counter)
            if n_unsent:
                _log.warning("the camera counted %d frames more than it sent before frame %d", n_unsent, frame_id)
        return None


def repetition(before: ChunkData, data: ChunkData) -> str | None:
    """Return why a frame is the one before; None if it is another."""
    for name, value, other in (
        ("timestamp", data.timestamp, before.timestamp),
        ("frame counter", data.counter, before.counter),
    ):
        if value is not None and value == other:
            return f"its {name} {value} is that of the frame before: the camera sent it twice"
    return None


def n_frames_unsent(id_before: int, counter_before: int, frame_id: int, counter: int) -> int:
    """Return how many frames a camera counted between two that it sent, beyond those its ids leave out.

    An id or a counter that begins anew says nothing.
    """
    n_unsent = counter - counter_before - (frame_id - id_before)
    return n_unsent if frame_id > id_before and 0 < n_unsent <= _MOST_UNSENT else 0
