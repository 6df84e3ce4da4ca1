"""A calibration of the whole sensor, for frames that show a part of it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from ...core.vignetting import AnyVignetting, cropped
from ..dark.library import DarkLibrary
from ..defects import DefectMap
from ..frames.observations import CameraState
from ..model import Calibration

_Pair = tuple[int, int]


def of_region(calibration: Calibration, state: CameraState) -> Calibration:
    """Return the calibration for the part of the sensor that frames of a state show.

    Vignetting, defects and dark pattern are cut out; all else is that of the calibration. It is returned as it is if
    frames of the state show no part of what it was made with, or where they lie is unknown.
    """
    whole, part = calibration.state, state
    if part.readout is None or whole.readout is None or whole.image_shape == part.image_shape:
        return calibration
    window = part.readout.window_in(part.image_shape, whole.readout, whole.image_shape)
    if window is None:
        return calibration
    top, left = (one.start for one in window)
    corner = left, top
    moved = {
        name: tuple(replace(row, centre_px=(row.centre_px[0] - left, row.centre_px[1] - top)) for row in rows)
        for name, rows in (("residuals", calibration.residuals), ("held_out", calibration.held_out))
    }
    v, defects, library = calibration.vignetting, calibration.defects, calibration.dark_library
    return replace(
        calibration,
        state=replace(whole, image_shape=part.image_shape, readout=part.readout),
        vignetting=None if v is None else _vignetting(v, whole.image_shape, corner, part.image_shape),
        defects=None if defects is None else _defects(defects, corner, part.image_shape),
        dark_library=None if library is None else _library(library, corner, part.image_shape),
        residuals=moved["residuals"],
        held_out=moved["held_out"],
    )


@lru_cache(maxsize=8)
def _vignetting(vignetting: AnyVignetting, whole: _Pair, corner: _Pair, shape: _Pair) -> AnyVignetting:
    return cropped(vignetting, whole, corner, shape)


@lru_cache(maxsize=8)
def _defects(defects: DefectMap, corner: _Pair, shape: _Pair) -> DefectMap:
    rows, columns = defects.rows - corner[1], defects.columns - corner[0]
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    return DefectMap(rows[inside], columns[inside], defects.reasons[inside], shape)


@lru_cache(maxsize=8)
def _library(library: DarkLibrary, corner: _Pair, shape: _Pair) -> DarkLibrary:
    (x, y), (height, width) = corner, shape
    cut = {name: getattr(library, name)[y : y + height, x : x + width] for name in ("offset_dn", "rate_dn_s")}
    return replace(library, **cut)
