"""The figures of an evaluation, with what stands below them and what a screen reader says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..calibration import Calibration
from .digits import cdp_decimals, exposure, fixed, percent, printable, share_percent, significant
from .drawing import reduction
from .pictures import luminance_figure, target_figure
from .plots import contrast_figure, fit_figure
from .tables import pair_name

if TYPE_CHECKING:
    from ..evaluate import ContrastRow, SessionEvaluation


@dataclass(frozen=True)
class ReportFigure:
    """A figure as it is written.

    Parameters
    ----------
    file_name : str
        Its name in the folder of the figures.
    png : bytes
        The picture.
    caption : str
        What stands below it.
    alternative : str
        What it shows, for those who cannot see it.
    """

    file_name: str
    png: bytes
    caption: str
    alternative: str


@dataclass(frozen=True)
class ReportFigures:
    """All figures of a report.

    Parameters
    ----------
    target, luminance, fit : ReportFigure
        Of the evaluation.
    contrasts : tuple of ReportFigure
        One for each contrast.
    """

    target: ReportFigure
    luminance: ReportFigure
    fit: ReportFigure
    contrasts: tuple[ReportFigure, ...]

    def __iter__(self) -> Iterator[ReportFigure]:
        """Go through all figures."""
        yield from (self.target, self.luminance, self.fit, *self.contrasts)


def draw_figures(evaluation: SessionEvaluation) -> ReportFigures:
    """Draw all figures of an evaluation, one after the other."""
    return ReportFigures(
        target=_target(evaluation),
        luminance=_luminance(evaluation),
        fit=_fit(evaluation),
        contrasts=tuple(
            _contrast(row, number, bool(evaluation.simulated)) for number, row in enumerate(evaluation.contrasts, 1)
        ),
    )


def _target(evaluation: SessionEvaluation) -> ReportFigure:
    names = ", ".join(printable(row.region.name) for row in evaluation.patches)
    return ReportFigure(
        "target.png",
        target_figure(evaluation),
        "The target as the camera saw it, brightness on a logarithmic scale, with the regions that were evaluated."
        + _scale(evaluation),
        f"Grey picture of the target with the outlines and names of its {len(evaluation.patches)} patches: {names}.",
    )


def _luminance(evaluation: SessionEvaluation) -> ReportFigure:
    low, high = evaluation.calibration.range_cd_m2
    valid = share_percent(float(evaluation.map.valid.mean()))
    limits = f"{significant(low, 3)} to {significant(high, 3)} cd/m²"
    return ReportFigure(
        "luminance.png",
        luminance_figure(evaluation),
        f"Luminance of each pixel, from the longest exposure that does not saturate it. {valid} of the pixels "
        f"are valid; the others are drawn in the colours of the legend. Calibrated range: {limits}."
        + _scale(evaluation),
        f"Luminance map in false colours on a logarithmic scale over {limits}; {valid} of the pixels are valid.",
    )


def _scale(evaluation: SessionEvaluation) -> str:
    """Tell how many pixels a drawn one stands for."""
    side = evaluation.map.step * reduction(evaluation.map.shape)
    return f" Each drawn pixel is the mean of {side} x {side} of the camera's." if side > 1 else ""


def _fit(evaluation: SessionEvaluation) -> ReportFigure:
    rows = evaluation.calibration.residuals
    worst = max(rows, key=lambda row: abs(row.residual_rel))
    largest = f"{fixed(100 * worst.residual_rel, 2, sign=True)} % at patch {printable(worst.patch)}"
    linear = (
        "Left: signal above dark of the calibration's patches over their luminance by the meter, with the fitted line. "
        "Right: what the line leaves over."
        if isinstance(evaluation.calibration, Calibration)
        else "What the combination of colour planes leaves over, of each patch by a fit without it."
    )
    return ReportFigure(
        "fit.png",
        fit_figure(evaluation),
        f"{linear} The bars hold 95 % by all stated errors that differ between patches; the "
        "meter's scale error is common to all patches and not in them.",
        f"Fit of the responsivity over {len(rows)} patches, and their residuals; the largest is {largest}.",
    )


def _frames(row: ContrastRow) -> str:
    if row.dark_frame_number == row.frame_number:
        return f"frame {row.frame_number}"
    return f"frames {row.frame_number} and {row.dark_frame_number}"


def _contrast(row: ContrastRow, number: int, simulated: bool) -> ReportFigure:
    beyond = 1 - float(row.distribution.cumulative[-1])
    low, high = row.cdp.interval
    return ReportFigure(
        f"contrast-{number}.png",
        contrast_figure(row, simulated),
        f"{pair_name(row)}: contrasts of all pairs of a bright and a dark pixel, at an exposure of "
        f"{exposure(row.exposure_s)} ({_frames(row)}). Blue: share of the pairs with at most this contrast; "
        "grey: density, scaled to a largest bar of 1; shaded: what counts as detected."
        + (f" {share_percent(beyond)} of the pairs lie to the right of the plot." if beyond > 1e-9 else ""),
        f"Distribution of the contrasts between {pair_name(row)}. Of all pairs of pixels, a share of "
        f"{fixed(row.cdp.cdp, cdp_decimals(row.cdp))} lies between {percent(low)} and {percent(high)}.",
    )
