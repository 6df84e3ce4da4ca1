"""Luminance maps of pages: profile and isolines, export for other programs, and maps that Python saved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from math import ceil, hypot
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, printable
from ...core.luminance import LuminanceMap
from ...files.luminance_file import SUFFIXES, save_luminance
from ...output import write_file
from ...report.drawing import block_mean
from ...report.files import read_dataset
from ...report.maps import luminance_picture
from .display import DisplayScale
from .page_image import PageImage

#: Ends of the names: what `save_luminance` writes, a picture in false colours, and a table of numbers.
EXPORTS = (".png", ".csv", *SUFFIXES)


def export_map(image: PageImage, path: Path, scale: DisplayScale) -> None:
    """Write the luminance of an image; the end of the name says how.

    Parameters
    ----------
    image : PageImage
        The image.
    path : Path
        File that does not exist: .png with false colours and their scale, .csv with a row of numbers for each row of
        pixels, or one of `save_luminance`.
    scale : DisplayScale
        Of the false colours.

    Raises
    ------
    InputError
        If the file exists or cannot be written, the name has another end, or the luminance is relative and the format
        is for cd/m^2.
    """
    suffix = path.suffix.lower()
    if path.exists():
        raise InputError(f"the file {path} exists already: choose another name")
    if suffix == ".csv":
        text = StringIO()
        np.savetxt(text, image.luminance.luminance_cd_m2, fmt="%.6g", delimiter=",")
        write_file(path, text.getvalue().encode())
        return
    if image.unit != "cd/m^2":
        raise InputError("the luminance is relative: give --calibration, or export it as .csv")
    if suffix == ".png":
        shown = (scale.black, scale.white)
        linear = scale.name == "linear"
        write_file(path, luminance_picture(image.luminance, image.name, image.simulated, shown, linear=linear))
    else:
        save_luminance(image.luminance, path, {"frames": [image.name]})


def dataset_image(path: Path) -> PageImage:
    """Read what ``labcdp.read_image(...).to_dataset().to_netcdf(path)`` wrote; its U is that of single pixels.

    Raises
    ------
    InputError
        If the file cannot be read, or lacks luminance, its standard uncertainty or flags.
    """
    dataset = read_dataset(path, "luminance map")
    missing = sorted({"luminance", "u_luminance", "invalid"} - set(map(str, dataset.data_vars)))
    if missing or dataset["luminance"].ndim != 2:
        raise InputError(f"{path} is not a luminance map of a picture: it lacks {', '.join(missing) or 'y or x'}")
    light = dataset["luminance"].to_numpy().astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        random_rel = dataset["u_luminance"].to_numpy() / np.abs(light)
    luminance = LuminanceMap(light, random_rel, (), dataset["invalid"].to_numpy().astype(np.uint8))
    return PageImage(printable(path.name), light, False, None, luminance, str(dataset.attrs.get("unit", "relative")))


#: Most points along the longer side of the map of which isolines are made, and fewest points of a line that is shown:
#: noise makes many short ones.
_ISOLINE_SIDE, _SHORTEST = 500, 10


@dataclass(frozen=True)
class Profile:
    """Luminance along a line.

    Parameters
    ----------
    distance_px : ndarray of float, shape (n,)
        Distance from the first end, in pixels of the image.
    luminance, expanded : ndarray of float, shape (n,)
        Luminance of the nearest pixel, and its U (95 %): nan if it is not known.
    """

    distance_px: NDArray[np.float64]
    luminance: NDArray[np.float64]
    expanded: NDArray[np.float64]


def profile(image: PageImage, ends: Sequence[float]) -> Profile:
    """Read the luminance along a line.

    Parameters
    ----------
    image : PageImage
        The image.
    ends : sequence of float
        x, y, x, y of the ends in pixels; what is outside the image is left out.

    Raises
    ------
    InputError
        If there are not four finite numbers, or all of the line is outside.
    """
    if len(ends) != 4 or not np.isfinite(ends).all():
        raise InputError("the ends of a line are four numbers in pixels: x, y, x, y")
    xa, ya, xb, yb = ends
    step, (height, width) = image.luminance.step, image.luminance.shape
    length_px = hypot(xb - xa, yb - ya)
    # No more points than a screen could show of the largest image.
    share = np.linspace(0, 1, min(ceil(length_px / step), 20_000) + 1)
    columns = np.floor((xa + share * (xb - xa)) / step).astype(int)
    rows = np.floor((ya + share * (yb - ya)) / step).astype(int)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    if not inside.any():
        raise InputError("the line is outside the image: draw it in the picture")
    luminance, expanded, _ = image.light_at(rows[inside], columns[inside])
    return Profile(share[inside] * length_px, luminance, expanded)


@dataclass(frozen=True)
class LuminanceIsoline:
    """A line of equal luminance.

    Parameters
    ----------
    level : float
        Its luminance.
    x, y : ndarray of float, shape (n,)
        Its points in pixels of the image.
    """

    level: float
    x: NDArray[np.float64]
    y: NDArray[np.float64]


def isolines(luminance: LuminanceMap, levels: Sequence[float]) -> list[LuminanceIsoline]:
    """Find the lines of equal luminance in a map, reduced to at most 500 points a side; invalid pixels count too."""
    from contourpy import contour_generator

    side = ceil(max(luminance.shape) / _ISOLINE_SIDE)
    values = block_mean(np.nan_to_num(luminance.luminance_cd_m2, posinf=0.0, neginf=0.0), side)
    if min(values.shape) < 2:
        return []
    generator = contour_generator(z=values)
    pixels = side * luminance.step
    return [
        LuminanceIsoline(level, pixels * (line[:, 0] + 0.5), pixels * (line[:, 1] + 0.5))
        for level in levels
        for line in map(np.asarray, generator.lines(level))
        if len(line) >= _SHORTEST
    ]
