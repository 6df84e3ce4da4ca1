"""A video's results as files: for machines, for people, and for spreadsheets."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from os import PathLike, fsync
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..json_text import results_json
from .folder import write_files
from .netcdf import dataset_bytes, read_dataset
from .video_page import over_time, video_page
from .video_sheets import write_video_spreadsheet
from .video_summary import VideoSummary, check_video, summarise

if TYPE_CHECKING:
    from xarray import Dataset


def write_video(dataset: Dataset, folder: str | PathLike[str]) -> list[Path]:
    """Write the results of a video.

    Each file is there whole or not at all. Files of an earlier run in the folder are replaced.

    Parameters
    ----------
    dataset : xarray.Dataset
        Results of a video.
    folder : path
        Made if it does not exist.

    Returns
    -------
    list of Path
        results.nc, results.json, report.html, figures/over-time.png and results.xlsx.

    Raises
    ------
    InputError
        If the dataset is no result of a video, or a file cannot be written.
    """
    folder = Path(folder)
    summary = summarise(dataset)
    figure = over_time(dataset)
    files = {
        "results.nc": dataset_bytes(dataset, "result"),
        "results.json": results_json(video_values(dataset, summary)).encode(),
        "report.html": video_page(dataset, summary, figure).encode(),
        f"figures/{figure.file_name}": figure.png,
    }
    written = write_files(folder, files)
    spreadsheet = folder / "results.xlsx"
    write_in_place(spreadsheet, lambda path: write_video_spreadsheet(dataset, path, datetime.now(UTC)))
    return [*written, spreadsheet]


def video_values(dataset: Dataset, summary: VideoSummary | None = None) -> dict[str, object]:
    """Return what the results say in a few numbers, for JSON; the NetCDF file has every frame."""
    names = ("file", "sha256", "mode", "method", "unit", "epsilon", "conversion")
    attrs = {name: dataset.attrs[name] for name in names if name in dataset.attrs}
    return {**attrs, **(summary or summarise(dataset)).values()}


def load_video(path: str | PathLike[str]) -> Dataset:
    """Read results.nc into memory.

    Raises
    ------
    InputError
        If the file is missing, cannot be read, is damaged, or holds no results of a video.
    """
    dataset = read_dataset(Path(path), "result")
    try:
        check_video(dataset)
    except InputError as error:
        raise InputError(f"{path} holds no results of a video: {error}") from error
    return dataset


def write_in_place(path: Path, write: Callable[[Path], None]) -> None:
    """Have a file written under a temporary name in the same folder, and give it its name when it is whole.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    unfinished = unfinished_name(path)
    try:
        try:
            write(unfinished)
            with unfinished.open("rb") as file:
                fsync(file.fileno())
            unfinished.replace(path)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as error:
        raise cannot_be_written(path, error) from error


def unfinished_name(path: Path) -> Path:
    """Temporary name of a file, with the same suffix."""
    return path.with_name(f".unfinished-{path.name}")


def cannot_be_written(path: Path, error: OSError) -> InputError:
    """Return the error for a file that cannot be written."""
    return InputError(
        f"{path} cannot be written ({error.strerror or error}): give a folder you can write to, on a disk with enough "
        "space"
    )
