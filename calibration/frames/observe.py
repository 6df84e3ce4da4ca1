"""Observations of patches and dark signal from a stream of frames of one exposure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from math import sqrt
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.clock import exposure_text
from ...core.errors import CalibrationError
from ...core.frame import Frame
from ...core.roi import Roi
from ...core.vignetting import AnyVignetting, illuminance_in
from .defects import DefectMap
from .measure import MIN_FRAMES, MeasuredFrames, measure_frames, measure_whole
from .nonuniformity import Array, in_window, nonuniformity, significant_root, spatial_variance
from .observations import DarkObservation, Observation, PatchObservation, PatchPart
from .statistics import MAX_CLIPPED_SHARE

#: Fewest pixels of a region: below, its noise and its non-uniformity cannot be distinguished.
MIN_PIXELS = 16
#: Share of width and height of a region that is inside its rim.
_INSIDE = 0.75


class DarkPattern(Protocol):
    """Pattern of the dark signal, zero on average."""

    def correction_dn(
        self, shape: tuple[int, int], exposure_s: float, temperature_c: float | None = None
    ) -> Array | None:
        """Pattern to subtract at an exposure and temperature, shape (height, width); None for none."""

    def noise_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Return the standard uncertainty of one pixel of the pattern."""


def observe_patches(
    frames: Iterable[Frame],
    regions: Sequence[Roi],
    vignetting: AnyVignetting | None = None,
    *,
    defects: DefectMap | None = None,
    dark_library: DarkPattern | None = None,
    field_px: float | None = None,
) -> list[PatchObservation]:
    """Measure patches in the light frames of one exposure.

    The frames are processed one by one and not stored.

    Parameters
    ----------
    frames : iterable of Frame
        At least two, or one in which all regions are saturated; all of one exposure, camera and setting.
    regions : sequence of Roi
        One for each patch, with different names.
    vignetting : AnyVignetting or None
        Vignetting of the lens, removed before averaging; None for none.
    defects : DefectMap or None
        Pixels to leave out of the regions.
    dark_library : DarkPattern or None
        Dark pattern to subtract; its mean, the dark signal itself, stays in.
    field_px : float or None
        Diameter of the meter's measuring field in pixels of the image; None if it is not known.

    Returns
    -------
    list of PatchObservation
        In the order of `regions`.

    Raises
    ------
    CalibrationError
        If frames differ in exposure, camera or setting, are too few or coloured, or a region is too small.
    InputError
        If a region lies outside the image.

    Examples
    --------
    >>> from labcdp.calibration import observe_patches
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> light, patches = session.frames("light"), session.configuration.target.patches
    >>> frames = [session.load(r) for r in light if r.exposure_s == light[0].exposure_s]
    >>> [o.patch for o in observe_patches(frames, [patch.region() for patch in patches[:2]])]
    ['P01', 'P07']
    """
    names = [region.name for region in regions]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise CalibrationError(f"several regions are called {twice[0]!r}: give each patch its own name")
    return patch_observations(measure_frames(frames, regions, defects), vignetting, dark_library, field_px)


def patch_observations(
    measured: Sequence[MeasuredFrames],
    vignetting: AnyVignetting | None = None,
    dark_library: DarkPattern | None = None,
    field_px: float | None = None,
) -> list[PatchObservation]:
    """Patches in measured regions of the frames of one exposure; as `observe_patches`."""
    pattern = _pattern(measured[0], dark_library) if measured else None
    return [_patch_observation(region, vignetting, pattern, field_px) for region in measured]


def _patch_observation(
    measured: MeasuredFrames, vignetting: AnyVignetting | None, pattern_dn: Array | None, field_px: float | None
) -> PatchObservation:
    assert measured.region is not None
    # Saturated frames are identical, and an import keeps one of identical pictures.
    _require_enough(measured, single_too=measured.saturated_share > MAX_CLIPPED_SHARE)
    factor = np.ones(measured.n_pixels)
    if vignetting is not None:
        factor = 1 / illuminance_in(vignetting, measured.state.image_shape, measured.window)[measured.used]
    values = _without(measured, None if pattern_dn is None else pattern_dn[measured.window]) * factor
    away = _away(measured)
    in_field = _within(away, 1 / 3) if field_px is None else np.hypot(*away) <= field_px / 2
    return PatchObservation(
        **(_common(measured) | {"mean_dn": float(values.mean())}),
        patch=measured.region.name,
        mean_inverse_v=float(factor.mean()),
        nonuniformity=nonuniformity(values, factor, measured.used),
        vignetting=vignetting,
        centre_px=measured.region.centre,
        n_lines=measured.n_lines,
        recorded=measured.recorded,
        middle=_part(values, factor, in_field, field_px is not None),
        inside=_part(values, factor, _within(away, _INSIDE)),
    )


def _away(measured: MeasuredFrames) -> Array:
    """Distances of a region's pixels from its middle, x and y, shape (2, n)."""
    assert measured.region is not None
    rows, columns = np.nonzero(measured.used)
    top, left = (part.start for part in measured.window)
    x, y = measured.region.centre
    return np.stack([columns + left + 0.5 - x, rows + top + 0.5 - y])


def _within(away: Array, share: float) -> NDArray[np.bool_]:
    """Which pixels are in the middle of the region, of a share of its width and height."""
    inside: NDArray[np.bool_] = (np.abs(away) <= np.ptp(away, axis=1, keepdims=True) * share / 2).all(axis=0)
    return inside


def _part(values: Array, factor: Array, inside: NDArray[np.bool_], is_field: bool = False) -> PatchPart | None:
    """Means over a part of a region's pixels; None if that is all of them, or none."""
    if not inside.any() or inside.all():
        return None
    return PatchPart(float(values[inside].mean()), float(factor[inside].mean()), float(inside.mean()), is_field)


def observe_dark(
    frames: Iterable[Frame], *, defects: DefectMap | None = None, dark_library: DarkPattern | None = None
) -> DarkObservation:
    """Measure the dark signal in the dark frames of one exposure, over the whole sensor.

    Parameters
    ----------
    frames : iterable of Frame
        At least two, all of one exposure, camera and setting; processed one by one.
    defects : DefectMap or None
        Pixels to leave out, as at the patches: hot ones would bias the dark signal.
    dark_library : DarkPattern or None
        Dark pattern to subtract, as at the patches.

    Raises
    ------
    CalibrationError
        If frames differ in exposure, camera or setting, or are too few or coloured.

    Examples
    --------
    >>> from labcdp.calibration import observe_dark
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> shortest_s = min(record.exposure_s for record in session.frames("dark"))
    >>> frames = [session.load(record) for record in session.frames("dark") if record.exposure_s == shortest_s]
    >>> observe_dark(frames).n_pixels
    192000
    """
    return dark_observation(measure_whole(frames, defects), dark_library)


def dark_observation(measured: MeasuredFrames, dark_library: DarkPattern | None = None) -> DarkObservation:
    """Dark signal of measured frames of the whole sensor; as `observe_dark`."""
    _require_enough(measured)
    s, pattern = measured, _pattern(measured, dark_library)
    values = _without(s, pattern)
    spread = nonuniformity(values, None, s.used)
    image = in_window(values, s.used, float(values.mean()))
    lines = spatial_variance(image, s.temporal.scaled(1 / s.n_frames))
    # A library made from the same frames removes their noise too, but not that at the patches.
    left_dn = 0.0
    if dark_library is not None and pattern is not None:
        left_dn = dark_library.noise_dn(measured.exposure_s, measured.temperature_c)
    left = left_dn / sqrt(s.temporal_variance_dn2) if s.temporal_variance_dn2 > 0 else 0.0
    column_dn, row_dn = sqrt(s.temporal_parts.column), sqrt(s.temporal_parts.row)
    noise_dn2 = s.temporal_variance_dn2 / s.n_frames
    return DarkObservation(
        **(_common(measured) | {"mean_dn": float(values.mean())}),
        nonuniformity_dn=sqrt(spread.slow_variance_dn2(0.0)),
        pattern_dn=max(sqrt(max(spread.pixel_variance_dn2(0.0) - noise_dn2, 0.0)), left_dn),
        line_noise_dn=(column_dn, row_dn),
        line_pattern_dn=(
            max(significant_root(lines.column), left * column_dn),
            max(significant_root(lines.row), left * row_dn),
        ),
    )


def _common(measured: MeasuredFrames) -> dict[str, Any]:
    """Return what `Observation` has, by its names."""
    return {field.name: getattr(measured, field.name) for field in fields(Observation)}


def _pattern(measured: MeasuredFrames, dark_library: DarkPattern | None) -> Array | None:
    if dark_library is None:
        return None
    return dark_library.correction_dn(measured.state.image_shape, measured.exposure_s, measured.temperature_c)


def _without(s: MeasuredFrames, pattern_dn: Array | None) -> NDArray[np.float64]:
    """Mean of each used pixel without the dark pattern; their mean is exact."""
    values = (s.image_dn.ravel() if s.used.all() else s.image_dn[s.used]).astype(np.float64)
    values += s.mean_dn - values.mean()
    return values if pattern_dn is None else values - pattern_dn[s.used]


def _require_enough(measured: MeasuredFrames, *, single_too: bool = False) -> None:
    name = "whole sensor" if measured.region is None else measured.region.name
    if measured.n_pixels < MIN_PIXELS:
        raise CalibrationError(f"region {name!r} holds {measured.n_pixels} pixels: make it at least {MIN_PIXELS}")
    if measured.n_frames < MIN_FRAMES and not single_too:
        raise CalibrationError(
            f"region {name!r} was given {measured.n_frames} frame at {exposure_text(measured.exposure_s)}: take at "
            f"least {MIN_FRAMES} of each exposure, noise is measured from their difference"
        )
