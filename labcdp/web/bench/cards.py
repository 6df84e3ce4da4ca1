"""Numbers of the live page: cards, table of readings, plots of CDP over time and contrast, histogram."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import is_dataclass
from itertools import starmap
from math import inf, isfinite
from time import monotonic
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, Range1d, Span
from bokeh.palettes import Viridis256

from ...core.clock import exposure_text
from ...report.text import significant
from ..html import small_plot, table, table_row, text
from ..regions.measurements import PairEvaluation, is_saturated
from ..regions.wording import contrast_text
from .day_log import MeterReading
from .live import LiveState
from .live_bench import LiveBench
from .pair import LIMIT, TRACE_S, PairPoint, PlannedPair, pair_points

#: Names and units of settings for a person; others have the name of their field.
_NAMES = {"exposure_s": ("exposure", " s"), "gain_db": ("gain", " dB"), "frame_rate_hz": ("frame rate", " Hz")}

#: Readings in the table; a day may have more.
_MOST_READINGS = 100

_STATES = {"detected": "good", "undecided": "open"} | dict.fromkeys(
    ("too weak", "too strong", "too noisy", "saturated"), "bad"
)


def camera_card(bench: LiveBench) -> str:
    """Write the card of the camera: frames per second, exposure, and what is wrong."""
    live = bench.camera.live
    if live.error and not live.streaming:
        return _card("Camera", "no frames", "bad", "retrying every second: see the message")
    if live.settings is None:
        return _card("Camera", "…", "open", "opening")
    if bench.images.paused:
        return _card("Camera", "paused", "open", "the image is frozen; the camera keeps streaming")
    if live.overdue:
        return _card("Camera", "no frames", "bad", "the next frame is overdue")
    if live.lent and live.stale:
        return _card("Camera", "recording", "good", "frames arrive when the recording takes them")
    exposure_s = live.settings.exposure_s if live.frame is None else live.frame.exposure_s
    lines = [f"{exposure_text(exposure_s)}, gain {live.settings.gain_db:g} dB, {live.settings.pixel_format}"]
    focus = bench.images.focus
    where = f" at {focus.region}" if focus.region else ""
    lines += [f"sharpness{where} {100 * focus.now / focus.best:.0f} % of the best"] if focus.best else []
    lines += [f"incomplete frames: {live.n_incomplete}"] if live.n_incomplete else []
    rejected = "a setting was rejected: see the message" if live.error else ""
    changed = f"changed by the camera or another program: {', '.join(starmap(_change, live.changed))}"
    lines = [*(line for line in (rejected, changed if live.changed else "") if line), *lines][:3]
    rate = f"{live.rate_hz:.1f} fps" if live.rate_hz else "…"
    return _card("Camera", rate, "bad" if live.error else "good", *lines)


def _change(name: str, before: object, now: object) -> str:
    """Say how a setting has changed."""
    label, unit = _NAMES.get(name, (name.replace("_", " "), ""))
    if is_dataclass(now):
        return label
    values = f"{before}", f"{now}"
    if isinstance(before, float) and isinstance(now, float):
        # What is read back is of a register: 0.006999999999999999 is 0.007.
        digits = 6 if f"{before:.6g}" != f"{now:.6g}" else 9
        values = f"{before:.{digits}g}", f"{now:.{digits}g}"
    return f"{label} {' → '.join(values)}{unit}"


def pair_card(bench: LiveBench) -> str:
    """Write the card of the CDP of the chosen pair; blank until it is measured with the shown settings."""
    pair = bench.workspace.drawing.pair_rois
    if len(pair) < 2:
        return _card("CDP", "-", "open", "choose two regions")
    title = " / ".join(roi.name for roi in pair)
    evaluation, points, target = bench.pair, bench.points, bench.target
    if evaluation is None:
        return _card(title, "…", "open", _why(bench))
    if is_saturated(evaluation.a, evaluation.b):
        which = "both regions are" if is_saturated(evaluation.a) and is_saturated(evaluation.b) else "a region is"
        return _card(title, "saturated", "bad", f"{which}: shorten the exposure")
    if not len(evaluation.cdp):
        return _card(title, "no contrast", "bad", "both regions look the same")
    if not points:
        return _card(title, "…", "open", "measuring")
    epsilon = f"ε {100 * target.epsilon:.3g} %"
    if len(points) == 1:
        (point,) = points
        target_text = ": measured" if evaluation.targets_measured_contrast else f" {_percent(point)}"
        value, verdict, target_text = f"{point.cdp:.4f}", str(point.verdict), f"target contrast{target_text}, {epsilon}"
        words = f"95 % interval {point.low:.4f} to {point.high:.4f}"
    else:
        value, verdict = f"{sum(point.verdict == 'detected' for point in points)} of {len(points)}", "detected"
        target_text = f"target contrasts {_percent(points[0])} to {_percent(points[-1])}, {epsilon}"
        words = "CDP " + ", ".join(f"{point.cdp:.4f}" for point in points)
    if not _seen_now(bench):
        return _card(title, f"{value} <small>(stale)</small>", "open", "from the last frame", words, raw=True)
    states = {_STATES[point.verdict] for point in points}
    state = states.pop() if len(states) == 1 else "open"
    return _card(title, f"{value} <small>{verdict}</small>", state, words, target_text, raw=True)


def flicker_card(bench: LiveBench) -> str:
    """Write the card of the flicker of the chosen regions, of which that with the lowest MMP; empty if not wanted."""
    if bench.flicker is None:
        return ""
    known = {name: flicker for name, flicker in bench.flicker.items() if isfinite(flicker.mmp.value)}
    if not known:
        n_frames = bench.flicker_trace.n_frames
        return _card("Flicker", "…", "open", f"{n_frames} frames" if n_frames else "choose a region")
    name = min(known, key=lambda name: known[name].mmp.value)
    flicker = known[name]
    (low, high), (fmi_low, fmi_high) = flicker.mmp.interval, flicker.fmi.interval
    few = flicker.few_phases and flicker.wave is not None
    beat = f", beat {significant(flicker.beat_hz)} Hz" if isfinite(flicker.beat_hz) else ""
    return _card(
        f"Flicker: {name}",
        f"MMP {flicker.mmp.value:.3f} <small>{'too few phases' if few else ''}</small>",
        "open" if few else "good" if flicker.mmp.value == 1 else "bad",
        f"95 %: {low:.3f} to {high:.3f}; FMI {flicker.fmi.value:.3f} ({fmi_low:.3f} to {fmi_high:.3f})",
        f"{flicker.n_evaluated} frames, {flicker.n_phases:.0f} phases{beat}",
        raw=True,
    )


def matrix_card(bench: LiveBench) -> str:
    """Write the card of all regions against all; empty where they are few."""
    matrix = bench.matrix
    if matrix is None:
        return ""
    known = matrix.cdp[np.triu_indices(len(matrix.names), 1)]
    known = known[np.isfinite(known)]
    if not known.size:
        return _card("All regions", "saturated", "bad", "shorten the exposure")
    n_detected = int((known >= LIMIT).sum())
    text = f"have CDP ≥ {LIMIT:g}"
    if matrix.weakest is not None:
        pair, cdp = matrix.weakest
        text += f"; neighbours from {cdp:.3f}, {pair}"
    state = "good" if n_detected == known.size else "open"
    return _card("All regions", f"{n_detected} of {known.size} pairs", state, text)


def planned_table(bench: LiveBench) -> str:
    """Write the pairs of the plan at a glance; a click chooses one."""
    chosen = set(bench.workspace.drawing.pair)
    rows = [_planned_row(planned, bench.newest_evaluation(planned), chosen) for planned in bench.planned]
    if not rows:
        return ""
    heads = ("pair of the plan", "measured", "target, ε", "CDP", "")
    return f"<div class='planned'>{table(heads, rows, 'dense')}</div>"


def _planned_row(pair: PlannedPair, measured_pair: PairEvaluation | None, chosen: set[str | None]) -> str:
    message = json.dumps({"do": "pair", "first": pair.first, "second": pair.second})
    attributes = f"{' class=chosen' if {pair.first, pair.second} == chosen else ''} data-message='{text(message)}'"
    contrasts = [f"{100 * contrast:.4g}" for contrast in pair.target.contrasts or ()]
    target_text = (
        f"{' to '.join(dict.fromkeys((*contrasts[:1], *contrasts[-1:])))} %, {100 * pair.target.epsilon:.3g} %"
    )
    measured, cdp, verdict = "…", "…", ""
    if measured_pair is not None and measured_pair.result is None:
        measured, cdp = measured_pair.error, ""
    elif measured_pair is not None and measured_pair.result is not None:
        measured, points = contrast_text(measured_pair.result), pair_points(measured_pair.result, 0.0)
        verdicts = list(dict.fromkeys(point.verdict for point in points))
        saturated = is_saturated(measured_pair.result.a, measured_pair.result.b)
        cdp = "" if saturated else ", ".join(f"{point.cdp:.4f}" for point in points[:3])
        verdict = "saturated" if saturated else verdicts[0] if len(verdicts) == 1 else "differ"
    kind = {"good": "pass", "bad": "fail"}.get(_STATES.get(verdict, "open"), "")
    head = f"{text(pair.first)} / {text(pair.second)}"
    return table_row(head, (measured, target_text, (cdp, "cdp"), (verdict, kind)), attributes)


def uncalibrated_note(bench: LiveBench) -> str:
    """Say what becomes of the vignetting without a calibration; empty with one."""
    if bench.workspace.image.unit == "cd/m^2":
        return ""
    if bench.images.lens is None:
        words = "Relative luminance; contrasts of regions at different places include the lens's vignetting."
    else:
        words = "Relative luminance; the vignetting is corrected by cos⁴ for the plan's lens, and U includes the rest."
    return f"<p class='quiet'>{text(words)}</p>"


def contrast_table(bench: LiveBench) -> str:
    """Write the CDP of each target contrast, with the colour of its line; empty for one, which has a card."""
    points = bench.points
    if len(points) < 2 or points[0].verdict == "saturated":
        return ""
    rows = [
        table_row(
            f"<span class='swatch' style='background:{colour}'></span>{_percent(point)}",
            ((f"{point.cdp:.4f}", "cdp"), f"{point.low:.4f} to {point.high:.4f}", point.verdict),
        )
        for point, colour in zip(points, _colours(len(points)), strict=True)
    ]
    heads = ("target contrast", "CDP", "95 % interval", "")
    return f"<div class='contrasts'>{table(heads, rows)}</div>"


def _percent(point: PairPoint) -> str:
    return f"{100 * point.contrast:.4g} %"


def contrast_card(bench: LiveBench) -> str:
    """Write the card of the measured contrast."""
    if bench.pair is None:
        return _card("Measured contrast", "…" if len(bench.workspace.drawing.pair_rois) == 2 else "-", "open")
    pair, frame = bench.pair, "this" if _seen_now(bench) else "the last"
    if is_saturated(pair.a, pair.b):
        return _card("Measured contrast", contrast_text(pair), "bad", "a region is saturated: shorten the exposure")
    lines = [f"U (95 %) of {frame} frame"]
    if bench.workspace.image.unit != "cd/m^2":
        what = "includes the vignetting" if bench.images.lens is None else "corrected by cos⁴"
        lines.append(f"relative luminance: {what}")
    return _card("Measured contrast", contrast_text(pair), "open", *lines)


def meter_card(bench: LiveBench) -> str:
    """Write the card of the last reading."""
    if bench.desk.lost:
        return _card("Meter", "lost", "bad", "check its cable; the next reading will wait for it")
    last = bench.desk.last
    if last is None:
        none = "none: give --meter PORT, or type readings" if bench.desk.meter is None else "no reading yet"
        return _card("Meter", "-", "open", none)
    lines = [f"{last.time:%H:%M:%S}, {last.region or 'no region selected'}", *_deviation(last)]
    state = "bad" if last.disagrees else "open"
    return _card("Meter", f"{significant(last.luminance_cd_m2)} cd/m²", state, *lines)


def reading_table(bench: LiveBench) -> str:
    """Write the readings of the day, the newest first, each with a button that deletes it."""
    readings = bench.log.readings
    if not readings:
        return "<p class='quiet'>Select a region, point the meter at it, and take a reading.</p>"
    rows = []
    for number, reading in readings[:_MOST_READINGS]:
        camera = (
            ("saturated" if reading.saturated else "")
            if reading.camera_cd_m2 is None
            else significant(reading.camera_cd_m2)
        )
        deviation = "" if reading.deviation is None else f"{100 * reading.deviation:+.2f} %"
        series = (
            f" ({reading.n_readings}, ± {100 * (reading.scatter_rel or 0.0):.2g} %)" if reading.n_readings > 1 else ""
        )
        message = text(json.dumps({"do": "delete reading", "number": number}))
        words = f"delete the reading of {reading.time:%H:%M:%S}"
        head = f"<button class='delete' title='{words}' aria-label='{words}' data-message='{message}'>&times;</button>"
        cells = (
            f"{reading.time:%H:%M:%S}",
            reading.region or "-",
            f"{significant(reading.luminance_cd_m2)}{series}",
            camera,
            (deviation, "fail" if reading.disagrees else ""),
            (reading.origin, "origin"),
        )
        rows.append(table_row(head, cells))
    heads = ("", "time", "region", "meter (cd/m²)", "camera", "deviation", "origin")
    more = len(readings) - _MOST_READINGS
    rest = f"<p class='quiet'>{more} more are in {text(bench.log.path.name)}</p>" if more > 0 else ""
    return table(heads, rows, "dense readings") + rest


def settings_text(live: LiveState) -> str:
    """Write the settings in effect, as read back."""
    settings = live.settings
    if settings is None:
        return ""
    low, high = live.exposure_range_s
    rate = "" if settings.frame_rate_hz is None else f", {settings.frame_rate_hz:.4g} frames/s set"
    return (
        f"<p class='quiet'>In effect: {exposure_text(settings.exposure_s)} ({exposure_text(low)} to "
        f"{exposure_text(high)} possible), {settings.gain_db:g} dB, {text(settings.pixel_format)}, "
        f"{settings.width} x {settings.height} pixels{rate}; "
        f"{live.n_frames} frames received, {live.n_incomplete} incomplete.</p>"
    )


def _deviation(reading: MeterReading) -> list[str]:
    if reading.deviation is None:
        return ["the region is saturated in the camera"] if reading.saturated else []
    beyond = ", beyond the uncertainties" if reading.disagrees else ""
    return [f"camera {significant(reading.camera_cd_m2 or 0.0)} cd/m², {100 * reading.deviation:+.2f} %{beyond}"]


def _seen_now(bench: LiveBench) -> bool:
    live = bench.camera.live
    return live.streaming and not live.stale and not bench.images.paused


def _why(bench: LiveBench) -> str:
    pair = bench.workspace.measured.pair
    return "measuring" if pair is None or not pair.error else pair.error


def _card(title: str, value: str, state: str, *lines: str, raw: bool = False) -> str:
    body = "".join(f"<p title='{text(line)}'>{text(line)}</p>" for line in lines)
    return f"<div class='card {state}'><h3>{text(title)}</h3><b>{value if raw else text(value)}</b>{body}</div>"


_BLUE, _RED = "#0072b2", "#d55e00"
#: Bins of the histogram, and pixels of which it is made.
_N_BINS, _SAMPLE = 128, 200_000
#: Seconds between two plots, and points of the trace in one: more slow the images down.
_PLOT_S, _MOST_POINTS = 0.5, 400


def _colours(n: int) -> list[str]:
    """Return colours of lines in rising order; without the lightest, which white does not show."""
    return [_BLUE] if n == 1 else [Viridis256[round(k * 210 / (n - 1))] for k in range(n)]


class Plots:
    """The plots of one tab.

    Parameters
    ----------
    bench : LiveBench
        The bench whose values they show.
    """

    def __init__(self, bench: LiveBench) -> None:
        self._trace, self._bands = ColumnDataSource(), ColumnDataSource()
        self._plot_trace(())
        self._curve = ColumnDataSource(data={"contrast": [], "cdp": []})
        self._histogram = ColumnDataSource(data={"dn": [], "n": []})
        self._measured = Span(location=None, dimension="height", line_color=_RED, line_width=2)
        self._contrasts = Range1d(1, 10_000)
        self._dn = Range1d(0, bench.images.highest_dn)
        self._levels = tuple(Span(dimension="height", line_dash="dashed", line_color=color) for color in (_BLUE, _RED))
        self._plotted_s = 0.0
        self.figures = (self._trace_figure(), self._curve_figure(), self._histogram_figure())

    def update(self, bench: LiveBench) -> bool:
        """Refresh the plots, not more often than twice a second; returns whether it did."""
        now_s = monotonic()
        if now_s - self._plotted_s < _PLOT_S:
            return False
        self._plotted_s = now_s
        frames = bench.trace.frames
        self._plot_trace(frames[:: 1 + len(frames) // _MOST_POINTS])
        contrasts, values = bench.curve
        self._curve.data = {"contrast": 100 * contrasts, "cdp": values}
        if contrasts.size:
            self._contrasts.update(start=100 * contrasts[0], end=100 * contrasts[-1])
        known = bench.pair is not None and not is_saturated(bench.pair.a, bench.pair.b)
        measured = 100 * bench.pair.contrast.value if known and bench.pair is not None else 0.0
        self._measured.location = measured if 0 < measured < inf else None
        # The line of the saturation, which is at the end, is seen as a whole.
        self._dn.end = 1.01 * bench.images.highest_dn
        self._levels[0].location = bench.images.black_dn
        self._levels[1].location = bench.workspace.image.saturation_dn
        self._histogram.data = _histogram(bench.workspace.image.values, bench.images.highest_dn)
        return True

    def _plot_trace(self, frames: Sequence[Sequence[PairPoint]]) -> None:
        """Show a line for each target contrast, with its 95 % interval where that is known."""
        lines, now_s = list(zip(*frames, strict=True)), monotonic()
        known = [[point for point in line if isfinite(point.low)] for line in lines]
        colours = _colours(len(lines))
        self._trace.data = {
            "t": [[point.time_s - now_s for point in line] for line in lines],
            "cdp": [[point.cdp for point in line] for line in lines],
            "colour": colours,
        }
        self._bands.data = {
            "t": [[point.time_s - now_s for point in (*line, *reversed(line))] for line in known],
            "ends": [[point.low for point in line] + [point.high for point in reversed(line)] for line in known],
            "colour": colours,
        }

    def _trace_figure(self) -> Any:
        plot = small_plot(120, y_range=Range1d(-0.02, 1.02), x_range=Range1d(-TRACE_S, 0))
        plot.yaxis.axis_label, plot.xaxis.axis_label = "CDP", "time in s"
        plot.patches("t", "ends", source=self._bands, fill_alpha=0.3, fill_color="colour", line_alpha=0)
        plot.multi_line("t", "cdp", source=self._trace, line_color="colour", line_width=2)
        plot.add_layout(Span(location=LIMIT, dimension="width", line_dash="dotted"))
        return plot

    def _curve_figure(self) -> Any:
        plot = small_plot(120, y_range=Range1d(-0.02, 1.02), x_range=self._contrasts, x_axis_type="log")
        plot.yaxis.axis_label, plot.xaxis.axis_label = "CDP", "target contrast in % (line: measured)"
        plot.line("contrast", "cdp", source=self._curve, line_color=_BLUE, line_width=2)
        for mark in (self._measured, Span(location=LIMIT, dimension="width", line_dash="dotted")):
            plot.add_layout(mark)
        return plot

    def _histogram_figure(self) -> Any:
        plot = small_plot(110, x_range=self._dn, y_axis_type="log")
        plot.y_range.start = 0.5
        plot.yaxis.ticker.desired_num_ticks = 3
        plot.xaxis.axis_label, plot.yaxis.axis_label = "DN (lines: black level, saturation)", "pixels"
        for mark in self._levels:
            plot.add_layout(mark)
        plot.step("dn", "n", source=self._histogram, mode="after", line_color="#555555")
        return plot


def _histogram(values: Any, highest: float) -> dict[str, Any]:
    step = max(1, round((values.size / _SAMPLE) ** 0.5))
    counts, edges = np.histogram(values[::step, ::step], bins=_N_BINS, range=(0, highest + 1))
    # Empty bins are below the axis, which is logarithmic.
    return {"dn": edges[:-1], "n": np.maximum(counts, 0.1)}
