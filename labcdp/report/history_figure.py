"""The history of a camera as a figure: responsivity, darkness and gain over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .digits import printable
from .drawing import BLUE, LABEL_SIZE, SMALL_SIZE, TITLE_SIZE, new_figure, png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..calibration.history import CameraHistory, HistoryPoint

#: A value with its half widths of 95 %, without and with what points share; None where it is not known.
_Value = tuple[float, float, float] | None


def history_figure(one: CameraHistory) -> bytes:
    """Draw responsivity, dark offset, dark rate and K over time, as PNG."""
    panels: list[tuple[str, list[_Value]]] = [
        ("responsivity in\nDN s⁻¹ / (cd m⁻²)", [_responsivity(p) for p in one.points]),
        ("dark offset in DN", [_offset(p) for p in one.points]),
        ("dark rate in DN/s", [_rate(p) for p in one.points]),
        ("K in DN/e⁻", [None if p.k_dn_per_e is None else (p.k_dn_per_e, 0.0, 0.0) for p in one.points]),
    ]
    shown = [(label, values) for label, values in panels if any(value is not None for value in values)]
    figure = new_figure(8.0, 0.9 + 1.9 * len(shown), one.camera.simulated)
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (label, values) in zip(axes, shown, strict=True):
        _draw(panel, one.points, values)
        panel.set_ylabel(label, fontsize=LABEL_SIZE)
    lens = f"{one.lens.model} at f/{one.lens.f_number:g}, {one.gain_db:g} dB"
    axes[0].set_title(f"{printable(str(one.camera))}\n{printable(lens)}", fontsize=TITLE_SIZE, parse_math=False)
    axes[-1].set_xlabel("time of measurement (UTC)", fontsize=LABEL_SIZE)
    _time_axis(axes[-1])
    return png(figure)


def _responsivity(point: HistoryPoint) -> _Value:
    r = point.responsivity_dn_s_cd_m2
    return r, r * point.random_half_width_rel, r * point.half_width_95_rel


def _offset(point: HistoryPoint) -> _Value:
    return point.dark_offset_dn, point.dark_offset_half_width_dn, point.dark_offset_half_width_dn


def _rate(point: HistoryPoint) -> _Value:
    if point.dark_rate_dn_s is None or point.dark_rate_half_width_dn_s is None:
        return None
    return point.dark_rate_dn_s, point.dark_rate_half_width_dn_s, point.dark_rate_half_width_dn_s


def _draw(axes: Axes, points: Sequence[HistoryPoint], values: Sequence[_Value]) -> None:
    known = [(p, v) for p, v in zip(points, values, strict=True) if v is not None]
    # Days since 1970, as matplotlib counts them.
    times = [p.measured.timestamp() / 86400 for p, _ in known]
    axes.plot(times, [v[0] for _, v in known], color="0.75", linewidth=1.0, zorder=1)
    for (point, (value, own, whole)), time in zip(known, times, strict=True):
        filled = "black" if point.kind == "calibration" else "white"
        axes.errorbar(time, value, yerr=whole, fmt="none", ecolor=BLUE, elinewidth=1.0, capsize=3.0, zorder=2)
        axes.errorbar(time, value, yerr=own, fmt="none", ecolor=BLUE, elinewidth=3.0, zorder=3)
        axes.plot([time], [value], "o", markersize=6, color="black", markerfacecolor=filled, zorder=4)
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.margins(x=0.06, y=0.15)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.tick_params(labelsize=SMALL_SIZE)


def _time_axis(axes: Axes) -> None:
    from matplotlib import dates

    # matplotlib's dates have no types.
    make: Any = dates
    locator = make.AutoDateLocator(minticks=3, maxticks=8)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(make.ConciseDateFormatter(locator))
