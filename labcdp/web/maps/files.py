"""Files of luminance maps: one that Python saved is read, and the map of a page is written for other programs."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.luminance import LuminanceMap
from ...files.luminance_file import SUFFIXES, save_luminance
from ...output import write_file
from ...report.files import read_dataset
from ...report.maps import luminance_picture
from ..regions.display import DisplayScale
from ..regions.page_image import PageImage

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
    if suffix not in EXPORTS:
        raise InputError(f"{path.name!r} has an unknown suffix: give a name that ends in {', '.join(EXPORTS)}")
    if path.exists():
        raise InputError(f"the file {path} exists already: give another name")
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
        raise InputError(f"{path} is no luminance map of a picture: it lacks {', '.join(missing) or 'y or x'}")
    light = dataset["luminance"].to_numpy().astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        random_rel = dataset["u_luminance"].to_numpy() / np.abs(light)
    luminance = LuminanceMap(light, random_rel, (), dataset["invalid"].to_numpy().astype(np.uint8))
    return PageImage(path.name, light, False, None, luminance, str(dataset.attrs.get("unit", "relative")))
