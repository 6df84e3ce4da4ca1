"""Figures of a characterisation over signal, exposure or photons: photon transfer, linearity, SNR, dark signal."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ...calibration.emva.quantities import fit_dark_current, snr
from ...calibration.emva.result import columns
from ...calibration.emva.transfer import Linearity, linearity
from ...calibration.sensor.noise import FIT_SHARE
from ...report.drawing import BLUE, GREEN, ORANGE, VERMILLION, finish, logarithmic, new_figure, reported
from ...report.layout import ReportFigure, page_text
from ...report.text import Z_95, with_half_width
from .frames import patch_deviations

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...calibration.emva.result import Characterisation
    from ...core.quantity import Quantity

#: Figures, in the order they are shown.
_FIGURES = ("photon-transfer", "sensitivity", "linearity", "snr", "dark-current")
_POINTS: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 4, "linestyle": "none"}
_DASHED: dict[str, Any] = {"linewidth": 1.0, "linestyle": "dashed"}
_BARS: dict[str, Any] = {"fmt": "o", "color": "black", "markersize": 4, "capsize": 2.0}


def is_series(characterisation: Characterisation) -> bool:
    """Whether the points are one series over photons, not the patches of a session."""
    return all(point.photons is not None for point in characterisation.series)


def signal_figures(characterisation: Characterisation) -> list[ReportFigure]:
    """Draw photon transfer, sensitivity, linearity where it is known, SNR and dark signal."""
    heights_in = {"linearity": 6.6 if is_series(characterisation) else 4.6, "dark-current": 6.2}
    drawn, figures = (_photon_transfer, _sensitivity, _linearity, _snr, _dark), []
    for name, draw in zip(_FIGURES, drawn, strict=True):
        if name != "linearity" or characterisation.linearity_error_min_rel is not None:
            figure = sized(characterisation, heights_in.get(name, 4.6), 6.4 if name == "photon-transfer" else 9.0)
            draw(figure, characterisation)
            suffix = "-of-patches" if name == "sensitivity" and not is_series(characterisation) else ""
            caption = page_text(f"characterise-{name}{suffix}")
            figures.append(reported(f"characterise-{name}", figure, caption))
    return figures


def _photon_transfer(figure: Figure, result: Characterisation) -> None:
    """Draw temporal variance over signal, with the line whose slope is K."""
    axes = figure.subplots()
    net, variance = columns(result.series, "net_dn", "net_variance_dn2")
    limit = FIT_SHARE * result.saturation_dn.value
    fitted = (net > 0) & (net <= limit)
    axes.plot(net[~fitted], variance[~fitted], **(_POINTS | {"color": "0.6"}), label="not fitted")
    axes.plot(net[fitted], variance[fitted], **_POINTS, label="fitted")
    start = 0.0 if is_series(result) else max(float(net[net > 0].min()), 1e-3)
    _slope(axes, result.k_dn_per_e, "K", "DN/e⁻", (start, result.saturation_dn.value))
    _saturation(axes.axvline, result, result.saturation_dn.value)
    if not is_series(result):
        logarithmic(axes.xaxis, axes.yaxis)
    finish(axes, "mean above dark in DN", "temporal variance above dark in DN²", "Photon transfer")


def _sensitivity(figure: Figure, result: Characterisation) -> None:
    """Draw signal over photons with the line whose slope is R; of a session signal over exposure."""
    axes = figure.subplots()
    if is_series(result):
        axes.plot(*columns(result.series, "photons", "net_dn"), **_POINTS, label="measured")
        r, end = result.responsivity, result.saturation_photons
        if r is not None and end is not None:
            _slope(axes, r, "R", "DN/photon", (0.0, end.value))
            _saturation(axes.axvline, result, end.value)
        finish(axes, "photons per pixel", "mean above dark in DN", "Sensitivity")
        return
    for name in dict.fromkeys(point.label for point in result.series):
        points = [point for point in result.series if point.label == name and point.net_dn > 0]
        points.sort(key=lambda point: point.exposure_s)
        exposure_s, net = columns(points, "exposure_s", "net_dn")
        axes.plot(1e3 * exposure_s, net, "o-", color="0.5", markersize=4, linewidth=0.8)
    _saturation(axes.axhline, result, result.saturation_dn.value)
    logarithmic(axes.xaxis, axes.yaxis)
    finish(axes, "exposure in ms", "mean above dark in DN", "Sensitivity: each line is a patch")


def _linearity(figure: Figure, result: Characterisation) -> None:
    """Draw the deviations from the line over the stimulus, or those of patches over the signal."""
    deviations = (linearity if is_series(result) else patch_deviations)(result.series, result.saturation_dn.value)
    errors = [error.value for error in (result.linearity_error_min_rel, result.linearity_error_max_rel) if error]
    assert deviations is not None
    if isinstance(deviations, Linearity):
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.2, 1.0))
        photons, net = columns(result.series, "photons", "net_dn")
        ends = np.array([0.0, photons.max()])
        above.plot(photons, net, **_POINTS, label="measured")
        text = f"line: {deviations.intercept_dn:.4g} DN + {deviations.slope_dn:.5g} DN/photon"
        above.plot(ends, deviations.intercept_dn + deviations.slope_dn * ends, color=BLUE, linewidth=1.5, label=text)
        finish(above, "", "mean above dark in DN", "Linearity, from 5 to 95 % of saturation")
        x, label, title = deviations.stimulus, "photons per pixel", "Deviation from the line"
    else:
        below, x, label = figure.subplots(), deviations.net_dn, "mean above dark in DN"
        title = "Deviation of each patch from its own line over the exposure"
    below.errorbar(x, 100 * deviations.deviation_rel, yerr=100 * Z_95 * deviations.uncertainty_rel, **_BARS)
    below.axhline(0.0, color=BLUE, linewidth=1.5)
    text = " and ".join(f"{100 * error:+.3f} %" for error in errors)
    for error, label_once in zip(errors, (text, None), strict=True):
        below.axhline(100 * error, color=ORANGE, **_DASHED, label=label_once)
    finish(below, label, "deviation in %", f"{title}, bars: U (95 %) by noise, black level and lamp")


def _snr(figure: Figure, result: Characterisation) -> None:
    """Draw SNR over photons or electrons: measured, by the model, with the fixed pattern, and ideal."""
    axes = figure.subplots()
    series = is_series(result) and result.quantum_efficiency is not None
    k, qe = result.k_dn_per_e.value, result.quantum_efficiency.value if series and result.quantum_efficiency else 1.0
    net, variance, photons = columns(result.series, "net_dn", "light.temporal_variance_dn2", "photons")
    stimulus = photons if series else net / k
    sound = (net > 0) & (variance > 0) & (net <= result.saturation_dn.value) & (stimulus > 0)
    axes.plot(stimulus[sound], net[sound] / np.sqrt(variance[sound]), **_POINTS, label="measured")
    threshold, full = result.sensitivity_threshold_e.value, result.full_well_e.value
    electrons = np.geomspace(threshold / 2, full, 200)
    dark = result.dark_noise_e.value
    axes.plot(electrons / qe, snr(electrons, dark, k), color=BLUE, linewidth=1.5, label="temporal noise, by the model")
    if result.dsnu_e is not None and result.prnu_rel is not None:
        total = snr(electrons, dark, k, max(result.dsnu_e.value, 0.0), max(result.prnu_rel.value, 0.0))
        axes.plot(electrons / qe, total, color=GREEN, linewidth=1.5, label="with DSNU and PRNU")
    text = "ideal sensor (QE 100 %)" if series else "photon noise alone"
    axes.plot(electrons / qe, np.sqrt(electrons / qe), color="0.5", **_DASHED, label=text)
    axes.axvline(threshold / qe, color=ORANGE, linewidth=1.0, linestyle="dotted", label="threshold, SNR 1")
    _saturation(axes.axvline, result, full / qe)
    logarithmic(axes.xaxis, axes.yaxis)
    x = "photons per pixel" if series else "photo-electrons per pixel"
    finish(axes, x, "SNR (mean / standard deviation)", "Signal-to-noise ratio")


def _dark(figure: Figure, result: Characterisation) -> None:
    """Draw mean and variance of the dark signal over the exposure, with the lines of the dark current."""
    above, below = figure.subplots(2, 1, sharex=True)
    fitted, exposure_ms = fit_dark_current(result.darks), 1e3 * columns(result.darks, "exposure_s")[0]
    ends = np.array([0.0, float(exposure_ms.max())])
    mean, variance = (
        (fitted.model.offset_dn, fitted.model.rate_dn_s),
        (fitted.variance.intercept, fitted.variance.slope),
    )
    rows = (
        (above, "mean_dn", mean, result.dark_current_e_s, "", "mean in DN", "Dark signal"),
        (below, "temporal_variance_dn2", variance, result.dark_current_by_variance_e_s,
         "exposure in ms", "variance in DN²", ""),
    )  # fmt: skip
    for axes, name, (intercept, slope), current, *labels in rows:
        axes.plot(exposure_ms, columns(result.darks, name)[0], **_POINTS)
        stated = "" if current is None else f"dark current {_with_expanded(current)} e⁻/s"
        text = stated or "one exposure only: no dark current"
        axes.plot(ends, intercept + slope * ends / 1e3, color=BLUE, linewidth=1.5, label=text)
        axes.margins(y=0.25)
        finish(axes, *labels)


def sized(result: Characterisation, height_in: float, width_in: float = 9.0) -> Figure:
    """Return an empty figure that says whether the camera is simulated."""
    return new_figure(width_in, height_in, "camera" if result.simulated else "")


def _slope(axes: Axes, slope: Quantity, name: str, unit: str, ends: tuple[float, float]) -> None:
    """Draw a line through the origin, dotted beyond the points it is fitted to."""
    fitted, beyond = np.array([ends[0], FIT_SHARE * ends[1]]), np.array([FIT_SHARE, 1.0]) * ends[1]
    text = f"{name} = {_with_expanded(slope)} {unit}"
    axes.plot(fitted, slope.value * fitted, color=BLUE, linewidth=1.5, label=text)
    axes.plot(beyond, slope.value * beyond, color=BLUE, linewidth=1.5, linestyle="dotted")


def _with_expanded(quantity: Quantity) -> str:
    return with_half_width(quantity.value, quantity.U)


def _saturation(line: Callable[..., object], result: Characterisation, x: float) -> None:
    text = "brightest, saturation not reached" if result.saturation_limit == "not reached" else "saturation"
    line(x, color=VERMILLION, **_DASHED, label=text)
