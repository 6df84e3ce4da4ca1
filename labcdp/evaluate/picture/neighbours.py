"""Nearest-neighbour CDP of a luminance map, with the uncertainty by the calibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.frame import Frame
from ...core.luminance import LuminanceMap, Window
from ...core.quantity import Quantity
from ...core.result import Finding, info, warning
from ...core.roi import Rectangle, clipped_rectangle
from ...core.vignetting import Cos4Vignetting
from ...metrics import Cdp, ContrastDistribution, Distribution, Epsilon, cdp_neighbours
from ...metrics.region import variance_of_changes
from ...metrics.spread import CUT_OFF, MOST_BINS, MOST_TIMES, spacing
from .converter import Converter
from .light_table import make_light_table


@dataclass(frozen=True)
class NeighbourPair:
    """Contrast and CDP of neighbouring pixels, of a picture or a rectangle of it.

    Parameters
    ----------
    rectangle : (int, int, int, int) or None
        Corner pixels of the rectangle, both in; None for the whole picture.
    contrast : Quantity
        Measured contrast of the neighbours: mean of the brighter over mean of the darker pixels of all pairs, minus 1;
        nan where no darker one is above 0. Its u is not known (nan).
    cdp : Cdp
        Of all contrasts.
    findings : tuple of Finding
        Findings about the pixels.
    """

    rectangle: Rectangle | None
    contrast: Quantity
    cdp: Cdp[NDArray[np.float64]]
    findings: tuple[Finding, ...]

    @property
    def targets_measured_contrast(self) -> bool:
        """Whether the target contrast is the measured one."""
        return len(self.cdp) == 1 and bool(self.cdp.contrast[0] == self.contrast.value)

    @property
    def name(self) -> str:
        """Which pixels it is of."""
        if self.rectangle is None:
            return "nearest-neighbour, whole picture"
        x0, y0, x1, y1 = self.rectangle
        return f"nearest-neighbour, ({x0}, {y0}) to ({x1}, {y1})"


def evaluate_neighbours(
    luminance: LuminanceMap,
    contrasts: Sequence[float] | None = None,
    epsilon: Epsilon = 0.5,
    rectangle: Rectangle | None = None,
) -> NeighbourPair:
    """Evaluate CDP of each pixel against its right and its lower neighbour.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    contrasts : sequence of float or None
        Contrasts to be detected, fractions; None for the measured contrast of the neighbours, without a result if that
        is not defined or 0.
    epsilon : float or DetectionInterval
        Their tolerance, as for `labcdp.metrics.cdp`.
    rectangle : (int, int, int, int) or None
        Opposite corner pixels of the image, in any order, both in; what lies outside is cut off. None for all pixels.

    Raises
    ------
    InputError
        As `labcdp.metrics.cdp_neighbours`, and if the rectangle lies outside the image.

    Notes
    -----
    Errors of the calibration are propagated as by `labcdp.metrics.pair.evaluate_pair`. A factor common to all
    pixels cancels between neighbours, and so does one that changes slowly; slow changes of the dark signal count as if
    they were the same everywhere, which is the most that they can do.
    """
    window, inside = _window(luminance, rectangle)
    values = np.asarray(luminance.luminance_cd_m2[window], dtype=np.float64)
    contrast = neighbour_contrast(values)
    targets = list(contrasts if contrasts is not None else (contrast,) if contrast > 0 else ())
    base = cdp_neighbours(values, targets, epsilon)
    changed = [
        [cdp_neighbours(values * (1 + sign * error), targets, epsilon).cdp for sign in (1, -1)]
        for error in _errors(luminance, window, values)
    ]
    variance = variance_of_changes(base.cdp, changed)
    findings = [info("neighbour-contrast-is-measured")] if contrasts is None else []
    return NeighbourPair(
        rectangle=inside,
        contrast=Quantity(contrast, nan),
        cdp=base.with_calibration(variance),
        findings=tuple(findings if targets else [warning("contrast-undefined", "nearest-neighbour")]),
    )


def neighbours_of_frame(
    frame: Frame, converter: Converter, contrasts: tuple[float, ...] | None, epsilon: Epsilon
) -> NeighbourPair:
    """Evaluate a frame as `evaluate_neighbours`; faster, without its measured contrast, if its DN alone decide.

    Raises
    ------
    InputError
        As `evaluate_neighbours`.
    CalibrationError
        If the conversion is not for such frames.
    """
    from ...metrics.neighbours.tables import MOST_CONTRASTS, neighbour_tables

    few = contrasts is not None and len(contrasts) <= MOST_CONTRASTS
    light = _light_by_dn(frame, converter) if few else None
    if contrasts is None or light is None:
        return evaluate_neighbours(converter.convert(frame), contrasts, epsilon)
    cdp = neighbour_tables(light, contrasts, epsilon).evaluate(frame.dn)
    return NeighbourPair(None, Quantity(nan, nan), cdp, ())


def _light_by_dn(frame: Frame, converter: Converter) -> NDArray[np.floating[Any]] | None:
    """Light of each DN of 8-bit frames; None for others, or if more than the DN decides."""
    others = frame.colour_filter or frame.black_pattern or converter.calibration is not None
    if frame.dn.dtype != np.uint8 or frame.bit_depth != 8 or others:
        return None
    by_dn = make_light_table(frame, converter.options.encoding or "linear", converter.specification)
    corrected = isinstance(converter.vignetting(frame.shape, frame.readout), Cos4Vignetting)
    return None if corrected or by_dn.glare_fraction else by_dn.light


def neighbour_contrast(values: NDArray[np.float64]) -> float:
    """Return the mean of the brighter over the mean of the darker pixels of all pairs, minus 1; nan if not defined."""
    with np.errstate(invalid="ignore"):
        brighter, darker = np.sum([[np.sum(side) for side in both] for both in _pairs(values)], axis=0).tolist()
    return brighter / darker - 1 if darker > 0 and isfinite(brighter) else nan


def _pairs(values: NDArray[np.float64]) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Yield the larger and the smaller values of neighbours in a row, then of those in a column."""
    for first, second in ((values[:, :-1], values[:, 1:]), (values[:-1], values[1:])):
        yield np.maximum(first, second), np.minimum(first, second)


def _window(luminance: LuminanceMap, rectangle: Rectangle | None) -> tuple[Window, Rectangle | None]:
    """Rows and columns of the map in a rectangle of the image, and the rectangle as it was cut off."""
    if rectangle is None:
        return (slice(None), slice(None)), None
    height, width = (length * luminance.step for length in luminance.shape)
    left, top, right, bottom = clipped_rectangle(rectangle, width, height)
    rows, columns = (
        slice(first // luminance.step, last // luminance.step + 1) for first, last in ((top, bottom), (left, right))
    )
    return (rows, columns), (left, top, right, bottom)


def _errors(luminance: LuminanceMap, window: Window, values: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Relative errors of each pixel that may differ between neighbours."""
    common = (e.relative for e in luminance.common_in(window) if not e.smooth)
    errors = [np.asarray(relative, dtype=float) for relative in common if np.ndim(relative)]
    if np.any(luminance.slow_cd_m2):
        slow_cd_m2 = np.broadcast_to(luminance.slow_cd_m2, luminance.shape)[window]
        with np.errstate(divide="ignore", invalid="ignore"):
            errors.append(slow_cd_m2 / np.abs(values))
    # A pixel exactly at the dark signal has no relative error, and nothing is seen there.
    return [np.where(np.isfinite(error), error, 0.0) for error in errors]


def neighbour_distribution(luminance: LuminanceMap, pair: NeighbourPair) -> ContrastDistribution | None:
    """Cumulative probability of the contrasts of all neighbours, larger over smaller, for plots; None without any."""
    values = np.asarray(luminance.luminance_cd_m2[_window(luminance, pair.rectangle)[0]], dtype=np.float64)
    most = MOST_TIMES * float(pair.cdp.detected_range.high.max()) if len(pair.cdp) else inf
    contrasts = []
    undefined = pairs = 0
    for larger, smaller in _pairs(values):
        pairs += larger.size
        undefined += int(np.count_nonzero(larger <= 0))
        lit = smaller > 0
        # Plots do not need more digits than these.
        contrasts.append((larger[lit] / smaller[lit] - 1).astype(np.float32))
    finite = np.sort(np.concatenate(contrasts))
    if not finite.size:
        return None
    last = min(float(finite[min(int((1 - CUT_OFF) * finite.size), finite.size - 1)]), most)
    edges = np.linspace(0.0, last, _n_bins(values, last) + 1) if last > 0 else np.linspace(0.0, 1.0, 2)
    cumulative = (undefined + np.searchsorted(finite, edges.astype(np.float32), side="right")) / pairs
    return ContrastDistribution(edges, cumulative, (pairs - undefined - finite.size) / pairs, undefined / pairs)


def _n_bins(values: NDArray[np.float64], last: float) -> int:
    """Count the bins up to a contrast, none narrower than the contrast of neighbouring values, as of whole DN."""
    width = spacing(Distribution.from_array(values))
    return min(max(int(last * abs(float(values.mean())) / width), 1), MOST_BINS)
