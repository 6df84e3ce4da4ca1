"""Settings of the evaluation of a chart in a video."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.errors import InputError
from ...core.result import InputFile
from ...regions.chart import Chart
from ..video.settings import VideoSettings


@dataclass(frozen=True)
class ChartVideoSettings(VideoSettings):
    """Settings of the evaluation of a chart in a video; tracking, light and frames are those of `VideoSettings`.

    Parameters
    ----------
    chart : Chart
        The chart. Its patches are `rois` in the first frame, in its order; without them its marks are sought there.
    inputs : tuple of InputFile
        Records of its files.

    Raises
    ------
    InputError
        If there is no chart, the regions are not those of its patches, or a value is out of range.

    Examples
    --------
    >>> from labcdp import Roi
    >>> from labcdp.evaluate.chart_video.settings import ChartVideoSettings
    >>> from labcdp.regions.chart import Chart, ChartPatch
    >>> steps = [ChartPatch(Roi.rectangle(str(n), 10 * n, 0, 10, 10), 0.3 * n) for n in range(3)]
    >>> chart = Chart("steps", 30, 10, tuple(steps), "density")
    >>> corners = [(20, 20), (80, 20), (80, 40), (20, 40)]
    >>> settings = ChartVideoSettings(rois=chart.regions(corners), method="fixed", chart=chart)
    >>> settings.methods
    ('fixed', 'fixed', 'fixed')
    """

    chart: Chart | None = None
    inputs: tuple[InputFile, ...] = ()

    def _check_number(self) -> None:
        if self.chart is None:
            raise InputError("no chart is given: give one, or regions for the CDP of a pair")
        names = [roi.name for roi in self.rois]
        if names and names != self.chart.names:
            raise InputError("the regions are not the patches of the chart: give one for each, in their order")

    @property
    def patches(self) -> Chart:
        """The chart."""
        assert self.chart is not None
        return self.chart
