"""A video's results as files: for machines, for people, and for spreadsheets."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from ....core.result import Result
from ....output import Destination, open_results
from ....output.file import cannot_be_written
from ....report.envelope import envelope_json
from ....report.html import render_page
from ....report.netcdf import write_blocks
from ....report.sheets import write_result
from ..dataset import VideoRows, blocks_of, check_video
from ..result import video_result
from .page import over_time, video_page
from .sheets import long_tables

if TYPE_CHECKING:
    from xarray import Dataset


def write_video(results: Dataset | VideoRows, folder: Destination) -> Result:
    """Write the results of a video: results.nc, results.json, report.html, figures/over-time.png and results.xlsx.

    Memory does not grow with the video but by one number a frame.

    Parameters
    ----------
    results : xarray.Dataset or VideoRows
        Results of a video.
    folder : path or ResultsFolder
        New, empty, or with unfinished results of the same kind; or a folder of results that is open.

    Returns
    -------
    Result
        What results.json says.

    Raises
    ------
    InputError
        If the dataset is no result of a video, or a file cannot be written.
    """
    import xarray as xr

    if not isinstance(results, VideoRows):
        check_video(results)
    blocks = results.blocks() if isinstance(results, VideoRows) else blocks_of(results)
    with open_results(folder, "video") as files:
        netcdf, spreadsheet = files.path("results.nc"), files.path("results.xlsx")
        try:
            write_blocks(netcdf, blocks, "frame")
            with xr.open_dataset(netcdf, engine="netcdf4", cache=False) as dataset:
                result = video_result(dataset)
                figure = over_time(dataset, result)
                page = render_page(video_page(dataset, result, figure))
                write_result(spreadsheet, result, datetime.now(UTC), long_tables(dataset))
        except OSError as error:
            raise cannot_be_written(files.folder, error) from error
        files.add(
            {
                "results.json": envelope_json(result).encode(),
                "report.html": page.encode(),
                f"figures/{figure.file_name}": figure.png,
            }
        )
    return result
