"""Videos: CDP frame by frame, with regions that follow their objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from xarray import Dataset

from ..calibration import AnyCalibration, Calibration, ColourCalibration, save
from ..core.errors import InputError, LabcdpError
from ..core.result import html_table
from ..evaluate.picture.converter import Converter
from ..evaluate.video.evaluate import evaluate_parts
from ..evaluate.video.settings import Progress, VideoSettings
from ..files.transfer import Encoding
from ..files.video.open import open_video as open_source
from ..files.video.selection import Position, Selection
from ..files.video.source import VideoSource
from ..tracking import methods_of
from .arguments import (
    Contrasts,
    Pairs,
    PathArgument,
    Regions,
    Tolerance,
    as_contrasts,
    as_pairs,
    as_patches,
    as_path,
    as_rois,
    as_text,
)
from .picture import StatedOfVideo, converter_of
from .tracked_regions import TrackedRegions
from .variables import described

if TYPE_CHECKING:
    from ..regions.chart import Corners


def open_video(
    path: PathArgument,
    *,
    calibration: PathArgument | AnyCalibration | None = None,
    camera_spec: PathArgument | None = None,
    encoding: Encoding | None = None,
    **stated: Unpack[StatedOfVideo],
) -> Video:
    """Open a video for evaluation.

    Without calibration and camera specification the values are relative luminance, as for `labcdp.read_image`.

    Parameters
    ----------
    path : path
        A video file, a folder of numbered images, or a recorded session.
    calibration, camera_spec, encoding, exposure_s, gain_db, temperature_c, bit_depth, black_level_dn, bayer, \
focal_length_m, pixel_pitch_m, no_vignetting
        As for `labcdp.read_image`.
    frame_rate_hz
        Frames a second of images, which state no times.

    Returns
    -------
    Video

    Raises
    ------
    InputError
        If the video cannot be read, or an argument cannot be used.

    Examples
    --------
    >>> import labcdp
    >>> from labcdp.session import example_session
    >>> video = labcdp.open_video(example_session())
    >>> video.shape
    (400, 480)
    """
    file = as_path(path, "the video")
    converter = converter_of(calibration, camera_spec, encoding, stated, StatedOfVideo)
    spec = None if camera_spec is None else as_path(camera_spec, "camera_spec")
    known = {"encoding": encoding, **stated}
    return Video(open_source(file, converter.options), converter, calibration, spec, known)


@dataclass(frozen=True, eq=False, repr=False)
class Video:
    """A video; made by `labcdp.open_video`.

    Parameters
    ----------
    source : VideoSource
        The frames.
    converter : Converter
        Conversion of their values to luminance.
    calibration : path, Calibration or None
        For luminance in cd/m^2.
    camera_spec : Path or None
        For luminance by guessed parameters.
    stated : dict
        Statements of the user about the video, None for nothing.

    Examples
    --------
    >>> import labcdp
    >>> from labcdp.session import example_session
    >>> video = labcdp.open_video(example_session())
    >>> regions = [labcdp.Roi.rectangle("a", 10, 10, 20, 20), labcdp.Roi.rectangle("b", 40, 10, 20, 20)]
    >>> tracked = video.track(regions, "fixed")
    >>> video.frame_count
    6
    """

    source: VideoSource
    converter: Converter
    calibration: PathArgument | AnyCalibration | None
    camera_spec: Path | None
    stated: dict[str, Any]

    @property
    def path(self) -> Path:
        """File or folder."""
        return self.source.path

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the frames in pixels."""
        return self.source.shape

    @property
    def frame_count(self) -> int | None:
        """Number of frames as the file announces it; None if it does not."""
        return self.source.frame_count

    @property
    def frame_rate(self) -> float | None:
        """Frames per second as the file announces it; None if it does not."""
        return self.source.frame_rate

    def track(
        self,
        regions: Regions,
        method: str = "follow",
        *,
        pairs: Pairs | None = None,
        start: int | str = 0,
        stop: int | str | None = None,
        every: int | str = 1,
    ) -> TrackedRegions:
        """Choose regions in the first frame, which follow their objects.

        Parameters
        ----------
        regions : path, list of Roi, or dict
            As for `Image.regions`.
        method : {'follow', 'homography', 'fixed'} or str
            Tracking method; other methods for some regions: ``"follow,wall=fixed"``.
        pairs : list of (str, str) or None
            Two regions by name; None for all pairs of up to six regions. The video is read once.
        start, stop, every : int or str
            First frame, in which the regions are, frame to stop before, and distance of the frames that are evaluated:
            numbers of frames, or times such as ``"10s"`` and ``"1:30"``.

        Raises
        ------
        InputError
            If an argument cannot be used.
        """
        height, width = self.shape
        rois = as_rois(regions, (width, height))
        methods_of(as_text(method, "method"), [roi.name for roi in rois])
        return TrackedRegions(
            self.path.name,
            self.evaluate,
            rois,
            as_pairs(rois, pairs),
            method,
            _selection(start, stop, every),
        )

    def flicker(
        self,
        regions: Regions,
        method: str = "follow",
        *,
        off_frames: tuple[int, int] | None = None,
        threshold: float = 0.1,
        tolerance: float = 0.1,
        frequency_hz: float | None = None,
        start: int | str = 0,
        stop: int | str | None = None,
        every: int | str = 1,
        progress: Progress | None = None,
    ) -> Dataset:
        """Evaluate how the light of regions flickers from frame to frame, as of pulsed lamps.

        Parameters
        ----------
        regions, method, start, stop, every
            As for `track`.
        off_frames : (int, int) or None
            First frame with the lamp off, and the one before which such frames end; they give the light without it.
            They may be before `start`, with the regions where they are in that frame.
        threshold, tolerance, frequency_hz
            As for `labcdp.flicker`.
        progress : callable or None
            Called after each frame.

        Returns
        -------
        xarray.Dataset
            ``fmi``, ``fdi`` and ``mmp`` over region, each with ``u_...``, ``..._low`` and ``..._high`` (95 %), the
            phases and the beat; and ``mean`` over frame and region, nan where a region is lost, saturated or black.

        Raises
        ------
        InputError
            If an argument cannot be used, or no region has a value in any frame.

        Examples
        --------
        >>> import labcdp
        >>> from labcdp.session import example_session
        >>> video = labcdp.open_video(example_session())
        >>> lamp = labcdp.Roi.rectangle("lamp", 100, 100, 40, 40)
        >>> flicker = video.flicker([lamp], "fixed")
        >>> flicker.sizes["frame"], bool(flicker["few_phases"][0])
        (6, True)
        """
        from ..evaluate.flicker.page import evaluate_flicker
        from ..evaluate.flicker.settings import FlickerSettings

        height, width = self.shape
        with self._light() as light:
            settings = FlickerSettings(
                rois=as_rois(regions, (width, height)),
                method=as_text(method, "method"),
                selection=_selection(start, stop, every),
                off_frames=off_frames,
                threshold=threshold,
                tolerance=tolerance,
                frequency_hz=frequency_hz,
                **light,
            )
            dataset, _ = evaluate_flicker(self.path, settings, progress=progress)
        return described(dataset, dataset.attrs["unit"])

    def chart(
        self,
        chart: PathArgument,
        contrasts: Contrasts | None = None,
        epsilon: Tolerance = 0.5,
        *,
        corners: Corners | None = None,
        regions: Regions | None = None,
        method: str = "follow",
        start: int | str = 0,
        stop: int | str | None = None,
        every: int | str = 1,
        progress: Progress | None = None,
    ) -> Dataset:
        """Measure a chart in each frame: all patches against all, and the dynamic range of the camera.

        Parameters
        ----------
        chart, contrasts, epsilon
            As for `Image.chart`; without values of the chart and contrasts, those measured in the first frame.
        corners, regions
            As for `Image.chart`, in the first frame.
        method : {'follow', 'homography', 'fixed'}
            How the patches are followed; a flat chart is where most of them agree.
        start, stop, every
            As for `track`.
        progress : callable or None
            Called after each frame.

        Returns
        -------
        xarray.Dataset
            Mean and SNR over ``frame`` and ``patch``; the dynamic ranges over ``frame`` and ``range``; and of each pair
            of patches over ``bright`` and ``dark`` (and ``contrast``, if several are given) the mean CDP of the frames,
            the lowest one with its 95 % interval and its frame, and the share of the frames that detect the contrast.

        Raises
        ------
        InputError
            If an argument cannot be used, the chart is not found in the first frame, or it is measured in none.

        Examples
        --------
        >>> from pathlib import Path
        >>> import labcdp
        >>> from labcdp.evaluate.chart.chart_file import chart_template
        >>> from labcdp.session import example_session
        >>> written = Path("chart.toml").write_text(chart_template("thesis-2x2"))
        >>> video = labcdp.open_video(example_session())
        >>> square = [(100, 100), (300, 100), (300, 300), (100, 300)]
        >>> measured = video.chart("chart.toml", corners=square, method="fixed")
        >>> measured["mean_cdp"].dims
        ('bright', 'dark')
        """
        from ..evaluate.chart.chart_file import load_chart
        from ..evaluate.chart_video.evaluate import evaluate_chart_video
        from ..evaluate.chart_video.settings import ChartVideoSettings

        request, (loaded, files) = as_contrasts(contrasts, epsilon), load_chart(as_path(chart, "the chart"))
        height, width = self.shape
        with self._light() as light:
            settings = ChartVideoSettings(
                request.values,
                rois=as_patches(loaded, corners, regions, (width, height)),
                method=as_text(method, "method"),
                epsilon=request.epsilon,
                selection=_selection(start, stop, every),
                chart=loaded,
                inputs=tuple(files),
                **light,
            )
            dataset = evaluate_chart_video(self.path, settings, progress=progress)
        dataset = described(dataset, dataset.attrs["unit"])
        return dataset.isel(contrast=0) if request.scalar and "contrast" in dataset.dims else dataset

    def cdp_neighbours(
        self,
        contrasts: Contrasts,
        epsilon: Tolerance = 0.5,
        *,
        start: int | str = 0,
        stop: int | str | None = None,
        every: int | str = 1,
        progress: Progress | None = None,
    ) -> Dataset:
        """Compute the CDP of each pixel against its right and lower neighbour, frame by frame.

        Parameters
        ----------
        contrasts, epsilon
            As for `Image.cdp_neighbours`.
        start, stop, every
            As for `track`.
        progress : callable or None
            Called after each frame.

        Returns
        -------
        xarray.Dataset
            Over frame and contrast; without the latter for a number.
        """
        request = as_contrasts(contrasts, epsilon)
        if request.values is None:
            raise InputError("contrasts is None: give a number, or a list, as fractions")
        settings = VideoSettings(request.values, epsilon=request.epsilon, selection=_selection(start, stop, every))
        (dataset,) = self.evaluate([settings], progress)
        assert not isinstance(dataset, LabcdpError)
        dataset = described(dataset, dataset.attrs["unit"])
        return dataset.isel(contrast=0) if request.scalar else dataset

    def evaluate(
        self, settings: Sequence[VideoSettings], progress: Progress | None = None
    ) -> list[Dataset | LabcdpError]:
        """Evaluate several settings in one pass; returns for each its results, or the error that prevented them.

        Raises
        ------
        LabcdpError
            If there are none at all.
        """
        with self._light() as light:
            results = evaluate_parts(self.path, [replace(setting, **light) for setting in settings], progress=progress)
        if all(isinstance(part, LabcdpError) for part in results):
            raise next(part for part in results if isinstance(part, LabcdpError))
        return results

    @contextmanager
    def _light(self) -> Iterator[dict[str, Any]]:
        """Give the settings of the conversion to luminance; a calibration that is no file becomes one for the time."""
        with TemporaryDirectory(prefix="labcdp-") as folder:
            calibration = self.calibration
            if isinstance(calibration, Calibration | ColourCalibration):
                save(calibration, Path(folder) / "calibration.json")
                calibration = Path(folder) / "calibration.json"
            path = None if calibration is None else Path(calibration)
            yield {"calibration": path, "camera": self.camera_spec, **self.stated}

    def __repr__(self) -> str:
        height, width = self.shape
        frames = "unknown number of" if self.frame_count is None else self.frame_count
        return f"<labcdp.Video {self.path.name}: {frames} frames of {width} x {height} pixels>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        height, width = self.shape
        rows = [("frames", f"{self.frame_count}"), ("frames per second", f"{self.frame_rate}")]
        return html_table(("", ""), [*rows, ("pixels", f"{width} x {height}")], self.path.name)


def _selection(start: int | str, stop: int | str | None, every: int | str) -> Selection:
    return Selection(
        _position(start, "start"), None if stop is None else _position(stop, "stop"), _position(every, "every")
    )


def _position(value: int | str, name: str) -> Position:
    if isinstance(value, str):
        return Position.parse(value, name)
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(f"{name} is {value!r}: give a number of frames, or a time such as '10s'")
    return Position(frames=int(value))
