"""Figures of the spatial non-uniformity: histograms, spectrograms and profiles, after EMVA 1288."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, floor, lcm
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...report.drawing import BLUE, GREEN, ORANGE, VERMILLION, finish, logarithmic, reported
from ...report.layout import ReportFigure, page_text
from .figures import sized

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...calibration.emva.result import Characterisation

#: Side of the box whose mean is subtracted before the histograms, in pixels (EMVA 1288).
HIGH_PASS_SIDE = 5
#: Bins of a histogram (EMVA 1288: at most 256).
_MOST_BINS = 256
_WIDTH_IN = 10.0


class Pattern(NamedTuple):
    """A fixed pattern to draw.

    Parameters
    ----------
    name, unit : str
        DSNU in DN, or PRNU in %.
    values : ndarray of float, shape (height, width)
        Deviations from the mean.
    noise : float
        Standard deviation that temporal noise leaves in a pixel.
    step : float
        Smallest difference of two values, as means of whole DN have it.
    """

    name: str
    unit: str
    values: NDArray[np.float32]
    noise: float
    step: float


def spatial_figures(characterisation: Characterisation) -> list[ReportFigure]:
    """Draw histograms, spectrograms and profiles, if there are images."""
    shown_patterns, figures = patterns(characterisation), []
    drawn = {"histogram": _histogram, "accumulated": _accumulated, "spectrogram": _spectrogram, "profile": _profile}
    for name, draw in drawn.items() if shown_patterns else ():
        caption = page_text(f"characterise-{name}", side=HIGH_PASS_SIDE)
        figures.append(reported(f"characterise-{name}", _drawn(characterisation, shown_patterns, draw), caption))
    return figures


def patterns(result: Characterisation) -> list[Pattern]:
    """Return DSNU, and PRNU if there are bright images, as deviations from the mean."""
    if not result.spatial:
        return []
    dark, *lit = result.spatial
    dark_noise = dark.temporal_variance_dn2 / dark.n_frames
    deviation = dark.image_dn - dark.image_dn.mean(dtype=np.float64).astype(np.float32)
    noise_patterns = [Pattern("DSNU", "DN", deviation, float(np.sqrt(dark_noise)), 1 / dark.n_frames)]
    for bright in lit:
        net = bright.image_dn - dark.image_dn
        mean = float(net.mean(dtype=np.float64))
        noise = np.sqrt(bright.temporal_variance_dn2 / bright.n_frames + dark_noise)
        deviation = (net * np.float32(100 / mean) - np.float32(100)).astype(np.float32)
        step = 100 / mean / lcm(dark.n_frames, bright.n_frames)
        noise_patterns.append(Pattern("PRNU", "%", deviation, float(100 * noise / mean), step))
    return noise_patterns


def _drawn(
    result: Characterisation,
    spatial: Sequence[Pattern],
    draw: Callable[[Axes, Pattern, NDArray[np.float64], str], None],
) -> Figure:
    """Draw each pattern: histograms side by side, or rows and columns of each in a line."""
    if draw in (_histogram, _accumulated):
        figure = sized(result, 4.4, _WIDTH_IN)
        for axes, pattern in zip(figure.subplots(1, len(spatial), squeeze=False)[0], spatial, strict=True):
            draw(axes, pattern, high_pass(pattern.values), "")
        return figure
    figure = sized(result, 3.6 * len(spatial), _WIDTH_IN)
    for panels, pattern in zip(figure.subplots(len(spatial), 2, squeeze=False), spatial, strict=True):
        values = pattern.values.astype(np.float64)
        draw(panels[0], pattern, values, "horizontal")
        draw(panels[1], pattern, values.T, "vertical")
    return figure


def _histogram(axes: Axes, pattern: Pattern, values: NDArray[np.float64], _direction: str) -> None:
    """Draw a logarithmic histogram of the deviations, with the normal curve of equal spread."""
    counts, edges = np.histogram(values, bins=histogram_edges(values, pattern.step / HIGH_PASS_SIDE**2))
    centres, width = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
    axes.stairs(np.where(counts > 0, counts, np.nan), edges, color="black", linewidth=1.0, label="pixels")
    # Interquartile range, robust against outliers; 1.349 is its width for a normal distribution.
    low, middle, high = np.percentile(values, [25, 50, 75])
    robust = max(float(high - low) / 1.349, 1e-12)
    for spread, colour, text in (
        (robust, BLUE, f"normal, {robust:.3g} {pattern.unit}"),
        (max(pattern.noise, 1e-12), ORANGE, f"temporal noise left, {pattern.noise:.2g} {pattern.unit}"),
    ):
        density = np.exp(-((centres - middle) ** 2) / (2 * spread**2)) / (spread * np.sqrt(2 * np.pi))
        expected = values.size * width * density
        axes.plot(centres, np.where(expected > 0.3, expected, np.nan), color=colour, linewidth=1.5, label=text)
    axes.set_ylim(0.5, 3 * counts.max())
    logarithmic(axes.yaxis)
    finish(axes, f"deviation in {pattern.unit}", "pixels per bin", f"{pattern.name}, logarithmic histogram")


def _accumulated(axes: Axes, pattern: Pattern, values: NDArray[np.float64], _direction: str) -> None:
    """Draw the share of pixels that deviate by more than a value, logarithmic."""
    deviation = np.sort(np.abs(values), axis=None)
    share = 100 * (1 - np.arange(deviation.size) / deviation.size)
    # All pixels would be millions of points: the tail, and as many of the others.
    chosen = np.unique(deviation.size - np.unique(np.geomspace(1, deviation.size, 2000).astype(np.int64)))
    axes.plot(deviation[chosen], share[chosen], color="black", linewidth=1.5)
    logarithmic(axes.yaxis)
    title = f"{pattern.name}, accumulated histogram"
    finish(axes, f"absolute deviation in {pattern.unit}", "share of pixels beyond, in %", title)


def _spectrogram(axes: Axes, pattern: Pattern, values: NDArray[np.float64], direction: str) -> None:
    """Draw the spectrum of rows or columns: peaks are periodic patterns."""
    spectrum = amplitude_spectrum(values)
    frequency = np.arange(spectrum.size) / values.shape[1]
    axes.plot(frequency[1:], spectrum[1:], color="black", linewidth=0.8)
    white = float(np.median(spectrum[1:]))
    axes.axhline(white, color=BLUE, linewidth=1.2, label=f"median, {white:.3g} {pattern.unit}")
    if pattern.noise > 0:
        text = f"temporal noise left, {pattern.noise:.2g} {pattern.unit}"
        axes.axhline(pattern.noise, color=ORANGE, linewidth=1.2, linestyle="dashed", label=text)
    logarithmic(axes.yaxis)
    title = f"{pattern.name}, {direction} spectrogram"
    finish(axes, "cycles per pixel", f"amplitude in {pattern.unit}", title)


def _profile(axes: Axes, pattern: Pattern, values: NDArray[np.float64], direction: str) -> None:
    """Draw profiles along rows or columns: mean, middle, lowest and highest."""
    x = np.arange(values.shape[1])
    for profile, colour, name, width in (
        (values.max(axis=0), VERMILLION, "highest", 0.7),
        (values[values.shape[0] // 2], "0.6", "middle", 0.7),
        (values.mean(axis=0), "black", "mean", 1.0),
        (values.min(axis=0), GREEN, "lowest", 0.7),
    ):
        axes.plot(x, profile, color=colour, linewidth=width, label=name)
    # A hot pixel must not flatten all else.
    low, high = np.percentile(values, [0.01, 99.99])
    if high > low:
        axes.set_ylim(low - (high - low) / 2, high + (high - low) / 2)
    index_name = "column" if direction == "horizontal" else "row"
    finish(axes, index_name, f"deviation in {pattern.unit}", f"{pattern.name}, {direction} profile")


def histogram_edges(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return edges of at most 256 bins that all hold equally many of the values that can occur, `step` apart."""
    low, high = float(values.min()), float(values.max())
    width = step * max(ceil((high - low) / step / (_MOST_BINS - 2)), 1)
    # Values lie within the bins, not on their edges.
    start = (floor(low / step) - 0.5) * step
    return start + width * np.arange(floor((high - start) / width) + 2, dtype=np.float64)


def high_pass(values: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Subtract the mean of the 5 x 5 pixels around each, so that slow changes do not count as defects."""
    from scipy.ndimage import uniform_filter

    image = np.asarray(values, dtype=np.float64)
    return image - uniform_filter(image, HIGH_PASS_SIDE, mode="reflect")


def amplitude_spectrum(values: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Root of the mean power spectrum of the rows; white noise has its standard deviation at each frequency.

    Parameters
    ----------
    values : ndarray of float, shape (height, width)
        Deviations from the mean.

    Returns
    -------
    ndarray of float, shape (width // 2 + 1,)
        sqrt(mean |FFT|^2 / width) (EMVA 1288).
    """
    from scipy.fft import rfft

    transform = rfft(values, axis=1)
    power: NDArray[np.float64] = np.sqrt(np.mean(np.abs(transform) ** 2, axis=0, dtype=np.float64) / values.shape[1])
    return power
