"""A chart as the target of a session: its patches, with the readings of the meter as their values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...core.quantity import Z_95
from ...core.result import info
from ...core.roi import Roi
from ...metrics.contrast import Epsilon
from ...regions.chart import Chart, Corners
from ..chart.measure import MeasuredChart, measure_chart
from ..verdict import CDP_LIMIT
from .session import SessionEvaluation


def session_chart(
    evaluation: SessionEvaluation,
    chart: Chart,
    corners: Corners | None = None,
    contrasts: Sequence[float] | None = None,
    epsilon: Epsilon = 0.5,
    cdp_limit: float = CDP_LIMIT,
) -> MeasuredChart:
    """Measure a chart that was the target of a session, in the luminance map of its frames.

    Parameters
    ----------
    evaluation : SessionEvaluation
        The session.
    chart : Chart
        The chart. One that states no value has the luminances that the meter read of the session's patches of the same
        names.
    corners : sequence of four (x, y), or None
        Corners of the chart in pixels; None if the session has a region for each of its patches, or it has marks.
    contrasts, epsilon, cdp_limit
        As of `measure_chart`.

    Raises
    ------
    InputError
        If the chart is not found.
    """
    luminance = evaluation.map
    with_readings, read = _with_readings(chart, evaluation)
    session_regions = {row.region.name: row.region for row in evaluation.patches}
    rois: Sequence[Roi]
    if corners is not None:
        rois = chart.regions(corners)
    elif all(name in session_regions for name in chart.names):
        rois = [session_regions[name] for name in chart.names]
    else:
        located = chart.found(luminance.luminance_cd_m2)
        scaled = [tuple((x * luminance.step, y * luminance.step) for x, y in roi.corners) for roi in located]
        rois = [replace(roi, corners=corners) for roi, corners in zip(located, scaled, strict=True)]
    measured = measure_chart(luminance, "cd/m²", with_readings, rois, contrasts, epsilon, cdp_limit)
    findings = [*measured.findings, *([info("chart-values-read", patches=read)] if read else [])]
    exposures = {record.exposure_s for record in evaluation.observed.session.frames("light")}
    if len(exposures) > 1:
        findings.append(info("chart-of-bracket", exposures=len(exposures)))
    return replace(measured, findings=tuple(findings))


def _with_readings(chart: Chart, evaluation: SessionEvaluation) -> tuple[Chart, list[str]]:
    """Return the chart with the luminances that were read of its patches without a value, and their names."""
    read = {row.patch.name: row for row in evaluation.patches}
    used = [patch.roi.name for patch in chart.patches if not patch.black]
    # Stated and read values are on scales of their own, and do not mix.
    if any(patch.value is not None for patch in chart.patches) or not all(name in read for name in used):
        return chart, []
    values = {}
    for name in used:
        reading = read[name].reading
        # As charts have it of U: that of the meter's data sheet is not normal.
        values[name] = reading.luminance_cd_m2, reading.U_rel(read[name].meter) * reading.luminance_cd_m2 / Z_95
    return replace(chart, quantity="luminance_cd_m2").with_values(values), used
