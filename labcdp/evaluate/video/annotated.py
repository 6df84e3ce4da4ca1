"""A video with what was measured drawn into it, and its frames as images: made while the video is evaluated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, isfinite, nan
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.disk.files import named_plainly, plain_name
from ...core.errors import InputError
from ...metrics.pair import bound_of_contrast
from ...metrics.region import SATURATED_SHARE
from ...output.file import put_in_place, temporary_name, write_file, writing
from ...report.text import bounded, fixed
from .dataset import note_text

if TYPE_CHECKING:
    from ...tracking import TrackedRoi


#: Colours of the first and of the other regions, of a lost one, and of text, as OpenCV has them: blue, green, red.
_REGIONS = ((0, 159, 230), (233, 180, 86), (115, 158, 0))
_LOST, _TEXT, _STRIP = (60, 120, 255), (235, 235, 235), (24, 24, 24)

#: OpenCV's FONT_HERSHEY_SIMPLEX.
_FONT = 0

#: A line of text with its colour.
_Line: TypeAlias = tuple[str, tuple[int, int, int]]

#: A picture narrower than this is enlarged, so that the text can be read.
_LEAST_WIDTH = 640

#: Frames a second of a video whose times are not known.
_USUAL_FPS = 25.0

#: Limits of the playback rate.
_SLOWEST_FPS, _FASTEST_FPS = 1.0, 500.0


class AnnotatedVideo:
    """An MPEG-4 video of the evaluated frames, with regions, quality and CDP drawn.

    Use it as a context; the file gets its name when the context ends without an error. Call it for each frame.

    Parameters
    ----------
    path : Path
        New file; ends in .mp4. It plays as fast as the video, by the times of the first two frames, but
        with one frame a second at least.

    Raises
    ------
    InputError
        If the name does not end in .mp4.
    """

    def __init__(self, path: Path) -> None:
        if path.suffix.lower() != ".mp4":
            raise InputError(f"the annotated video is {path}: give a name that ends in .mp4")
        self._path = path
        self._unfinished = temporary_name(path)
        self._writer: Any = None
        self._first: tuple[NDArray[np.uint8], float] | None = None
        self._n_frames = 0

    def __enter__(self) -> AnnotatedVideo:
        """Make the folder."""
        with writing(self._path.parent):
            self._path.parent.mkdir(parents=True, exist_ok=True)
        return self

    def __call__(
        self, number: int, grey: NDArray[np.uint8], regions: Sequence[TrackedRoi], row: Mapping[str, Any]
    ) -> None:
        """Add a frame.

        Parameters
        ----------
        number : int
            Of the frame.
        grey : ndarray of uint8, shape (height, width)
            The frame.
        regions : sequence of TrackedRoi
            Where the regions are in it; none for nearest-neighbour CDP.
        row : mapping
            Results of the frame by the names they have in the dataset.

        Raises
        ------
        InputError
            If the frame cannot be written.
        """
        picture, time_s = annotated_picture(number, grey, regions, row), float(row.get("time_s", nan))
        if self._writer is None:
            if self._first is None:
                self._first = picture, time_s
                return
            self._open(time_s)
        self._write(picture)

    def _write(self, picture: NDArray[np.uint8]) -> None:
        self._writer.write(picture)
        self._n_frames += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the file its name, or remove it after an error."""
        try:
            with writing(Path(self._path.name)):
                if kind is None and self._writer is None and self._first is not None:
                    self._open(nan)
                if self._writer is not None:
                    self._writer.release()
                    if kind is None:
                        self._check()
                        put_in_place(self._unfinished, self._path)
        finally:
            self._unfinished.unlink(missing_ok=True)

    def _open(self, second_s: float) -> None:
        """Begin the file with the first frame, now that the time of the second one is known, or that there is none."""
        import cv2

        assert self._first is not None
        picture, first_s = self._first
        step_s = second_s - first_s
        # Two decimals, as MPEG-4 counts time in up to 65535 ticks a second.
        fps = min(max(round(1 / step_s, 2), _SLOWEST_FPS), _FASTEST_FPS) if step_s > 0 else _USUAL_FPS
        height, width = picture.shape[:2]
        # MPEG-4 part 2: every player knows it, and OpenCV brings it everywhere.
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        with named_plainly(self._unfinished) as name:
            self._writer = cv2.VideoWriter(str(name), codec, fps, (width, height))
        if not self._writer.isOpened():
            raise InputError(
                f"{self._path.name} cannot be written as an MPEG-4 video of {width} x {height} pixels: give a folder "
                "you can write to, on a disk with enough space"
            )
        self._write(picture)

    def _check(self) -> None:
        """Compare what is in the file with what was written: OpenCV does not report a full disk."""
        import cv2

        with named_plainly(self._unfinished) as name:
            reader = cv2.VideoCapture(str(name))
            n_frames = int(reader.get(cv2.CAP_PROP_FRAME_COUNT)) if reader.isOpened() else 0
            reader.release()
        if n_frames != self._n_frames:
            raise InputError(
                f"{self._path.name} would have {n_frames} of {self._n_frames} frames: give a folder on a disk with "
                "enough space"
            )


@dataclass(frozen=True)
class FrameImages:
    """The evaluated frames as PNG images, as they are, in a folder named after the video.

    Call it for each frame.

    Parameters
    ----------
    folder : Path
        Made with the first frame.
    """

    folder: Path

    @classmethod
    def for_video(cls, folder: Path, video: Path) -> FrameImages:
        """Put the images of a video into a folder of its name below `folder`."""
        return cls(folder / (plain_name(video.stem) or "video"))

    def __call__(
        self, number: int, grey: NDArray[np.uint8], regions: Sequence[TrackedRoi], row: Mapping[str, Any]
    ) -> None:
        """Write a frame as frame-000123.png; raises InputError if it cannot be written."""
        import cv2

        name = f"frame-{number:06d}.png"
        done, data = cv2.imencode(".png", grey)
        if not done:
            raise InputError(f"frame {number} cannot be written as PNG: it is of shape {grey.shape}")
        with writing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        write_file(self.folder / name, data.tobytes())


def annotated_picture(
    number: int, grey: NDArray[np.uint8], regions: Sequence[TrackedRoi], row: Mapping[str, Any]
) -> NDArray[np.uint8]:
    """Draw regions into a frame, and the results below it; see `AnnotatedVideo` for the arguments.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Blue, green, red; height and width are even, as video needs it.
    """
    import cv2

    enlarged = max(1, ceil(_LEAST_WIDTH / grey.shape[1])) if grey.shape[1] < _LEAST_WIDTH else 1
    height, width = (side * enlarged for side in grey.shape)
    picture = cv2.cvtColor(
        cv2.resize(grey, (width, height), interpolation=cv2.INTER_NEAREST) if enlarged > 1 else grey, cv2.COLOR_GRAY2BGR
    )
    scale = max(0.45, width / 1600)
    for index, tracked in enumerate(regions):
        _draw_region(picture, tracked, _REGIONS[min(index, len(_REGIONS) - 1)], enlarged, scale)
    strip = _strip(width, _lines(number, regions, row), scale)
    whole = np.concatenate([picture, strip])
    bottom, right = (side % 2 for side in whole.shape[:2])
    even: NDArray[np.uint8] = np.pad(whole, ((0, bottom), (0, right), (0, 0)), mode="edge")
    return even


def _draw_region(
    picture: NDArray[np.uint8], tracked: TrackedRoi, colour: tuple[int, int, int], enlarged: int, scale: float
) -> None:
    import cv2

    # OpenCV counts from the centre of the first pixel, regions from its corner; 1/16 pixels.
    corners = np.rint((np.array(tracked.roi.corners) * enlarged - 0.5) * 16).astype(np.int32)
    if tracked.lost:
        colour = _LOST
    thickness = max(2, round(1.6 * scale))
    for outline, width in (((0, 0, 0), thickness + 2), (colour, thickness)):
        cv2.polylines(picture, [corners], True, outline, width, cv2.LINE_AA, 4)
    name = _ascii(tracked.roi.name)
    text = f"{name} LOST" if tracked.lost else f"{name} {fixed(tracked.quality, 2)}"
    x0, y0, x1, y1 = (side * enlarged for side in tracked.roi.bounds)
    (text_width, text_height), base = cv2.getTextSize(text, _FONT, scale, 1)
    above = y0 - base - 6 > text_height
    x = round(min(max((x0 + x1 - text_width) / 2, 4), max(picture.shape[1] - text_width - 4, 4)))
    y = round(y0 - base - 4 if above else min(y1 + text_height + 6, picture.shape[0] - base - 2))
    # On a dark box, as the light of the scene may have any brightness.
    cv2.rectangle(picture, (x - 3, y - text_height - 3), (x + text_width + 3, y + base), _STRIP, cv2.FILLED)
    cv2.putText(picture, text, (x, y), _FONT, scale, colour, 1, cv2.LINE_AA)


def _lines(number: int, regions: Sequence[TrackedRoi], row: Mapping[str, Any]) -> list[_Line]:
    """Text below the picture: frame and time, results, and why there are none."""
    time = float(row.get("time_s", nan))
    head = f"frame {number}" + (f"   {fixed(time, 2)} s" if isfinite(time) else "")
    lost = [tracked for tracked in regions if tracked.lost]
    if lost:
        why = "; ".join(note_text(tracked.reasons) or tracked.roi.name for tracked in lost)
        return [(head, _TEXT), (_ascii(f"LOST {why}"), _LOST)]
    note = str(row.get("note", ""))
    if note and not np.isfinite(np.asarray(row.get("cdp", nan), dtype=float)).any():
        return [(head, _TEXT), (_ascii(note), _LOST)]
    return [(_ascii(f"{head}   {note}") if note else head, _TEXT), (_results(row), _TEXT)]


def _results(row: Mapping[str, Any]) -> str:
    contrast, name = float(row.get("reference_contrast", nan)), "reference_cdp"
    if isfinite(contrast):
        low, high = (float(row.get(f"{name}_{end}", nan)) for end in ("low", "high"))
        text = f"CDP({100 * contrast:.4g} %) {fixed(float(row[name]), 3)}"
        text += f" [{fixed(low, 3)}, {fixed(high, 3)}]" if isfinite(low) and isfinite(high) else ""
    else:
        text = f"CDP {', '.join(fixed(value, 3) for value in np.atleast_1d(row['cdp'])[:4].tolist())}"
    measured = float(row.get("measured_contrast", nan))
    means, saturated = row.get("mean", ()), row.get("saturated", ())
    full = [share > SATURATED_SHARE for _, share in sorted(zip(means, saturated, strict=False))]
    bound = bound_of_contrast(full[1], full[0]) if len(full) == 2 else ""
    shown = bounded(100 * measured, bound) if bound else f"{100 * measured:.4g}"
    return text + (f"   contrast {shown} %" if isfinite(measured) else "")


def _strip(width: int, lines: Sequence[_Line], scale: float) -> NDArray[np.uint8]:
    """Draw lines of text on a dark strip; a line too wide gets smaller letters."""
    import cv2

    line_height = round(34 * scale) + 4
    strip = np.full((line_height * len(lines) + 8, width, 3), _STRIP, np.uint8)
    for line, (text, colour) in enumerate(lines, start=1):
        (text_width, _), _ = cv2.getTextSize(text, _FONT, scale, 1)
        fitting = scale * min(1.0, (width - 16) / max(text_width, 1))
        where = (8, line * line_height - round(8 * scale))
        cv2.putText(strip, text, where, _FONT, fitting, colour, 1, cv2.LINE_AA)
    return strip


def _ascii(text: str) -> str:
    """Replace letters that OpenCV's font does not have."""
    return text.encode("ascii", "replace").decode()
