"""Results of a recorded session, as a dictionary or a dataset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
from xarray import Dataset

from ..core.result import InputFile, html_table, number
from ..core.table import Column, variables_of
from ..evaluate.bench.session import SessionEvaluation
from ..evaluate.bench.session_result import CONTRASTS, LUMINANCES, session_result
from ..report.files import envelope
from ..report.text import warning_texts
from .arguments import Contrasts, PathArgument, Tolerance, as_contrasts, as_number, as_path
from .variables import cdp_variables, described, noted

if TYPE_CHECKING:
    from ..evaluate.chart.measure import MeasuredChart
    from ..regions.chart import Corners

#: Columns of the tables by their names.
_COLUMNS = {column.name: column for column in (*LUMINANCES, *CONTRASTS)}


def _variable(name: str, column: str, label: str = "") -> Column:
    """Return a column of the tables renamed and labelled for a dataset, where no table says what it belongs to."""
    template = _COLUMNS[column]
    return replace(template, name=name, label=label or template.label, value=template.value or template.name)


_INTERVAL = "interval_95_cd_m2"
#: Of a patch, and of a contrast of two patches.
_OF_PATCH = (
    _variable("meter_luminance", "measured_cd_m2", "luminance by meter"),
    _variable("meter_U", "expanded_measured_cd_m2", "U (95 %) of luminance by meter"),
    _variable("camera_luminance", "calibrated_cd_m2", "luminance by camera"),
    Column("camera_low", "luminance by camera, low", "cd/m²", "Lower end of its 95 % interval.",
           value=f"{_INTERVAL}.0"),
    Column("camera_high", "luminance by camera, high", "cd/m²", "Upper end of its 95 % interval.",
           value=f"{_INTERVAL}.1"),
    _variable("deviation", "deviation_rel", "deviation from meter"),
)  # fmt: skip
_OF_PAIR = (
    _variable("measured_contrast", "camera_contrast"),
    _variable("u_measured_contrast", "u_camera_contrast"),
    _variable("meter_contrast", "measured_contrast"),
    _variable("u_meter_contrast", "u_measured_contrast"),
    _variable("exposure_s", "exposure_s"),
)


@dataclass(frozen=True, eq=False, repr=False)
class SessionResult:
    """Luminance and CDP of a session's patches; made by `Session.evaluate`.

    Parameters
    ----------
    evaluation : SessionEvaluation
        All results; its `map` is the target in cd/m^2.
    inputs : tuple of InputFile
        Inputs it was made from.
    """

    evaluation: SessionEvaluation
    inputs: tuple[InputFile, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the results."""
        return warning_texts(self.evaluation.findings)

    def chart(
        self,
        chart: PathArgument,
        contrasts: Contrasts | None = None,
        epsilon: Tolerance = 0.5,
        *,
        corners: Corners | None = None,
    ) -> MeasuredChart:
        """Measure a chart that was the target: all patches against all, and the dynamic range of the camera.

        Parameters
        ----------
        chart : path
            Chart file. One that states no value has the luminances that the meter read of the session's patches of the
            same names.
        contrasts : float, str, array_like of them, or None
            Contrasts to be detected; None for those of the chart's values.
        epsilon : float or DetectionInterval
            Their relative tolerance.
        corners : sequence of four (x, y), or None
            Corners of the chart in pixels: upper left, upper right, lower right, lower left; None if the session has a
            region for each of its patches, or it has marks.

        Raises
        ------
        InputError
            If the chart cannot be read, or is not found.
        """
        from ..evaluate.bench.chart import session_chart
        from ..evaluate.chart.chart_file import load_chart

        request = as_contrasts(contrasts, epsilon)
        loaded, _ = load_chart(as_path(chart, "the chart"))
        return session_chart(self.evaluation, loaded, corners, request.values, request.epsilon)

    def colour_separation(self, epsilon: float | str | None = None) -> Dataset:
        """Tell how well the colours of the patches of each pair can be told apart, behind a colour filter.

        Parameters
        ----------
        epsilon : float, str or None
            Relative tolerance of the difference of chromaticity; None for that of each pair's contrast.

        Returns
        -------
        xarray.Dataset
            Over pair, as of ``image.regions(...).colour_separation()``.

        Raises
        ------
        InputError
            If the camera has no colour filter, or the patches of a pair were shown one by one.
        """
        from ..evaluate.bench.colours import session_colours
        from ..evaluate.colour.measure import colour_dataset

        pairs = session_colours(self.evaluation, None if epsilon is None else as_number(epsilon, "epsilon"))
        return described(colour_dataset(pairs, {"title": "colour separation of a session"}))

    def flicker(self, *, threshold: float = 0.1, tolerance: float = 0.1, frequency_hz: float | None = None) -> Dataset:
        """Measure how the light of the patches flickers from frame to frame, at each exposure time by itself.

        Parameters
        ----------
        threshold, tolerance, frequency_hz
            As for `labcdp.flicker`.

        Returns
        -------
        xarray.Dataset
            ``fmi`` and ``mmp`` over patch and exposure, each with ``u_...``, ``..._low`` and ``..._high`` (95 %), the
            phases and the beat, as of ``video.flicker(...)``; nan where a patch is saturated or black in all frames.

        Raises
        ------
        InputError
            If an argument cannot be used, or no patch has light in any frame.
        SessionError
            If a file is missing or altered.
        """
        from ..evaluate.bench.flicker import session_flicker
        from ..evaluate.flicker.measure import flicker_findings
        from ..evaluate.flicker.tables import index_columns

        measured = session_flicker(self.evaluation, threshold=threshold, tolerance=tolerance, frequency_hz=frequency_hz)
        patches = [row.patch.name for row in self.evaluation.patches]
        exposures_s = sorted({item.exposure_s for item in measured})
        by_place = {(item.region, item.exposure_s): item for item in measured}
        items = [[by_place.get((patch, exposure_s)) for exposure_s in exposures_s] for patch in patches]
        variables = variables_of(index_columns("cd/m²"), ("patch", "exposure_s"), items)
        coordinates = {"patch": patches, "exposure_s": ("exposure_s", exposures_s, {"units": "s"})}
        attributes = self._attributes() | noted(flicker_findings(measured)) | {"title": "flicker of a session"}
        return described(Dataset(variables, coordinates, attributes))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of results.json."""
        return envelope(replace(session_result(self.evaluation), inputs=self.inputs))

    def to_dataset(self) -> Dataset:
        """Return a dataset: luminances over patch; CDP over pair and contrast, nan where not requested."""
        evaluation = self.evaluation
        pairs = list(dict.fromkeys((row.target.bright, row.target.dark) for row in evaluation.contrasts))
        contrasts = sorted({row.cdp.contrast for row in evaluation.contrasts})
        table: list[list[Any]] = [[None for _ in contrasts] for _ in pairs]
        for row in evaluation.contrasts:
            table[pairs.index((row.target.bright, row.target.dark))][contrasts.index(row.cdp.contrast)] = row
        data = {
            **variables_of(_OF_PATCH, ("patch",), evaluation.patches),
            **cdp_variables(("pair", "contrast"), [[row and row.cdp for row in rows] for rows in table]),
            **variables_of([_variable("epsilon", "epsilon")], ("pair", "contrast"), table),
            **variables_of(_OF_PAIR, ("pair",), [[row for row in rows if row][-1] for rows in table]),
        }
        coordinates = {
            "patch": [row.patch.name for row in evaluation.patches],
            "pair": [f"{bright} / {dark}" for bright, dark in pairs],
            "contrast": np.array(contrasts, dtype=float),
            "side": ["bright", "dark"],
            "region": (("pair", "side"), np.array(pairs, dtype=object).reshape(-1, 2)),
        }
        return described(Dataset(data, coordinates, self._attributes()))

    def _attributes(self) -> dict[str, Any]:
        evaluation = self.evaluation
        return {
            "title": "luminance and contrast detection probability of a session",
            "session": evaluation.observed.configuration.name,
            "camera": str(evaluation.calibration.state.camera),
            "unit": "cd/m^2",
            "simulated": ", ".join(evaluation.simulated),
            "input_sha256": evaluation.observed.input_sha256,
            "warnings": "\n".join(self.warnings),
            "labcdp_version": version("labcdp"),
        }

    def __repr__(self) -> str:
        evaluation = self.evaluation
        name = evaluation.observed.configuration.name
        return (
            f"<labcdp.SessionResult {name}: patches: {len(evaluation.patches)}, contrasts: {len(evaluation.contrasts)}>"
        )

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        rows = []
        for row in self.evaluation.contrasts:
            low, high = row.cdp.interval
            values = (row.cdp.contrast, row.camera_contrast, row.cdp.cdp, low, high)
            rows.append((row.name, *(number(value) for value in values)))
        return html_table(("pair", "contrast", "measured", "CDP", "95 % from", "to"), rows, repr(self)[1:-1])
