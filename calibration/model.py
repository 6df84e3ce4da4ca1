"""Calibration: a calibrated camera and its evidence."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from math import hypot, inf
from statistics import fmean
from typing import Any, Self, TypeAlias

from ..core.errors import InputError
from ..core.frame import Frame
from ..core.luminance import WHOLE, LuminanceMap, Window
from ..core.result import Finding, html_table, number
from ..core.spectra import Source, SpectralTable
from .camera import CalibratedCamera
from .convert.conversion import to_luminance
from .convert.patch import PatchLuminance
from .fit_records import FitTest, LeftOut, ModelStep
from .frames.observations import CameraState
from .readings import MeasuredPatch, PatchReading
from .setup import MeterScale, Provenance
from .uncertainty import variance_from_one_estimate

#: What a camera sees of a patch: its luminance, by some exposures.
Seen: TypeAlias = tuple[float, tuple[float, ...]]


@dataclass(frozen=True)
class PatchResidual(MeasuredPatch):
    """One row of the table of a calibration's patches.

    Its luminance is that by the finished calibration, as of `patch_luminance`; the residuals are statistics of the fit.

    Parameters
    ----------
    residual_rel : float
        Relative deviation of the fit from the meter; of a held-out patch, that of the camera.
    standardised_residual : float
        Residual over its standard deviation by the stated errors.
    centre_px : (float, float)
        Middle (x, y) of the patch's region in the image.
    leave_one_out_rel : float or None
        Camera over meter, minus 1, by a fit without this patch; for a held-out patch the same as `residual_rel`; None
        if the other patches do not suffice for a fit.
    u_rel, U_rel, dof : float or None
        Relative standard uncertainty of the luminance by the camera, its U (95 %), and effective degrees of freedom.
        None in files of labcdp 0.2.0, whose luminance is that of the fit; infinite degrees of freedom are None, too.

    Examples
    --------
    >>> from labcdp import Session
    >>> from labcdp.session import example_session
    >>> calibration = Session.open(example_session()).calibrate().calibration
    >>> max(abs(patch.deviation_rel) for patch in calibration.residuals) < 0.05
    True
    """

    residual_rel: float
    standardised_residual: float
    centre_px: tuple[float, float]
    leave_one_out_rel: float | None
    u_rel: float | None = None
    U_rel: float | None = None
    dof: float | None = None

    @property
    def deviation_rel(self) -> float:
        """Relative deviation of the camera from the meter."""
        return self.luminance_cd_m2 / self.reading_cd_m2 - 1

    @property
    def k(self) -> float | None:
        """Coverage factor, U over u."""
        return self.U_rel / self.u_rel if self.U_rel is not None and self.u_rel else None

    @property
    def stated_rel(self) -> float:
        """Standard deviation of the residual by the stated errors; 0 for a residual of 0, which does not show it."""
        return abs(self.residual_rel / self.standardised_residual) if self.standardised_residual else 0.0

    @classmethod
    def compared(
        cls, reading: PatchReading, seen: Seen, stated_rel: float, centre_px: tuple[float, float], without: float | None
    ) -> PatchResidual:
        """Row of a reading and of what the camera saw; `stated_rel` is over the reading, `without` by other patches."""
        deviation = seen[0] / reading.luminance_cd_m2 - 1
        return cls.of(reading, *seen, deviation, deviation / stated_rel, centre_px, without)

    def measured(self, seen: PatchLuminance, reading: PatchReading, meter: MeterScale) -> PatchResidual:
        """Return it with the luminance by the finished calibration, and with U of camera and meter."""
        return replace(
            self,
            reading_cd_m2=reading.luminance_cd_m2,
            reading_random_cd_m2=reading.random_cd_m2,
            reading_U_rel=reading.U_rel(meter),
            luminance_cd_m2=seen.luminance_cd_m2,
            exposures_s=seen.exposures_s,
            u_rel=seen.u_rel,
            U_rel=seen.U_rel,
            dof=None if seen.dof == inf else seen.dof,
        )


def luminance_range(rows: Sequence[PatchResidual], misread: Collection[str] = ()) -> tuple[float, float]:
    """Lowest and highest luminance of patches, by meter or camera; of misread patches by the camera only."""
    luminances = [row.luminance_cd_m2 for row in rows]
    luminances += [row.reading_cd_m2 for row in rows if row.patch not in misread]
    return min(luminances), max(luminances)


@dataclass(frozen=True, kw_only=True)
class Calibration(CalibratedCamera):
    """A calibrated camera and its evidence.

    Parameters
    ----------
    source_spectrum : str
        Light it is valid for.
    residuals : tuple of PatchResidual
        One row for each patch of the fit.
    held_out : tuple of PatchResidual
        Held-out patches.
    left_out : tuple of LeftOut
        Data not used by the fit, with reasons.
    ladder : tuple of ModelStep
        Candidate models.
    tests : tuple of FitTest
        Checks of the model's assumptions.
    findings : tuple of Finding
        Findings for the user.
    provenance : Provenance
        Provenance.
    measured_spectrum : SpectralTable or None
        Spectral power of that light, if measured.

    Raises
    ------
    InputError
        As `CalibratedCamera`, and if there is no residual.

    Examples
    --------
    >>> from labcdp import Session
    >>> from labcdp.session import example_session
    >>> calibration = Session.open(example_session()).calibrate().calibration
    >>> len(calibration.residuals), calibration.state.gain_db
    (16, 0.0)
    """

    source_spectrum: str
    residuals: tuple[PatchResidual, ...]
    held_out: tuple[PatchResidual, ...]
    left_out: tuple[LeftOut, ...]
    ladder: tuple[ModelStep, ...]
    tests: tuple[FitTest, ...]
    findings: tuple[Finding, ...]
    provenance: Provenance
    measured_spectrum: SpectralTable | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.residuals:
            raise InputError("a calibration has at least one row in residuals")

    def __repr__(self) -> str:
        return f"<Calibration of {self.state.camera}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return calibration_table(self)

    @property
    def planes(self) -> tuple[Calibration, ...]:
        """Itself, as the one plane of a monochrome sensor."""
        return (self,)

    @property
    def fit_part(self) -> tuple[float, float]:
        """Relative variance of a luminance by fit and scatter of the patches, and its degrees of freedom."""
        fit = self.responsivity
        random2 = max(fit.random_rel**2 - self.exposure_times.either_rel**2, 0.0)
        parts = (random2, fit.dof or inf), (fit.scatter_rel**2, fit.scatter_dof or inf)
        return variance_from_one_estimate(parts)

    @property
    def weights(self) -> tuple[float, ...]:
        """Weight of that plane in the luminance."""
        return (1.0,)

    @property
    def light(self) -> Source:
        """The spectrum it is valid for as measured, else its name."""
        return self.source_spectrum if self.measured_spectrum is None else self.measured_spectrum

    def for_use(self, recorded: Iterable[datetime | None], temperatures_c: Iterable[float | None] = ()) -> Self:
        """Return it for what was recorded at these times and temperatures of the camera, None for unknown ones."""
        apart = any(self.provenance.is_of_another_day(time) for time in recorded if time is not None)
        known_c, own_c = [c for c in temperatures_c if c is not None], self.light_temperature_c
        warmer_k = fmean(known_c) - own_c if known_c and own_c is not None else self.warmer_k
        if (apart or self.of_another_day, warmer_k) == (self.of_another_day, self.warmer_k):
            return self
        return replace(self, of_another_day=apart or self.of_another_day, warmer_k=warmer_k)

    def changed_by(self, relative: float) -> Self:
        """Return it with a responsivity that has changed by about as much since."""
        stability_rel = hypot(self.lens.stability_rel if self.of_another_day else 0.0, relative)
        return replace(self, lens=replace(self.lens, stability_rel=stability_rel), of_another_day=True)

    def to_luminance(self, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
        """Convert a frame, or a window of it, to luminance; see `labcdp.calibration.convert.conversion`."""
        return to_luminance(self.for_use([frame.timestamp], [frame.temperature_c]), frame, window)

    def _cropped(self, corner: tuple[int, int], part: CameraState) -> Self:
        return replace(
            super()._cropped(corner, part),
            residuals=tuple(_moved(row, corner) for row in self.residuals),
            held_out=tuple(_moved(row, corner) for row in self.held_out),
        )


def calibration_table(calibration: Any) -> str:
    """Return what a calibration is of, and its range, as an HTML table for notebooks."""
    low, high = (number(end) for end in calibration.range_cd_m2)
    lens, measured = calibration.lens, calibration.provenance.measured
    rows = [
        ("lens", f"{lens.model} at f/{lens.f_number:g}"),
        ("calibrated range", f"{low} to {high} cd/m²"),
        ("measured", f"{measured:%Y-%m-%d %H:%M}"),
    ]
    return html_table(("calibration of", str(calibration.state.camera)), rows)


def _moved(row: PatchResidual, corner: tuple[int, int]) -> PatchResidual:
    return replace(row, centre_px=(row.centre_px[0] - corner[0], row.centre_px[1] - corner[1]))
