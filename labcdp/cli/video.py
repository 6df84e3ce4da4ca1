"""Command video: CDP of videos, frame by frame, with regions that follow their objects."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import typer

from ..errors import InputError
from .batch import Failure, end_batch
from .contrasts import CONTRAST_HELP, parse_contrasts
from .picture_options import BITS_OPTION, EXPOSURE_OPTION, GAIN_OPTION, seconds
from .terminal import JSON_OPTION, fraction_of_percent, print_json, print_table, progress_bars, say

if TYPE_CHECKING:
    from ..evaluate.archive import ArchiveResult
    from ..evaluate.video_settings import Observer, Reference, VideoSettings
    from ..roi import Roi

_ENCODINGS = ("linear", "srgb")
_MATCHED_BY = ("number", "time")


def video(
    files: list[Path] = typer.Argument(
        metavar="VIDEO...",
        help="Video files, folders of numbered images, recorded sessions; or a folder of video files.",
    ),
    roi: Path | None = typer.Option(
        None, "--roi", help="File with the regions in the first frame: JSON as labcdp rois saves it, or ImageJ's."
    ),
    pair: str | None = typer.Option(
        None, "--pair", metavar="A,B", help="Two regions by name, if the file holds more than two."
    ),
    neighbours: bool = typer.Option(
        False,
        "--neighbours",
        help="Instead of regions: each pixel against its neighbours, for patterns one pixel wide.",
    ),
    contrast: list[str] = typer.Option(["100%"], "--contrast", help=CONTRAST_HELP),
    epsilon: str = typer.Option("50%", help="Tolerance of the contrast."),
    method: str = typer.Option(
        "kcf",
        help="How regions are followed: kcf (fast), csrt (slow, large jumps), flow, homography (flat targets), fixed.",
    ),
    reference: str | None = typer.Option(
        None,
        "--reference",
        help="Contrast to compare each frame with: a measured one such as 1000%, first (that of the first frame), or "
        "results.nc of another video, of a calibrated camera for example.",
    ),
    reference_by: str = typer.Option("number", help="How its frames are matched: by number or time."),
    calibration: Path | None = typer.Option(None, "--calibration", help="Calibration file, for cd/m^2."),
    camera: Path | None = typer.Option(
        None, "--camera", help="Camera specification (TOML), for cd/m^2 by guessed parameters."
    ),
    encoding: str | None = typer.Option(
        None, "--encoding", help="How values follow light: linear or srgb; default: linear, or as the camera says."
    ),
    exposure: str | None = EXPOSURE_OPTION,
    gain_db: float | None = GAIN_OPTION,
    bit_depth: int | None = BITS_OPTION,
    start: str = typer.Option("0", help="First frame, for example 250, 10s or 1:30; regions are those in it."),
    stop: str | None = typer.Option(None, help="Frame to stop before; default: the end."),
    every: str = typer.Option(
        "1", help="Distance of the frames, for example 25 or 1s; all are followed, these evaluated."
    ),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for the results.", show_default="VIDEO-cdp, or videos-cdp"
    ),
    annotated: bool = typer.Option(False, "--annotated", help="Also a video with regions, quality and CDP drawn."),
    frames: bool = typer.Option(False, "--frames", help="Also each evaluated frame as PNG image."),
    cluster: str | None = typer.Option(
        None,
        "--cluster",
        metavar="ADDRESS",
        help="Dask scheduler for several videos, for example tcp://192.0.2.7:8786.",
    ),
    workers: int | None = typer.Option(None, help="Processes for several videos.", show_default="one a core", min=1),
    as_json: bool = JSON_OPTION,
) -> None:
    """Tell how probable it is that a contrast is detected, for each frame of a video, between two regions.

    The regions follow their objects; one that is lost gives no value. Without calibration and camera specification,
    values are proportional to light, which contrasts do not mind. Writes a page with a plot over time, a spreadsheet
    and NetCDF. The same command goes on with what was broken off. Several videos are worked through on all cores.

    Example: labcdp video drive.mp4 --roi rois.json --contrast 10%:200%:10% --reference 1000%
    """
    from ..evaluate.video_settings import VideoSettings
    from ..regions import image_size_of
    from ..sources.video_selection import Position, Selection

    if encoding is not None and encoding not in _ENCODINGS:
        raise InputError(f"--encoding is {encoding!r}: give {' or '.join(_ENCODINGS)}")
    if reference_by not in _MATCHED_BY:
        raise InputError(f"--reference-by is {reference_by!r}: give {' or '.join(_MATCHED_BY)}")
    settings = VideoSettings(
        contrasts=parse_contrasts(contrast),
        rois=_rois(roi, pair, neighbours),
        image_size=None if roi is None else image_size_of(roi),
        method=method,
        epsilon=_tolerance(epsilon),
        reference=None if reference is None else _reference(reference),
        reference_by=cast(Literal["number", "time"], reference_by),
        selection=Selection(
            Position.parse(start, "--start"),
            None if stop is None else Position.parse(stop, "--stop"),
            Position.parse(every, "--every"),
        ),
        calibration=calibration,
        camera=camera,
        encoding=cast(Literal["linear", "srgb"] | None, encoding),
        exposure_s=None if exposure is None else seconds(exposure, "--exposure"),
        gain_db=gain_db,
        bit_depth=bit_depth,
    )
    paths = _paths(files)
    if len(paths) == 1 and cluster is None:
        _one(paths[0], settings, output or Path(f"{paths[0].stem or 'video'}-cdp"), annotated, frames, as_json)
    else:
        _several(paths, settings, output or Path("videos-cdp"), (annotated, frames), (cluster, workers), as_json)


def evaluate_into(
    settings: VideoSettings, annotated: bool, frames: bool, path: Path, folder: Path, progress: Any = None
) -> dict[str, Any]:
    """Evaluate a video, write its results into a folder, and return them in a few numbers.

    Raises
    ------
    LabcdpError
        If the video cannot be evaluated or the folder not be written.
    """
    from ..evaluate.video import evaluate_video
    from ..report.folder import place_for_results
    from ..report.video_annotated import AnnotatedVideo, FrameImages
    from ..report.video_files import video_values, write_video

    with place_for_results(folder):
        with ExitStack() as stack:
            observers: list[Observer] = []
            if annotated:
                observers.append(stack.enter_context(AnnotatedVideo(folder / "annotated.mp4")))
            if frames:
                observers.append(FrameImages.of_video(folder, path))

            def observer(*seen: Any) -> None:
                for one in observers:
                    one(*seen)

            told = observer if observers else None
            dataset = evaluate_video(path, settings, folder, progress=progress, observer=told)
        write_video(dataset, folder)
    return video_values(dataset)


def _one(path: Path, settings: VideoSettings, folder: Path, annotated: bool, frames: bool, as_json: bool) -> None:
    from ..report.video_files import load_video
    from ..report.video_page import contrasts_table
    from ..report.video_summary import summarise
    from ..report.video_wording import results

    with progress_bars() as bars:
        values = evaluate_into(
            settings,
            annotated,
            frames,
            path,
            folder,
            lambda done, total: bars.update("Frames", done, done if total is None else total),
        )
    if as_json:
        print_json({"output": str(folder), **values})
        return
    dataset = load_video(folder / "results.nc")
    summary = summarise(dataset)
    for warning in summary.warnings:
        say(f"Warning: {warning}")
    print_table("Contrast detection probability over the frames", *contrasts_table(summary))
    for line in results(dataset, summary):
        say(line)
    say(f"Report: {folder / 'report.html'}; also results.xlsx, results.nc and results.json")


def _several(
    paths: Sequence[Path],
    settings: VideoSettings,
    folder: Path,
    images: tuple[bool, bool],
    where: tuple[str | None, int | None],
    as_json: bool,
) -> None:
    from ..evaluate.archive import archive_tasks, evaluate_archive
    from ..evaluate.video_checks import require_same_evaluation
    from ..evaluate.video_configuration import video_configuration
    from ..evaluate.video_reference import make_reference
    from ..report.folder import place_for_results
    from ..report.video_archive import write_archive

    tasks = archive_tasks(paths, folder)
    require_same_evaluation((task.folder for task in tasks), settings)
    told = {**video_configuration(settings, make_reference(settings)), "annotated": images[0], "frames": images[1]}
    with place_for_results(folder), progress_bars() as bars:
        result = evaluate_archive(
            tasks,
            partial(evaluate_into, settings, *images),
            told,
            *where,
            progress=lambda done, total, _outcome: bars.update("Videos", done, total),
        )
    failures = [Failure(str(outcome.task.video), outcome.error) for outcome in result.failures]
    try:
        write_archive(result, folder)
    except InputError as error:
        # The disk is full: what became of the videos is told nevertheless.
        _tell_archive(result, folder, as_json)
        if failures:
            say(f"labcdp: {error}")
            end_batch(failures, len(result.outcomes), "videos")
        raise
    _tell_archive(result, folder, as_json)
    end_batch(failures, len(result.outcomes), "videos")


def _tell_archive(result: ArchiveResult, folder: Path, as_json: bool) -> None:
    if as_json:
        outcomes = [
            {
                "video": str(outcome.task.video),
                "output": str(outcome.task.folder),
                "error": outcome.error or None,
                "resumed": outcome.resumed,
                "results": outcome.values,
            }
            for outcome in result.outcomes
        ]
        print_json({"output": str(folder), "videos": outcomes, "notes": list(result.notes)})
        return
    for note in result.notes:
        say(f"Note: {note}")
    done = len(result.outcomes) - len(result.failures)
    again = sum(outcome.resumed for outcome in result.outcomes)
    earlier = f", {again} of them earlier" if again else ""
    say(f"{done} of {len(result.outcomes)} videos evaluated{earlier}; results in {folder}, a folder for each")


def _paths(files: Sequence[Path]) -> list[Path]:
    """Videos to evaluate, each once."""
    from ..sources.video import left_out, video_paths

    found: dict[Path, Path] = {}
    for given in files:
        paths = video_paths([given])
        if paths != [given]:
            for folder in left_out(given):
                say(f"Note: {folder} holds images and is left out, as {given} holds videos: give it itself")
        for path in paths:
            first = found.setdefault(path.resolve(), path)
            if first is not path:
                say(f"Note: {path} is the same video as {first}, and evaluated once")
    return list(found.values())


def _rois(path: Path | None, pair: str | None, neighbours: bool) -> tuple[Roi, ...]:
    """Two regions, or none for pixel to pixel."""
    from ..regions import load_regions, rois_of

    if neighbours:
        if path is not None or pair is not None:
            raise InputError("--neighbours needs no regions: leave --roi and --pair out, or --neighbours")
        return ()
    if path is None:
        raise InputError("there are no regions: give a file with --roi (labcdp rois draws one), or --neighbours")
    found = {one.name: one for one in rois_of(load_regions(path))}
    if pair is None:
        if len(found) != 2:
            raise InputError(
                f"{path} holds {len(found)} regions ({', '.join(found)}): choose two with --pair A,B"
                if len(found) > 2
                else f"{path} holds one region: draw a second one, a CDP is of two"
            )
        return tuple(found.values())
    for at, letter in enumerate(pair):
        names = pair[:at].strip(), pair[at + 1 :].strip()
        if letter == "," and names[0] != names[1] and set(names) <= set(found):
            return found[names[0]], found[names[1]]
    raise InputError(f"--pair is {pair!r}: give two of the regions with a comma between them, {', '.join(found)}")


def _tolerance(text: str) -> float:
    tolerance = fraction_of_percent(text, "--epsilon")
    if not 0 < tolerance <= 1:
        raise InputError(f"--epsilon is {text!r}: give a percentage above 0%, up to 100%")
    return tolerance


def _reference(text: str) -> Reference:
    if text == "first":
        return "first"
    if text.endswith("%"):
        contrast = fraction_of_percent(text, "--reference")
        if not 0 < contrast < float("inf"):
            raise InputError(f"--reference is {text!r}: give a contrast above 0%")
        return contrast
    if not Path(text).is_file():
        raise InputError(
            f"--reference is {text!r}: give a contrast such as 1000%, first, or results.nc of another video"
        )
    return Path(text)
