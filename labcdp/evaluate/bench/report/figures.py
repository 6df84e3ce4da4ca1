"""The figures of a session, with captions and text alternatives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ....metrics import ContrastDistribution
from ....report.digits import exposure, printable, share_percent, shortened
from ....report.figure import ReportFigure
from ....report.figures.drawing import reduction
from ....report.figures.maps import luminance_picture, regions_picture
from ....report.figures.plots import ContrastPanel, contrast_figures
from ..calibration.figures import calibration_figures
from ..calibration.quantities import range_text
from ..contrast import ContrastRow
from ..session import SessionEvaluation
from .result import pair_name


@dataclass(frozen=True)
class ReportFigures:
    """All figures of a report.

    Parameters
    ----------
    target, luminance : ReportFigure
        Of the evaluation.
    contrasts : tuple of ReportFigure
        Of the contrasts, six to a figure.
    calibration : tuple of ReportFigure
        Of the calibration.
    """

    target: ReportFigure
    luminance: ReportFigure
    contrasts: tuple[ReportFigure, ...]
    calibration: tuple[ReportFigure, ...]

    def __iter__(self) -> Iterator[ReportFigure]:
        """Iterate over all figures."""
        yield from (self.target, self.luminance, *self.contrasts, *self.calibration)


def draw_figures(evaluation: SessionEvaluation) -> ReportFigures:
    """Draw all figures of an evaluation, one after the other."""
    panels = [_panel(row, row.distribution) for row in evaluation.contrasts if row.distribution is not None]
    return ReportFigures(
        target=_target(evaluation),
        luminance=_luminance(evaluation),
        contrasts=tuple(contrast_figures(panels, "bench" if evaluation.simulated else "")),
        calibration=tuple(calibration_figures(evaluation.calibration, "calibration-")),
    )


def _target(evaluation: SessionEvaluation) -> ReportFigure:
    regions = [row.region for row in evaluation.patches]
    names = ", ".join(printable(region.name) for region in regions)
    title = f"Target: {shortened(evaluation.observed.configuration.target.name, 60)}"
    return ReportFigure(
        "target.png",
        regions_picture(evaluation.map, regions, title, bool(evaluation.simulated)),
        f"The target as the camera sees it, in logarithmic grey levels, with the patches.{_scale(evaluation)}",
        f"Grey picture of the target with the outlines and names of its {len(regions)} patches: {names}.",
    )


def _luminance(evaluation: SessionEvaluation) -> ReportFigure:
    limits, title = range_text(evaluation.calibration), "Luminance by the calibrated camera"
    valid = share_percent(float(evaluation.map.valid.mean()))
    simulated = bool(evaluation.simulated)
    return ReportFigure(
        "luminance.png",
        luminance_picture(evaluation.map, title, simulated, evaluation.calibration.range_cd_m2),
        f"Luminance of each pixel, from the longest exposure that does not saturate it. {valid} of the pixels "
        f"are valid; the others have the colours of the legend. Calibrated range: {limits}.{_scale(evaluation)}",
        f"Luminance map in false colours on a logarithmic scale over {limits}; {valid} of the pixels are valid.",
    )


def _scale(evaluation: SessionEvaluation) -> str:
    """Say how many pixels a drawn one stands for."""
    side = evaluation.map.step * reduction(evaluation.map.shape)
    return f" Each drawn pixel is the mean of {side} x {side} of the camera's." if side > 1 else ""


def _panel(row: ContrastRow, distribution: ContrastDistribution) -> ContrastPanel:
    numbers = dict.fromkeys((row.frame_number, row.dark_frame_number))
    frames = f"{'frames' if len(numbers) > 1 else 'frame'} {' and '.join(map(str, numbers))}"
    title = f"{shortened(pair_name(row), 60)}, {exposure(row.exposure_s)}, {frames}"
    return ContrastPanel(title, distribution, row.cdp, row.measured_contrast)
