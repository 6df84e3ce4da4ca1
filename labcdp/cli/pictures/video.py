"""Command video: CDP of videos, frame by frame, with regions that follow their objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ...core.disk.files import shown
from ...core.errors import InputError, LabcdpError
from ...core.result import Result
from ...core.roi import Roi
from ...evaluate.judgement import verdicts_of
from ...evaluate.video.evaluate import evaluate_parts, require_same_evaluation
from ...evaluate.video.page import write_video
from ...evaluate.video.settings import Observer, Progress, Reference, VideoSettings, load_reference, video_configuration
from ...files.kinds import no_video
from ...files.video.open import left_out, video_paths
from ...output import ResultsFolder
from ...regions import ImageSize
from ...report.files import envelope
from ...tracking import method_among
from ..commands import As
from ..options import ClusterOptions, FlickerOptions, Results, end_by_requirement, require_apart, require_together
from ..terminal import progress_bars, say
from ..values import fraction_of_percent
from .frames import FrameOptions
from .options import (
    ChartOptions,
    LightOptions,
    PairOptions,
    each_once,
    parse_pairs,
    read_chart,
    read_regions,
    require_kind,
)

if TYPE_CHECKING:
    from ...evaluate.flicker.settings import FlickerSettings

#: First bytes of TIFF and BigTIFF files.
_TIFF = b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"


def _reference(text: str, name: str) -> Reference:
    """Return a reference contrast, or where it is; raises InputError."""
    if text == "first":
        return "first"
    if text.endswith("%"):
        contrast = fraction_of_percent(text, name)
        if not contrast > 0:
            raise InputError(f"{name} is {shown(text)}: give a contrast above 0%")
        return contrast
    if not Path(text).is_file():
        raise InputError(
            f"{name} is {shown(text)}: give a contrast such as 1000%, first, or results.nc of another video"
        )
    return Path(text)


@dataclass(frozen=True)
class VideoPairOptions(PairOptions):
    """Options of regions in videos: how they are followed, and what contrast frames are compared with.

    Parameters
    ----------
    method
        Tracking method: follow, homography (flat targets that tilt) or fixed; different ones for some regions:
        follow,wall=fixed.
    reference
        Reference contrast of each frame: a value such as 1000%, first (contrast of the first frame), or results.nc of
        another video, for example from a calibrated camera.
    reference_by
        Match frames of a reference video by number or time.
    colours
        Also tell in each frame how well the colours of the regions can be told apart.
    """

    method: str = "follow"
    reference: Annotated[float | Path | Literal["first"] | None, As(parse=_reference)] = None
    reference_by: Literal["number", "time"] = "number"
    colours: bool = False


def _frame_range(text: str, name: str) -> tuple[int, int]:
    """Return the first frame of a range and the one before which it ends; raises InputError."""
    first, colon, stop = text.partition(":")
    if not (colon and first.strip().isdecimal() and stop.strip().isdecimal()):
        raise InputError(f"{name} is {shown(text)}: give first frame and the one after the last, for example 0:25")
    return int(first), int(stop)


@dataclass(frozen=True)
class VideoFlickerOptions(FlickerOptions):
    """Options of the flicker of lamps in videos.

    Parameters
    ----------
    flicker
        Evaluate how the light of each region flickers from frame to frame instead of CDP: FMI, MMP and FDI.
    off_frames
        Frames with the lamp off, for example 0:25, also before --start; they give the light without it for the FDI.
    flicker_threshold
        Excess over that light from which a frame shows the lamp, for the FDI; default: 10%.
    """

    off_frames: Annotated[tuple[int, int] | None, As(parse=_frame_range)] = None

    def flicker_limits(self) -> dict[str, Any]:
        """Return what is given besides `flicker`, by the names of `FlickerSettings`."""
        frames = {} if self.off_frames is None else {"off_frames": self.off_frames}
        return frames | super().flicker_limits()


@dataclass(frozen=True)
class VideoOptions(
    Results, ClusterOptions, FrameOptions, LightOptions, VideoFlickerOptions, ChartOptions, VideoPairOptions
):
    """Options of the command.

    Parameters
    ----------
    annotated
        Also write a video with regions, tracking quality and CDP.
    frames
        Also write each evaluated frame as a PNG image.
    """

    annotated: bool = False
    frames: bool = False

    def file_settings(self) -> dict[str, Any]:
        """Return what is given about files, frames and the conversion to light, by the names of `VideoSettings`."""
        return {
            "selection": self.selection(),
            "frame_rate_hz": self.frame_rate,
            "damaged": self.damaged,
            "calibration": self.calibration,
            "camera": self.camera_spec,
            "encoding": self.encoding,
            **self.stated(),
        }


def video(options: VideoOptions, files: tuple[Path, ...]) -> None:
    """Compute the contrast detection probability between two regions for each frame of a video.

    The regions follow their objects; frames in which one is lost have no value. Without --contrast, the contrast
    measured in the first frame is used. Without calibration and camera specification, luminance is relative, and
    contrasts of regions at different places include the lens's vignetting. Writes a page with a plot over time, a
    spreadsheet and NetCDF. The same command resumes an interrupted evaluation. Several videos are evaluated on all
    cores, several pairs of a video in one pass. With --flicker the flicker of lamps in the regions is
    evaluated instead, with --chart the dynamic range and all patches of a chart.

    Example: labcdp video drive.mp4 --roi rois.json --contrast 10%:200%:20 --reference 1000%

    Parameters
    ----------
    files : VIDEO...
        Video files, folders of numbered images, recorded sessions; or a folder of video files.
    """
    require_kind(files, _no_video)
    require_together({"--corners": options.corners}, {"--chart": options.chart})
    require_apart({"--chart": options.chart}, {"--flicker": options.flicker or None})
    if options.flicker:
        _flicker(options, files)
        return
    options.require_flicker()
    if options.chart is not None:
        _chart(options, files)
        return
    if options.colours and options.roi is None:
        raise InputError("--colours compares regions: give them with --roi")
    named, pairs, image_size = _regions(options)
    common = VideoSettings(
        **options.targets(),
        image_size=image_size,
        reference_by=options.reference_by,
        colours=options.colours,
        **options.file_settings(),
    )

    def settings_of(*pair: str) -> VideoSettings:
        how = options.method
        if pair:
            how = method_among(how, list(named), (pair[0], pair[1]))
        return replace(common, rois=tuple(named[name] for name in pair), method=how, reference=options.reference)

    # Any two of many regions show whether all else is right.
    settings = settings_of(*(pairs[0] if pairs else ()))
    paths = _paths(files)
    of_pairs = {":".join(pair): settings_of(*pair) for pair in (pairs if len(pairs) > 1 else ())}
    if len(paths) == 1 and options.cluster is None and not of_pairs:
        folder = options.folder(paths[0])
        with folder, progress_bars() as bars:

            def progress(done: int, total: int | None) -> None:
                bars.set("Frames", done, done if total is None else total)

            result = evaluate_and_write({"": settings}, options, paths[0], {"": folder}, progress)[""]
            if isinstance(result, LabcdpError):
                raise result
        options.show(result, folder)
        end_by_requirement(verdicts_of(result))
        return
    folder = options.folder(files[0] if len(files) == 1 else "videos", resume=True)
    _several(paths, settings, of_pairs, folder, options)


def _flicker(options: VideoOptions, files: Sequence[Path]) -> None:
    """Evaluate the flicker of regions of a video."""
    from ...evaluate.flicker.page import evaluate_flicker, write_flicker
    from ...evaluate.flicker.settings import FlickerSettings

    others = {
        "--pair": options.pair, "--neighbours": options.neighbours, "--contrast": options.contrast,
        "--epsilon": options.epsilon, "--cdp-limit": options.cdp_limit, "--require": options.require,
        "--reference": options.reference, "--colours": options.colours, "--annotated": options.annotated,
        "--frames": options.frames,
    }  # fmt: skip
    given = [name for name, value in others.items() if value]
    if given:
        raise InputError(f"--flicker compares no regions: leave {', '.join(given)} out")
    paths = _paths(files)
    rois, image_size, _ = read_regions(options)
    settings = FlickerSettings(
        rois=rois,
        method=options.method,
        image_size=image_size,
        **options.flicker_limits(),
        **options.file_settings(),
    )
    if len(paths) > 1 or options.cluster is not None:
        folder = options.folder(files[0] if len(files) == 1 else "videos", resume=True)
        _flicker_of_several(paths, settings, folder, options)
        return
    folder = options.folder(paths[0])
    with folder, progress_bars() as bars:

        def progress(done: int, total: int | None) -> None:
            bars.set("Frames", done, done if total is None else total)

        dataset, regions = evaluate_flicker(paths[0], settings, folder, progress=progress)
        result = write_flicker(dataset, regions, folder)
    options.show(result, folder)


def _flicker_of_several(
    paths: Sequence[Path], settings: FlickerSettings, folder: ResultsFolder, options: VideoOptions
) -> None:
    """Evaluate the flicker of several videos, on all cores; raises InputError."""
    from ...evaluate.flicker.archive import flicker_archive, flicker_archive_page, flicker_values
    from ...evaluate.flicker.record import flicker_configuration
    from ...evaluate.video.archive import archive_tasks, evaluate_archive, require_same_archive
    from ...evaluate.video.archive_page import archive_files

    tasks = archive_tasks(paths, folder.folder)
    if not options.force:
        require_same_archive(tasks, folder.folder)
    inputs = [path for path in (settings.calibration, settings.camera) if path is not None]
    with folder:
        folder.keep()
        with progress_bars() as bars:
            archive = evaluate_archive(
                tasks,
                partial(flicker_values, settings),
                flicker_configuration(settings),
                options.chosen_workers(),
                progress=lambda done, total: bars.set("Videos", done, total),
                force=options.force,
                inputs=inputs,
            )
        folder.complete = not archive.failures
        result = flicker_archive(archive)
        folder.add(archive_files(result, flicker_archive_page(result)))
    where_they_are = f"{result.table('videos').note} Results are in {folder.folder}, a folder for each"
    options.print(result, where_they_are, page=folder.folder / "archive.html")
    if archive.failures:
        say(f"labcdp: {len(archive.failures)} of {len(archive.outcomes)} videos failed")
        raise typer.Exit(1)


def _chart(options: VideoOptions, files: Sequence[Path]) -> None:
    """Evaluate a chart in each frame of a video."""
    from ...evaluate.chart_video.evaluate import evaluate_chart_video
    from ...evaluate.chart_video.page import write_chart_video
    from ...evaluate.chart_video.settings import ChartVideoSettings

    others = {
        "--pair": options.pair, "--neighbours": options.neighbours, "--require": options.require,
        "--reference": options.reference, "--colours": options.colours, "--annotated": options.annotated,
        "--frames": options.frames, "--cluster": options.cluster,
    }  # fmt: skip
    given = [name for name, value in others.items() if value]
    if given:
        raise InputError(f"--chart compares all patches: leave {', '.join(given)} out")
    paths = _paths(files)
    if len(paths) > 1:
        raise InputError(f"--chart takes one video, and {len(paths)} are given: evaluate them one after the other")
    chart, rois, image_size, inputs = read_chart(options)
    settings = ChartVideoSettings(
        **options.targets(),
        rois=rois,
        method=options.method,
        image_size=image_size,
        chart=chart,
        inputs=tuple(inputs),
        **options.file_settings(),
    )
    folder = options.folder(paths[0])
    with folder, progress_bars() as bars:

        def progress(done: int, total: int | None) -> None:
            bars.set("Frames", done, done if total is None else total)

        dataset = evaluate_chart_video(paths[0], settings, folder, progress=progress)
        result = write_chart_video(dataset, folder)
    options.show(result, folder)


def _regions(options: VideoPairOptions) -> tuple[dict[str, Roi], tuple[tuple[str, str], ...], ImageSize | None]:
    """Regions by name, their pairs: those given, or the only one, and the size of their image; none without a file."""
    if options.neighbours and (options.roi is not None or options.pair):
        raise InputError("--neighbours needs no regions: leave --roi and --pair out, or --neighbours")
    rois, image_size, _ = read_regions(options)
    pairs, regions = parse_pairs(options, [roi.name for roi in rois]), {roi.name: roi for roi in rois}
    if regions and not pairs:
        if len(regions) != 2:
            raise InputError(
                f"{options.roi} holds {len(regions)} regions ({', '.join(regions)}): choose pairs with --pair "
                "BRIGHT:DARK"
                if len(regions) > 2
                else f"{options.roi} contains one region: draw a second one, a CDP needs two"
            )
        first, second = regions
        pairs = ((first, second),)
    unpaired = [name for name in regions if not any(name in pair for pair in pairs)]
    if unpaired:
        say(f"Note: in no --pair and not followed: {', '.join(map(shown, unpaired))}")
    return regions, pairs, image_size


def evaluate_and_write(
    settings: Mapping[str, VideoSettings],
    options: VideoOptions,
    path: Path,
    folders: Mapping[str, ResultsFolder],
    progress: Progress | None = None,
) -> dict[str, Result | LabcdpError]:
    """Evaluate pairs of regions of a video in one pass and write the results of each; return them, or why not.

    Raises
    ------
    LabcdpError
        If the video cannot be evaluated.
    """
    with ExitStack() as drawing:
        observers = [_observer(options, path, folder, drawing) for folder in folders.values()]
        parts = [settings[name] for name in folders]
        datasets = evaluate_parts(path, parts, [*folders.values()], observers, progress=progress)
    results_by_part: dict[str, Result | LabcdpError] = {}
    for dataset, (name, folder) in zip(datasets, folders.items(), strict=True):
        try:
            results_by_part[name] = dataset if isinstance(dataset, LabcdpError) else write_video(dataset, folder)
        except LabcdpError as error:
            results_by_part[name] = error
    return results_by_part


def _observer(options: VideoOptions, path: Path, results: ResultsFolder, drawing: ExitStack) -> Observer | None:
    """Return what draws the frames, None for nothing."""
    if not (options.annotated or options.frames):
        return None
    from ...evaluate.video.annotated import AnnotatedVideo, FrameImages

    observers: list[Observer] = []
    if options.annotated:
        observers.append(drawing.enter_context(AnnotatedVideo(results.path("annotated.mp4"))))
    if options.frames:
        observers.append(FrameImages.for_video(results.path("."), path))

    def observer(*seen: Any) -> None:
        for draw in observers:
            draw(*seen)

    return observer


def evaluate_values(
    settings: Mapping[str, VideoSettings], options: VideoOptions, path: Path, folders: Mapping[str, ResultsFolder]
) -> dict[str, dict[str, Any] | LabcdpError]:
    """Do the same, with results as JSON values, which can be sent from another process."""
    results_by_part = evaluate_and_write(settings, options, path, folders)
    return {
        name: envelope(result) if isinstance(result, Result) else result for name, result in results_by_part.items()
    }


def _several(
    paths: Sequence[Path],
    settings: VideoSettings,
    of_pairs: Mapping[str, VideoSettings],
    folder: ResultsFolder,
    options: VideoOptions,
) -> None:
    from ...evaluate.video.archive import archive_tasks, evaluate_archive, require_same_archive
    from ...evaluate.video.archive_page import archive_files, archive_result

    tasks = archive_tasks(paths, folder.folder, tuple(of_pairs))
    if not options.force:
        for task in tasks:
            require_same_evaluation((task.folder,), of_pairs.get(task.part, settings))
        require_same_archive(tasks, folder.folder)
    configuration = {
        **video_configuration(settings, load_reference(settings)),
        "annotated": options.annotated,
        "frames": options.frames,
    }
    if of_pairs:
        configuration["pairs"] = {
            name: video_configuration(settings_of_pair, load_reference(settings_of_pair))
            for name, settings_of_pair in of_pairs.items()
        }
    read = (settings.reference, settings.calibration, settings.camera)
    result: Result | None = None
    try:
        with folder:
            folder.keep()
            with progress_bars() as bars:
                archive = evaluate_archive(
                    tasks,
                    partial(evaluate_values, of_pairs or {"": settings}, options),
                    configuration,
                    options.chosen_workers(),
                    progress=lambda done, total: bars.set("Videos", done, total),
                    force=options.force,
                    inputs=[path for path in read if isinstance(path, Path)],
                )
            folder.complete = not archive.failures
            result = archive_result(archive)
            folder.add(archive_files(result))
    finally:
        # The outcomes are printed even if the disk is full.
        if result is not None:
            where_they_are = f"{result.table('videos').note} Results are in {folder.folder}, a folder for each"
            options.print(result, where_they_are, page=folder.folder / "archive.html")
    if archive.failures:
        say(f"labcdp: {len(archive.failures)} of {len(archive.outcomes)} videos failed")
        raise typer.Exit(1)
    end_by_requirement(verdicts_of(result))


def _paths(files: Sequence[Path]) -> list[Path]:
    """Videos to evaluate, each once."""
    for given in files:
        for folder in left_out(given) if video_paths([given]) != [given] else ():
            say(f"Note: {folder} contains images and is skipped, since {given} contains videos: give {folder} itself")
    return each_once(video_paths(files), "video")


def _no_video(path: Path, head: bytes) -> InputError | None:
    """Return the error of a picture; a TIFF may hold a stack of frames, and Motion JPEG begins as a JPEG does."""
    if head[:4] in _TIFF:
        return None
    return no_video(path, head, path.suffix.lower() in (".jpg", ".jpeg"))
