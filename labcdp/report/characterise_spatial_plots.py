"""Plots of the spatial non-uniformity: histograms, spectrograms and profiles, after EMVA 1288."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .characterise_plots import one_two_five
from .drawing import BLUE, GREEN, ORANGE, SMALL_SIZE, VERMILLION, label, mark_simulated, new_figure, png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..calibration.emva.result import Characterisation

#: Side of the box whose mean is taken off before the histograms, in pixels (EMVA 1288 Release 3.1, section 8.1).
HIGH_PASS_SIDE = 5
#: Bins of a histogram (EMVA 1288 Release 3.1, section 8.5: at most 256).
_N_BINS = 256


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
    """

    name: str
    unit: str
    values: NDArray[np.float32]
    noise: float


def patterns(result: Characterisation) -> list[Pattern]:
    """Return DSNU, and PRNU if there are bright images, as deviations from the mean."""
    images = result.spatial
    if images is None:
        return []
    dark = images.dark_dn
    dark_noise = images.dark_variance_dn2 / images.dark_frames
    found = [Pattern("DSNU", "DN", dark - dark.mean(dtype=np.float64).astype(np.float32), float(np.sqrt(dark_noise)))]
    if images.bright_dn is not None:
        net = images.bright_dn - dark
        mean = float(net.mean(dtype=np.float64))
        noise = np.sqrt(images.bright_variance_dn2 / images.bright_frames + dark_noise)
        deviation = (net * np.float32(100 / mean) - np.float32(100)).astype(np.float32)
        found.append(Pattern("PRNU", "%", deviation, float(100 * noise / mean)))
    return found


def histogram_figure(result: Characterisation) -> bytes:
    """Draw logarithmic histograms of the deviations, high-pass filtered, with the normal curve of equal spread."""
    found = patterns(result)
    figure = _figure(result, 4.4)
    for axes, pattern in zip(figure.subplots(1, len(found), squeeze=False)[0], found, strict=True):
        values = high_pass(pattern.values)
        counts, edges = np.histogram(values, bins=_N_BINS)
        centres, width = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
        axes.stairs(np.where(counts > 0, counts, np.nan), edges, color="black", linewidth=1.0, label="pixels")
        # The middle half tells the spread without the outliers; 1.349 = width of it for a normal distribution.
        low, middle, high = np.percentile(values, [25, 50, 75])
        robust = max(float(high - low) / 1.349, 1e-12)
        for spread, colour, text in (
            (robust, BLUE, f"normal, {robust:.3g} {pattern.unit}"),
            (max(pattern.noise, 1e-12), ORANGE, f"temporal noise left, {pattern.noise:.2g} {pattern.unit}"),
        ):
            density = np.exp(-((centres - middle) ** 2) / (2 * spread**2)) / (spread * np.sqrt(2 * np.pi))
            expected = values.size * width * density
            axes.plot(centres, np.where(expected > 0.3, expected, np.nan), color=colour, linewidth=1.5, label=text)
        axes.set_yscale("log")
        axes.set_ylim(0.5, 3 * counts.max())
        _finish(axes, f"deviation in {pattern.unit}", "pixels per bin", f"{pattern.name}, logarithmic histogram")
    return png(figure)


def accumulated_figure(result: Characterisation) -> bytes:
    """Draw the share of pixels that deviate by more than a value, logarithmic."""
    found = patterns(result)
    figure = _figure(result, 4.4)
    for axes, pattern in zip(figure.subplots(1, len(found), squeeze=False)[0], found, strict=True):
        deviation = np.sort(np.abs(high_pass(pattern.values)), axis=None)
        share = 100 * (1 - np.arange(deviation.size) / deviation.size)
        # All pixels would be millions of points: the tail, and as many of the others.
        chosen = np.unique(deviation.size - np.unique(np.geomspace(1, deviation.size, 2000).astype(np.int64)))
        axes.plot(deviation[chosen], share[chosen], color="black", linewidth=1.5)
        axes.set_yscale("log")
        title = f"{pattern.name}, accumulated histogram"
        _finish(axes, f"absolute deviation in {pattern.unit}", "share of pixels beyond, in %", title)
    return png(figure)


def spectrogram_figure(result: Characterisation) -> bytes:
    """Draw the spectra of rows (horizontal) and columns (vertical): peaks are periodic patterns."""
    found = patterns(result)
    figure = _figure(result, 3.6 * len(found))
    for panels, pattern in zip(figure.subplots(len(found), 2, squeeze=False), found, strict=True):
        for axes, values, name in zip(
            panels, (pattern.values, pattern.values.T), ("horizontal", "vertical"), strict=True
        ):
            spectrum = amplitude_spectrum(values)
            frequency = np.arange(spectrum.size) / values.shape[1]
            axes.plot(frequency[1:], spectrum[1:], color="black", linewidth=0.8)
            white = float(np.median(spectrum[1:]))
            axes.axhline(white, color=BLUE, linewidth=1.2, label=f"median, {white:.3g} {pattern.unit}")
            if pattern.noise > 0:
                text = f"temporal noise left, {pattern.noise:.2g} {pattern.unit}"
                axes.axhline(pattern.noise, color=ORANGE, linewidth=1.2, linestyle="dashed", label=text)
            axes.set_yscale("log")
            one_two_five(axes.yaxis)
            _finish(
                axes,
                "cycles per pixel",
                f"amplitude in {pattern.unit}",
                f"{pattern.name}, {name} spectrogram",
            )
    return png(figure)


def profile_figure(result: Characterisation) -> bytes:
    """Draw profiles along rows and columns: mean, middle, lowest and highest."""
    found = patterns(result)
    figure = _figure(result, 3.6 * len(found))
    for panels, pattern in zip(figure.subplots(len(found), 2, squeeze=False), found, strict=True):
        for axes, values, name in zip(
            panels, (pattern.values, pattern.values.T), ("horizontal", "vertical"), strict=True
        ):
            x = np.arange(values.shape[1])
            axes.plot(x, values.max(axis=0), color=VERMILLION, linewidth=0.7, label="highest")
            axes.plot(x, values[values.shape[0] // 2], color="0.6", linewidth=0.7, label="middle")
            axes.plot(x, values.mean(axis=0), color="black", linewidth=1.0, label="mean")
            axes.plot(x, values.min(axis=0), color=GREEN, linewidth=0.7, label="lowest")
            # A hot pixel must not flatten all else.
            low, high = np.percentile(values, [0.01, 99.99])
            axes.set_ylim(low - (high - low) / 2, high + (high - low) / 2)
            _finish(
                axes,
                "column" if name == "horizontal" else "row",
                f"deviation in {pattern.unit}",
                f"{pattern.name}, {name} profile",
            )
    return png(figure)


def high_pass(values: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Take off the mean of the 5 x 5 pixels around each, so that slow changes do not count as defects."""
    from scipy.ndimage import uniform_filter

    image = np.asarray(values, dtype=np.float64)
    filtered: NDArray[np.float64] = image - uniform_filter(image, HIGH_PASS_SIDE, mode="reflect")
    return filtered


def amplitude_spectrum(values: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Root of the mean power spectrum of the rows; white noise has its standard deviation at each frequency.

    Parameters
    ----------
    values : ndarray of float, shape (height, width)
        Deviations from the mean.

    Returns
    -------
    ndarray of float, shape (width // 2 + 1,)
        sqrt(mean |FFT|^2 / width) (EMVA 1288 Release 3.1, section 8.3).
    """
    from scipy.fft import rfft

    transform = rfft(values, axis=1)
    power: NDArray[np.float64] = np.sqrt(np.mean(np.abs(transform) ** 2, axis=0, dtype=np.float64) / values.shape[1])
    return power


def _figure(result: Characterisation, height_in: float) -> Any:
    figure = new_figure(10.0, height_in, simulated=False)
    if result.simulated:
        mark_simulated(figure, "camera")
    return figure


def _finish(axes: Axes, x: str, y: str, title: str) -> None:
    label(axes, x, y, title)
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=SMALL_SIZE)
