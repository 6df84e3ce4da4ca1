"""Plots of a characterisation that go over signal, exposure or photons: photon transfer, linearity, SNR, darkness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..calibration.emva.dark_current import fit_darkness
from ..calibration.emva.linearity import linearity
from ..calibration.emva.photon_transfer import FIT_SHARE
from ..calibration.emva.snr import snr
from ..evaluate.characterise_light import patch_deviations
from .digits import Z_95, with_half_width
from .drawing import BLUE, GREEN, ORANGE, SMALL_SIZE, VERMILLION, label, mark_simulated, new_figure, plain_numbers, png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..calibration.emva.result import Characterisation, SeriesPoint

_SIZE_IN = (9.0, 4.6)


def is_series(result: Characterisation) -> bool:
    """Whether the points are one series over photons, not the patches of a session."""
    return all(point.photons is not None for point in result.series)


def photon_transfer_figure(result: Characterisation) -> bytes:
    """Draw temporal variance over signal, with the line whose slope is K."""
    figure, axes = _figure(result)
    k = result.k_dn_per_e
    net, variance = _values(result.series, "net_dn"), _values(result.series, "net_variance_dn2")
    saturation = result.saturation_dn.value
    logarithmic = not is_series(result)
    limit = FIT_SHARE * saturation
    start = max(float(net[net > 0].min()), 1e-3) if logarithmic else 0.0
    fitted = (net > 0) & (net <= limit)
    axes.plot(net[~fitted], variance[~fitted], "o", color="0.6", markersize=4, label="not fitted")
    axes.plot(net[fitted], variance[fitted], "o", color="black", markersize=4, label="fitted")
    ends = np.array([start, limit])
    text = f"K = {with_half_width(k.value, k.standard_uncertainty)} DN/e⁻ (standard uncertainty)"
    axes.plot(ends, k.value * ends, color=BLUE, linewidth=1.5, label=text)
    beyond = np.array([limit, saturation])
    axes.plot(beyond, k.value * beyond, color=BLUE, linewidth=1.5, linestyle="dotted")
    axes.axvline(saturation, color=VERMILLION, linewidth=1.0, linestyle="dashed", label=_saturation_text(result))
    if logarithmic:
        _both_logarithmic(axes)
    _finish(axes, "mean above darkness in DN", "temporal variance above darkness in DN²", "Photon transfer")
    return png(figure)


def sensitivity_figure(result: Characterisation) -> bytes:
    """Draw signal over photons with the line whose slope is R; for a session signal over exposure."""
    figure, axes = _figure(result)
    if is_series(result):
        photons, net = _values(result.series, "photons"), _values(result.series, "net_dn")
        axes.plot(photons, net, "o", color="black", markersize=4, label="measured")
        r, end = result.responsivity, result.saturation_photons
        if r is not None and end is not None:
            ends = np.array([0.0, FIT_SHARE * end.value])
            text = f"R = {with_half_width(r.value, r.standard_uncertainty)} DN/photon (standard uncertainty)"
            axes.plot(ends, r.value * ends, color=BLUE, linewidth=1.5, label=text)
            beyond = np.array([FIT_SHARE, 1.0]) * end.value
            axes.plot(beyond, r.value * beyond, color=BLUE, linewidth=1.5, linestyle="dotted")
            axes.axvline(end.value, color=VERMILLION, linewidth=1.0, linestyle="dashed", label=_saturation_text(result))
        _finish(axes, "photons per pixel", "mean above darkness in DN", "Sensitivity")
        return png(figure)
    for name in dict.fromkeys(point.label for point in result.series):
        own = [point for point in result.series if point.label == name and point.net_dn > 0]
        own.sort(key=lambda point: point.exposure_s)
        exposure_ms = 1e3 * _values(own, "exposure_s")
        axes.plot(exposure_ms, _values(own, "net_dn"), "o-", color="0.5", markersize=4, linewidth=0.8)
    axes.axhline(
        result.saturation_dn.value, color=VERMILLION, linewidth=1.0, linestyle="dashed", label=_saturation_text(result)
    )
    _both_logarithmic(axes)
    _finish(axes, "exposure in ms", "mean above darkness in DN", "Sensitivity: each line is a patch")
    return png(figure)


def linearity_figure(result: Characterisation) -> bytes | None:
    """Draw the deviations from the line over the stimulus; None where linearity is not known."""
    if result.linearity_error_min_rel is None or result.linearity_error_max_rel is None:
        return None
    saturation = result.saturation_dn.value
    if not is_series(result):
        return _patch_linearity(result, saturation)
    line = linearity(result.series, saturation)
    assert line is not None
    figure = _sized(result, 6.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.2, 1.0))
    x = _values(result.series, "photons")
    ends = np.array([0.0, x.max()])
    above.plot(x, _values(result.series, "net_dn"), "o", color="black", markersize=4, label="measured")
    text = f"line: {line.intercept_dn:.4g} DN + {line.slope_dn:.5g} DN/photon"
    above.plot(ends, line.intercept_dn + line.slope_dn * ends, color=BLUE, linewidth=1.5, label=text)
    _finish(above, "", "mean above darkness in DN", "Linearity, from 5 to 95 % of saturation")
    below.errorbar(
        line.stimulus,
        100 * line.deviation_rel,
        yerr=100 * Z_95 * line.uncertainty_rel,
        fmt="o-",
        color="black",
        markersize=4,
        linewidth=0.8,
        capsize=2.0,
    )
    _draw_limits(below, result)
    _finish(below, "photons per pixel", "deviation in %", "Deviation from the line, bars: 95 % of temporal noise")
    return png(figure)


def _patch_linearity(result: Characterisation, saturation_net_dn: float) -> bytes:
    figure, axes = _figure(result)
    rows = patch_deviations(result.series, saturation_net_dn)
    axes.errorbar(
        [row.point.net_dn for row in rows],
        [100 * row.deviation_rel for row in rows],
        yerr=[100 * Z_95 * row.uncertainty_rel for row in rows],
        fmt="o",
        color="black",
        markersize=4,
        capsize=2.0,
    )
    _draw_limits(axes, result)
    title = "Deviation of each patch from its own line over the exposure, bars: 95 % of temporal noise"
    _finish(axes, "mean above darkness in DN", "deviation in %", title)
    return png(figure)


def _draw_limits(axes: Axes, result: Characterisation) -> None:
    low, high = result.linearity_error_min_rel, result.linearity_error_max_rel
    assert low is not None
    assert high is not None
    axes.axhline(0.0, color=BLUE, linewidth=1.5)
    text = f"{100 * low.value:+.3f} % and {100 * high.value:+.3f} %"
    axes.axhline(100 * low.value, color=ORANGE, linewidth=1.0, linestyle="dashed", label=text)
    axes.axhline(100 * high.value, color=ORANGE, linewidth=1.0, linestyle="dashed")


def snr_figure(result: Characterisation) -> bytes:
    """Draw SNR over photons or electrons: measured, by the model, with the fixed pattern, and ideal."""
    figure, axes = _figure(result)
    series = is_series(result) and result.quantum_efficiency is not None
    k, qe = result.k_dn_per_e.value, result.quantum_efficiency.value if series and result.quantum_efficiency else 1.0
    net, variance = _values(result.series, "net_dn"), _values(result.series, "variance_dn2")
    sound = (net > 0) & (variance > 0) & (net <= result.saturation_dn.value)
    stimulus = _values(result.series, "photons") if series else net / k
    sound &= stimulus > 0
    axes.plot(
        stimulus[sound], net[sound] / np.sqrt(variance[sound]), "o", color="black", markersize=4, label="measured"
    )
    threshold, full = result.sensitivity_threshold_e.value, result.full_well_e.value
    electrons = np.geomspace(threshold / 2, full, 200)
    dark = result.dark_noise_e.value
    axes.plot(electrons / qe, snr(electrons, dark, k), color=BLUE, linewidth=1.5, label="temporal noise, by the model")
    if result.dsnu_e is not None and result.prnu_rel is not None:
        total = snr(electrons, dark, k, result.dsnu_e.value, result.prnu_rel.value)
        axes.plot(electrons / qe, total, color=GREEN, linewidth=1.5, label="with DSNU and PRNU")
    ideal = np.sqrt(electrons / qe)
    text = "ideal sensor (QE 100 %)" if series else "photon noise alone"
    axes.plot(electrons / qe, ideal, color="0.5", linewidth=1.2, linestyle="dashed", label=text)
    axes.axvline(threshold / qe, color=ORANGE, linewidth=1.0, linestyle="dotted", label="threshold, SNR 1")
    axes.axvline(full / qe, color=VERMILLION, linewidth=1.0, linestyle="dashed", label=_saturation_text(result))
    _both_logarithmic(axes)
    x = "photons per pixel" if series else "photo-electrons per pixel"
    _finish(axes, x, "SNR (mean / standard deviation)", "Signal-to-noise ratio")
    return png(figure)


def dark_figure(result: Characterisation) -> bytes:
    """Draw mean and variance of darkness over the exposure, with the lines of the dark current."""
    figure = _sized(result, 6.2)
    above, below = figure.subplots(2, 1, sharex=True)
    darkness = fit_darkness(result.darks)
    exposure_ms = 1e3 * np.array([point.exposure_s for point in result.darks])
    ends = np.array([0.0, float(exposure_ms.max())])
    rows = (
        (above, [p.mean_dn for p in result.darks], darkness.mean, "mean in DN", result.dark_current_e_s),
        (
            below,
            [p.variance_dn2 for p in result.darks],
            darkness.variance,
            "variance in DN²",
            result.dark_current_by_variance_e_s,
        ),
    )
    for axes, values, fit, unit, current in rows:
        axes.plot(exposure_ms, values, "o", color="black", markersize=4)
        text = (
            "one exposure only: no dark current"
            if current is None
            else f"dark current {with_half_width(current.value, current.standard_uncertainty)} e⁻/s"
        )
        axes.plot(ends, fit.intercept + fit.slope * ends / 1e3, color=BLUE, linewidth=1.5, label=text)
        axes.margins(y=0.25)
        _finish(axes, "exposure in ms" if axes is below else "", unit, "Darkness" if axes is above else "")
    return png(figure)


def _figure(result: Characterisation) -> tuple[Figure, Axes]:
    figure = _sized(result, _SIZE_IN[1])
    return figure, figure.subplots()


def _sized(result: Characterisation, height_in: float) -> Figure:
    figure = new_figure(_SIZE_IN[0], height_in, simulated=False)
    if result.simulated:
        mark_simulated(figure, "camera")
    return figure


def _values(points: Sequence[SeriesPoint], name: str) -> NDArray[np.float64]:
    return np.array([getattr(point, name) for point in points], dtype=np.float64)


def _saturation_text(result: Characterisation) -> str:
    return "brightest, saturation not reached" if result.saturation_limit == "not reached" else "saturation"


def _both_logarithmic(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        one_two_five(axis)


def one_two_five(axis: Any) -> None:
    """Write 1, 2, 5, 10 and so on at a logarithmic axis."""
    from matplotlib.ticker import LogLocator

    plain_numbers(axis)
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))


def _finish(axes: Axes, x: str, y: str, title: str) -> None:
    label(axes, x, y, title)
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=SMALL_SIZE)
