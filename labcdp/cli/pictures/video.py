"""Command video: CDP of videos, frame by frame, with regions that follow their objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import typer

from ...core.disk import real_path
from ...core.errors import InputError
from ..options import (
    CAMERA_SPEC_OPTION,
    CONTRAST_HELP,
    PAIR_METAVAR,
    contrasts_or_measured,
    parse_seconds,
    parse_tolerance,
)
from ..output import FORCE_OPTION, OPEN_OPTION, output_option, results_folder, show_page
from ..terminal import JSON_OPTION, print_result, progress_bars, say
from .picture_options import BITS_OPTION, EXPOSURE_OPTION, GAIN_OPTION
from .video_options import parse_reference, rois_and_pairs, rois_of_pair

if TYPE_CHECKING:
    from ...core.result import Result
    from ...evaluate.video.settings import Observer, VideoSettings
    from ...output import ResultsFolder

_ENCODINGS = ("linear", "srgb")
_MATCHED_BY = ("number", "time")


def video(
    context: typer.Context,
    files: list[Path] = typer.Argument(
        metavar="VIDEO...",
        help="Video files, folders of numbered images, recorded sessions; or a folder of video files.",
    ),
    roi: Path | None = typer.Option(
        None, "--roi", help="File with the regions in the first frame: .json of labcdp rois, or .roi or .zip of ImageJ."
    ),
    pair: list[str] = typer.Option(
        [],
        "--pair",
        metavar=PAIR_METAVAR,
        help="Names of two regions, if the file contains more than two; may be repeated.",
    ),
    neighbours: bool = typer.Option(
        False,
        "--neighbours",
        help="Compute the nearest-neighbour CDP: each pixel and its neighbours, for patterns 1 pixel wide.",
    ),
    contrast: list[str] = typer.Option(
        [], "--contrast", help=CONTRAST_HELP, show_default="the contrast measured in the first frame"
    ),
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast."),
    method: str = typer.Option(
        "follow",
        help="Tracking method: follow, homography (flat targets that tilt) or fixed; other ones for some regions: "
        "follow,wall=fixed.",
    ),
    reference: str | None = typer.Option(
        None,
        "--reference",
        help="Reference contrast of each frame: a value such as 1000%, first (contrast of the first frame), or "
        "results.nc of another video, for example of a calibrated camera.",
    ),
    reference_by: str = typer.Option("number", help="Match frames of a reference video by number or time."),
    calibration: Path | None = typer.Option(None, "--calibration", help="Calibration file, for values in cd/m²."),
    camera_spec: Path | None = CAMERA_SPEC_OPTION,
    encoding: str | None = typer.Option(
        None,
        "--encoding",
        help="Encoding of the pixel values, linear or srgb; default: as the camera specification or the file states, "
        "else the usual one.",
    ),
    exposure: str | None = EXPOSURE_OPTION,
    gain_db: float | None = GAIN_OPTION,
    bit_depth: int | None = BITS_OPTION,
    damaged: bool = typer.Option(
        False, "--damaged", help="Also evaluate frames that are damaged or depend on damaged ones, with a note."
    ),
    start: str = typer.Option("0", help="First frame, for example 250, 10s or 1:30; the regions refer to it."),
    stop: str | None = typer.Option(None, help="Frame to stop before; default: the end."),
    every: str = typer.Option(
        "1", help="Interval between evaluated frames, for example 25 or 1s; tracking uses all frames."
    ),
    output: Path | None = output_option("VIDEO-video, or videos-video"),
    annotated: bool = typer.Option(
        False, "--annotated", help="Also write a video with regions, tracking quality and CDP."
    ),
    frames: bool = typer.Option(False, "--frames", help="Also write each evaluated frame as a PNG image."),
    cluster: str | None = typer.Option(
        None,
        "--cluster",
        metavar="ADDRESS",
        help="Address of a Dask scheduler for several videos, for example tls://192.0.2.7:8786.",
    ),
    cluster_tls: tuple[Path, Path, Path] | None = typer.Option(
        None,
        "--cluster-tls",
        metavar="CA CERTIFICATE KEY",
        help="PEM files for a scheduler at an address tls://: certificate of the authority, own certificate and key.",
    ),
    workers: int | None = typer.Option(
        None, help="Number of processes for several videos.", show_default="one per core", min=1
    ),
    force: bool = FORCE_OPTION,
    open_page: bool = OPEN_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Compute the contrast detection probability between two regions for each frame of a video.

    The regions follow their objects; frames in which one is lost have no value. Without --contrast, the contrast
    measured in the first frame is used. Without calibration and camera specification, relative luminance is used;
    contrasts are unaffected. Writes a page with a plot over time, a spreadsheet and NetCDF. The same command resumes an
    interrupted evaluation. Several videos, and several pairs of regions, are evaluated on all cores.

    Example: labcdp video drive.mp4 --roi rois.json --contrast 10%:200%:20 --reference 1000%
    """
    from ...evaluate.video.settings import VideoSettings
    from ...files.video.selection import Position, Selection
    from ...regions import image_size_of
    from ...tracking import method_among

    if encoding is not None and encoding not in _ENCODINGS:
        raise InputError(f"--encoding is {encoding!r}: give {' or '.join(_ENCODINGS)}")
    if reference_by not in _MATCHED_BY:
        raise InputError(f"--reference-by is {reference_by!r}: give {' or '.join(_MATCHED_BY)}")
    rois, pairs = rois_and_pairs(roi, pair, neighbours)
    # Any two of many regions show whether all else is right.
    settings = VideoSettings(
        rois=rois_of_pair(rois, pairs[0]) if pairs else (),
        contrasts=contrasts_or_measured(contrast),
        image_size=None if roi is None else image_size_of(roi),
        method=method_among(method, [one.name for one in rois], pairs[0]) if pairs else method,
        epsilon=parse_tolerance(epsilon),
        reference=None if reference is None else parse_reference(reference),
        reference_by=cast(Literal["number", "time"], reference_by),
        selection=Selection(
            Position.parse(start, "--start"),
            None if stop is None else Position.parse(stop, "--stop"),
            Position.parse(every, "--every"),
        ),
        calibration=calibration,
        camera=camera_spec,
        encoding=cast(Literal["linear", "srgb"] | None, encoding),
        exposure_s=None if exposure is None else parse_seconds(exposure, "--exposure"),
        gain_db=gain_db,
        bit_depth=bit_depth,
        damaged=damaged,
    )
    paths = _paths(files)
    of_pairs = {
        f"{bright}:{dark}": replace(
            settings,
            rois=rois_of_pair(rois, (bright, dark)),
            method=method_among(method, [one.name for one in rois], (bright, dark)),
        )
        for bright, dark in (pairs if len(pairs) > 1 else ())
    }
    if len(paths) == 1 and cluster is None and not of_pairs:
        results = results_folder(context, paths[0], output, force)
        _one(paths[0], settings, results, annotated, frames, as_json)
        page = "report.html"
    else:
        source = files[0] if len(files) == 1 else "videos"
        results = results_folder(context, source, output, force, resume=True)
        where = (cluster, workers, cluster_tls)
        _several(paths, settings, of_pairs, results, (annotated, frames), where, force, as_json)
        page = "archive.html"
    show_page(results.folder / page, open_page)


def evaluate_into(
    settings: VideoSettings, annotated: bool, frames: bool, path: Path, results: ResultsFolder, progress: Any = None
) -> Result:
    """Evaluate a video and write its results into an open results folder.

    Raises
    ------
    LabcdpError
        If the video cannot be evaluated or the results not be written.
    """
    from ...evaluate.video.evaluate import evaluated_rows
    from ...evaluate.video.report.annotated import AnnotatedVideo, FrameImages
    from ...evaluate.video.report.files import write_video

    with ExitStack() as stack:
        with ExitStack() as drawing:
            observers: list[Observer] = []
            if annotated:
                observers.append(drawing.enter_context(AnnotatedVideo(results.path("annotated.mp4"))))
            if frames:
                observers.append(FrameImages.of_video(results.path("."), path))

            def observer(*seen: Any) -> None:
                for one in observers:
                    one(*seen)

            watching = observer if observers else None
            rows = stack.enter_context(evaluated_rows(path, settings, results, progress=progress, observer=watching))
        return write_video(rows, results)


def evaluate_values(
    settings: VideoSettings | Mapping[str, VideoSettings],
    annotated: bool,
    frames: bool,
    path: Path,
    results: ResultsFolder,
    pair: str = "",
) -> dict[str, Any]:
    """Evaluate a video, or a pair of its regions, as `evaluate_into`; return its result as values JSON can hold."""
    from ...report.envelope import envelope

    own = settings[pair] if isinstance(settings, Mapping) else settings
    return envelope(evaluate_into(own, annotated, frames, path, results))


def _one(
    path: Path, settings: VideoSettings, results: ResultsFolder, annotated: bool, frames: bool, as_json: bool
) -> None:
    with results, progress_bars() as bars:
        result = evaluate_into(
            settings,
            annotated,
            frames,
            path,
            results,
            lambda done, total: bars.update("Frames", done, done if total is None else total),
        )
    print_result(result, as_json)
    if not as_json:
        say(f"Report: {results.folder / 'report.html'}; also results.xlsx, results.nc and results.json")


def _several(
    paths: Sequence[Path],
    settings: VideoSettings,
    of_pairs: Mapping[str, VideoSettings],
    results: ResultsFolder,
    images: tuple[bool, bool],
    where: tuple[str | None, int | None, tuple[Path, Path, Path] | None],
    force: bool,
    as_json: bool,
) -> None:
    from ...evaluate.video.archive.evaluate import archive_tasks, evaluate_archive, require_same_archive
    from ...evaluate.video.archive.report import write_archive
    from ...evaluate.video.archive.result import archive_result
    from ...evaluate.video.archive.tls import TlsFiles
    from ...evaluate.video.checks import require_same_evaluation
    from ...evaluate.video.configuration import video_configuration
    from ...evaluate.video.reference import make_reference

    folder = results.folder
    tasks = archive_tasks(paths, folder, tuple(of_pairs))
    if not force:
        for task in tasks:
            require_same_evaluation((task.folder,), of_pairs.get(task.part, settings))
        require_same_archive(tasks, folder)
    configuration = {
        **video_configuration(settings, make_reference(settings)),
        "annotated": images[0],
        "frames": images[1],
    }
    if of_pairs:
        configuration["pairs"] = {name: video_configuration(one, make_reference(one)) for name, one in of_pairs.items()}
    read = (settings.reference, settings.calibration, settings.camera)
    result: Result | None = None
    try:
        with results:
            results.keep()
            with progress_bars() as bars:
                archive = evaluate_archive(
                    tasks,
                    partial(evaluate_values, dict(of_pairs) or settings, *images),
                    configuration,
                    *where[:2],
                    None if where[2] is None else TlsFiles(*where[2]),
                    progress=lambda done, total, _outcome: bars.update("Videos", done, total),
                    force=force,
                    inputs=[one for one in read if isinstance(one, Path)],
                )
            results.complete = not archive.failures
            result = archive_result(archive)
            write_archive(result, results)
    finally:
        # The outcomes are printed even if the disk is full.
        if result is not None:
            print_result(result, as_json)
    if not as_json:
        say(f"{result.table('videos').note} Results are in {folder}, a folder for each")
    if archive.failures:
        say(f"labcdp: {len(archive.failures)} of {len(archive.outcomes)} videos failed")
        raise typer.Exit(1)


def _paths(files: Sequence[Path]) -> list[Path]:
    """Videos to evaluate, each once."""
    from ...files.video.open import left_out, video_paths

    found: dict[Path, Path] = {}
    for given in files:
        paths = video_paths([given])
        if paths != [given]:
            for folder in left_out(given):
                say(f"Note: {folder} contains images and is left out, as {given} contains videos: give {folder} itself")
        for path in paths:
            first = found.setdefault(real_path(path), path)
            if first is not path:
                say(f"Note: {path} is the same video as {first} and is evaluated once")
    return list(found.values())
