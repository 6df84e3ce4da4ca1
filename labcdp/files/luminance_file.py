"""Luminance maps as files: float TIFF, OpenEXR, or NumPy archive, each with what is needed to understand it."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from io import BytesIO
from math import inf, isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.disk import parse_json, quoted, read_bytes, reason
from ..core.disk.arrays import npz_headers, parse_npz
from ..core.disk.tiff import open_tiff, pixels_of
from ..core.errors import InputError
from ..core.luminance import CommonError, Invalid, LuminanceMap
from ..output import write_file
from .exr import exr_channels
from .stored_image import MAX_PIXELS, require_size

#: Value of the key ``format`` of the metadata of every file, and the version this program writes and reads.
FORMAT, VERSION = "labcdp-luminance", 1
#: Size from which a file is refused, arrays in one (six, and one for each common error), and size of its text.
_MOST_BYTES, _MOST_ARRAYS, _MOST_BYTES_OF_TEXT = 2**33, 64, 2**24
#: Formats by the end of the name.
SUFFIXES = (".tif", ".tiff", ".exr", ".npz")


def save_luminance(luminance: LuminanceMap, path: str | Path, about: Mapping[str, Any], *, force: bool = False) -> None:
    """Write a luminance map, whole or not at all; the end of the name says how.

    .npz
        Everything, common errors apart: the only format from which contrasts can be computed as from the map itself.
    .tif, .tiff
        float32 pages: luminance in cd/m^2, random and common relative standard uncertainty, and a page of flags. The
        description of the first page is JSON.
    .exr
        Channels Y (cd/m^2), random_rel, common_rel (float) and invalid (unsigned integer); JSON in the attribute
        ``labcdp``, and whiteLuminance 1, since Y is absolute.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    path : path
        Where to write.
    about : mapping
        What JSON can hold: calibration, camera, frames. Unit, uncertainty and reasons are added.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    InputError
        If the name has another end, or the file exists or cannot be written.
    """
    path = Path(path)
    suffix = _suffix(path)
    text = json.dumps(metadata(luminance, about), ensure_ascii=True)
    write = {".npz": _npz, ".exr": _exr}.get(suffix, _tiff)
    write_file(path, write(luminance, text), force=force)


def load_luminance(path: str | Path) -> tuple[LuminanceMap, dict[str, Any]]:
    """Read what `save_luminance` wrote.

    Returns
    -------
    LuminanceMap
        From TIFF and OpenEXR in float32, and with one common error that stands for all.
    dict
        The metadata.

    Raises
    ------
    InputError
        If the file cannot be read or is not one of these, or of another version.
    """
    path = Path(path)
    _suffix(path)
    return read_luminance(read_bytes(path, "a luminance map that labcdp saved", _MOST_BYTES), path, MAX_PIXELS)


def read_luminance(data: bytes, path: Path, max_pixels: int) -> tuple[LuminanceMap, dict[str, Any]]:
    """Read the bytes of a file that `save_luminance` wrote, as `load_luminance`.

    Parameters
    ----------
    data : bytes
        The file.
    path : Path
        For messages.
    max_pixels : int
        Pixels from which it is refused before it is decoded.

    Raises
    ------
    InputError
        As `load_luminance`, or if it is larger.
    """
    read = {b"PK": _from_npz, b"v/": _from_exr}.get(data[:2], _from_tiff)
    try:
        text, arrays = read(data, path, max_pixels)
        values = parse_json(text)
        if not isinstance(values, dict) or values.get("format") != FORMAT:
            raise ValueError("its metadata was not written by labcdp")
        if values.get("version") != VERSION:
            version = quoted(values.get("version"))
            raise ValueError(f"its version is {version}, this labcdp reads {VERSION}: use the labcdp that wrote it")
        return _map(arrays, values), values
    # Damaged archives, codecs and directories raise what their libraries do.
    except Exception as error:
        raise InputError(f"{path} is not a luminance map this labcdp can read ({reason(error)})") from error


def metadata(luminance: LuminanceMap, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return unit, uncertainty and reasons of a map, and what is known about it, as values JSON can hold."""
    valid, corner = luminance.valid, luminance.common_in((slice(0, 1), slice(0, 1)))
    return {
        "format": FORMAT,
        "version": VERSION,
        "quantity": "luminance",
        "unit": "cd/m^2",
        "random_rel": "relative standard uncertainty that differs from pixel to pixel",
        "common_rel": "relative standard uncertainty shared by all pixels",
        "invalid_flags": {flag.name: int(flag) for flag in Invalid},
        "invalid_share": invalid_shares(luminance),
        "median_random_rel": _median(luminance.random_rel[valid]),
        "median_common_rel": _median(np.broadcast_to(luminance.common_rel, luminance.shape)[valid]),
        "common": [{"source": e.source, "rectangular": e.rectangular} for e in corner],
        "slow_rel": luminance.slow_rel,
        "slow_cd_m2": float(np.mean(luminance.slow_cd_m2)),
        "fixed_rel": luminance.fixed_rel,
        "fixed_cd_m2": float(np.mean(luminance.fixed_cd_m2)),
        "step": luminance.step,
        **about,
    }


def invalid_shares(luminance: LuminanceMap) -> dict[str, float]:
    """Share of the pixels with each flag, by its name; flags without a pixel are left out."""
    counts = np.bincount(luminance.invalid.ravel(), minlength=256)
    values = np.arange(256)
    shares = {str(flag.name): float(counts[(values & flag) != 0].sum() / counts.sum()) for flag in Invalid}
    return {name: share for name, share in shares.items() if share > 0}


def _median(values: NDArray[Any]) -> float | None:
    # JSON has no number for what is not known, such as by guessed camera parameters.
    median = float(np.median(values)) if values.size else inf
    return median if isfinite(median) else None


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path} ends in {suffix!r}: give a name that ends in {', '.join(SUFFIXES)}")
    return suffix


def _npz(luminance: LuminanceMap, text: str) -> bytes:
    arrays: dict[str, NDArray[Any]] = {
        "luminance_cd_m2": luminance.luminance_cd_m2,
        "random_rel": luminance.random_rel,
        "common_rel": np.broadcast_to(luminance.common_rel, luminance.shape),
        "invalid": luminance.invalid,
        "slow_cd_m2": np.asarray(luminance.slow_cd_m2),
        "fixed_cd_m2": np.asarray(luminance.fixed_cd_m2),
        "metadata": np.array(text),
    }
    arrays |= {f"common_{i}": np.asarray(e.relative) for i, e in enumerate(luminance.common)}
    file = BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def _from_npz(data: bytes, path: Path, max_pixels: int) -> tuple[str, dict[str, NDArray[Any]]]:
    # A few kilobytes can hold arrays of any size, so their headers are read before.
    headers = npz_headers(data)
    if len(headers) > _MOST_ARRAYS:
        raise ValueError(f"it holds {len(headers)} arrays")
    for name, header in headers.items():
        if len(header.shape) == 2:
            require_size(path, header.shape[1], header.shape[0], max_pixels)
        elif header.shape or header.dtype.itemsize > _MOST_BYTES_OF_TEXT:
            raise ValueError(f"{quoted(name)} has {len(header.shape)} dimensions, or is too large")
    arrays = dict(parse_npz(data, 8 * max_pixels * len(headers)))
    return str(arrays.pop("metadata")), arrays


def _layers(luminance: LuminanceMap) -> dict[str, NDArray[np.float32]]:
    """Arrays of the formats that hold images only."""
    common_rel = np.broadcast_to(luminance.common_rel, luminance.shape)
    arrays = {"Y": luminance.luminance_cd_m2, "random_rel": luminance.random_rel, "common_rel": common_rel}
    return {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in arrays.items()}


def _tiff(luminance: LuminanceMap, text: str) -> bytes:
    import tifffile

    file = BytesIO()
    with tifffile.TiffWriter(file, byteorder="<") as tiff:
        for i, page in enumerate((*_layers(luminance).values(), luminance.invalid)):
            tiff.write(
                page,
                photometric="minisblack",
                compression="zlib",
                description=text if i == 0 else None,
                metadata=None,
                software="labcdp",
            )
    return file.getvalue()


def _from_tiff(data: bytes, path: Path, max_pixels: int) -> tuple[str, dict[str, NDArray[Any]]]:
    it = Path("it")
    with open_tiff(data, it) as tiff:
        if len(tiff.pages) != 4:
            raise ValueError(f"it has {len(tiff.pages)} pages, not 4")
        pages = [page.aspage() for page in tiff.pages]
        for page in pages:
            require_size(path, page.imagewidth, page.imagelength, max_pixels)
        names = ("luminance_cd_m2", "random_rel", "common_rel", "invalid")
        arrays = {name: pixels_of(page, it) for name, page in zip(names, pages, strict=True)}
        return str(tiff.pages.first.description), arrays


def _exr(luminance: LuminanceMap, text: str) -> bytes:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "labcdp": text}
    header["whiteLuminance"] = 1.0
    channels = {**_layers(luminance), "invalid": luminance.invalid.astype(np.uint32)}
    OpenEXR.set_global_thread_count(os.cpu_count() or 1)
    # OpenEXR writes to names only.
    with TemporaryDirectory() as folder:
        name = str(Path(folder) / "luminance.exr")
        with OpenEXR.File(header, channels) as file:
            file.write(name)
        return Path(name).read_bytes()


def _from_exr(data: bytes, path: Path, max_pixels: int) -> tuple[str, dict[str, NDArray[Any]]]:
    header, channels = exr_channels(path, max_pixels)
    channels["luminance_cd_m2"] = channels.pop("Y")
    return str(header["labcdp"]), channels | {"invalid": channels["invalid"].astype(np.uint8)}


def _map(arrays: dict[str, NDArray[Any]], values: dict[str, Any]) -> LuminanceMap:
    patterns = [arrays[f"common_{i}"] for i in range(len(values["common"])) if f"common_{i}" in arrays]
    common: tuple[CommonError, ...] = (CommonError("calibration", arrays["common_rel"]),)
    if len(patterns) == len(values["common"]):
        common = tuple(
            CommonError(about["source"], _number_or_array(relative), about["rectangular"])
            for about, relative in zip(values["common"], patterns, strict=True)
        )
    return LuminanceMap(
        arrays["luminance_cd_m2"],
        arrays["random_rel"],
        common,
        arrays["invalid"],
        slow_rel=values["slow_rel"],
        slow_cd_m2=_number_or_array(arrays.get("slow_cd_m2", np.asarray(values["slow_cd_m2"]))),
        fixed_rel=values["fixed_rel"],
        fixed_cd_m2=_number_or_array(arrays.get("fixed_cd_m2", np.asarray(values.get("fixed_cd_m2", 0.0)))),
        step=values["step"],
    )


def _number_or_array(values: NDArray[Any]) -> NDArray[Any] | float:
    return float(values) if values.ndim == 0 else values
