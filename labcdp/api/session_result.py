"""Results of a recorded session, as a dictionary or a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.result import InputFile, html_table, number
from ..evaluate.bench.session import SessionEvaluation
from ..evaluate.bench.session_result import session_result
from ..report.files import envelope
from ..report.text import warning_texts
from .variables import OF_CDP, cdp_values, columns, described

if TYPE_CHECKING:
    from xarray import Dataset

_OF_PATCH = ("meter_luminance", "meter_U", "camera_luminance", "camera_low", "camera_high", "deviation")
_OF_PAIR = ("measured_contrast", "u_measured_contrast", "meter_contrast", "u_meter_contrast", "exposure_s")


@dataclass(frozen=True, eq=False, repr=False)
class SessionResult:
    """Luminance and CDP of a session's patches; made by `Session.evaluate`.

    Parameters
    ----------
    evaluation : SessionEvaluation
        All results; its `map` is the target in cd/m^2.
    inputs : tuple of InputFile
        What it was made from.
    """

    evaluation: SessionEvaluation
    inputs: tuple[InputFile, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the results."""
        return warning_texts(self.evaluation.findings)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of results.json."""
        return envelope(session_result(self.evaluation, self.inputs))

    def to_dataset(self) -> Dataset:
        """Return a dataset: luminances over patch; CDP over pair and contrast, nan where not requested."""
        import xarray as xr

        found = self.evaluation
        pairs = list(dict.fromkeys((row.bright, row.dark) for row in found.contrasts))
        contrasts = sorted({row.cdp.contrast for row in found.contrasts})
        table: list[list[dict[str, Any]]] = [[{} for _ in contrasts] for _ in pairs]
        of_pairs: list[dict[str, float]] = [{} for _ in pairs]
        for row in found.contrasts:
            at = pairs.index((row.bright, row.dark))
            of_pairs[at] = _of_pair(row)
            values = cdp_values(row.cdp, row.calibrated_cdp.standard_uncertainty, row.cdp.confidence_interval)
            table[at][contrasts.index(row.cdp.contrast)] = {**values, "epsilon": row.cdp.epsilon}
        data = {
            **columns(("patch",), [_of_patch(row) for row in found.patches], _OF_PATCH),
            **columns(("pair", "contrast"), table, (*OF_CDP, "epsilon")),
            **columns(("pair",), of_pairs, _OF_PAIR),
        }
        coordinates = {
            "patch": [row.region.name for row in found.patches],
            "pair": [f"{bright} / {dark}" for bright, dark in pairs],
            "contrast": np.array(contrasts, dtype=float),
            "side": ["bright", "dark"],
            "region": (("pair", "side"), np.array(pairs, dtype=object).reshape(-1, 2)),
        }
        return described(xr.Dataset(data, coordinates, self._attributes()))

    def _attributes(self) -> dict[str, Any]:
        found = self.evaluation
        return {
            "title": "luminance and contrast detection probability of a session",
            "session": found.observed.configuration.name,
            "camera": str(found.calibration.state.camera),
            "unit": "cd/m^2",
            "simulated": ", ".join(found.simulated),
            "input_sha256": found.observed.input_sha256,
            "warnings": "\n".join(self.warnings),
            "labcdp_version": version("labcdp"),
        }

    def __repr__(self) -> str:
        found = self.evaluation
        name = found.observed.configuration.name
        return f"<labcdp.SessionResult {name}: patches: {len(found.patches)}, contrasts: {len(found.contrasts)}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        rows = []
        for row in self.evaluation.contrasts:
            low, high = row.cdp.confidence_interval
            values = (row.cdp.contrast, row.camera_contrast, row.cdp.cdp, low, high)
            rows.append((f"{row.bright} / {row.dark}", *(number(value) for value in values)))
        return html_table(("pair", "contrast", "measured", "CDP", "95 % from", "to"), rows, repr(self)[1:-1])


def _of_patch(row: Any) -> dict[str, float]:
    measured, calibrated = row.measured_cd_m2, row.calibrated
    of_camera = (calibrated.luminance_cd_m2, *calibrated.interval_95_cd_m2, row.deviation_rel)
    return dict(zip(_OF_PATCH, (measured, row.measured_half_width_95_rel * measured, *of_camera), strict=True))


def _of_pair(row: Any) -> dict[str, float]:
    of_camera = (row.camera_contrast, row.camera_standard_uncertainty)
    of_meter = (row.measured_contrast, row.measured_standard_uncertainty)
    return dict(zip(_OF_PAIR, (*of_camera, *of_meter, row.exposure_s), strict=True))
