"""Evaluation of a bench session: patches by meter and camera, and the CDP of the configured contrasts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...calibration import AnyCalibration, Calibration
from ...calibration.convert.conversion import require_lens
from ...core.finding import Finding, unique, warning
from ...core.luminance import LuminanceMap
from ...core.spectral.mismatch import mismatch_findings
from ...core.spectral.table import ONLY, SpectralTable
from ...session import ContrastConfiguration, Session, SessionConfiguration
from .contrast import ContrastRow, contrast_row
from .observe import ObservedSession
from .patch import PatchRow, patch_row
from .recorded import lens_of, measured_in, require_patches
from .target_map import target_map


@dataclass(frozen=True, eq=False)
class SessionEvaluation:
    """All that a session says with a calibration.

    Parameters
    ----------
    observed : ObservedSession
        Observations, readings and configuration.
    calibration : Calibration or ColourCalibration
        What converted DN to cd/m^2.
    patches : list of PatchRow
        In the target's order.
    contrasts : list of ContrastRow
        In the configuration's order.
    map : LuminanceMap
        The target; for each pixel from the longest exposure that does not saturate it.
    findings : tuple of Finding
        What the user should know of calibration, patches and light.
    """

    observed: ObservedSession
    calibration: AnyCalibration
    patches: Sequence[PatchRow]
    contrasts: Sequence[ContrastRow]
    map: LuminanceMap
    findings: tuple[Finding, ...]

    @property
    def simulated(self) -> list[str]:
        """What of the bench was simulated, for the user; empty on a real one."""
        parts = []
        if self.calibration.state.camera.simulated:
            parts.append(f"camera {self.calibration.state.camera.model}")
        meter = self.calibration.meter_scale.meter
        if meter.simulated:
            parts.append(f"luminance meter {meter.model}")
        return [*parts, "target"] if parts else []


def evaluate_session(
    session: Session,
    observed: ObservedSession,
    calibration: AnyCalibration,
    contrasts: Sequence[ContrastConfiguration] | None = None,
) -> SessionEvaluation:
    """Evaluate a session.

    Parameters
    ----------
    session : Session
        To read frames from.
    observed : ObservedSession
        What `observe_session` returned for it.
    calibration : Calibration or ColourCalibration
        Of the same camera and settings.
    contrasts : sequence of ContrastConfiguration or None
        Pairs and contrasts; None takes those of the session's configuration.

    Raises
    ------
    CalibrationError
        If the calibration is not for these frames, or a patch is saturated or black at every exposure.
    SessionError
        If a file is missing or altered.
    """
    pairs = observed.configuration.contrasts if contrasts is None else contrasts
    findings = mismatch(observed.configuration, calibration)
    if measured_in(session, calibration) and not calibration.provenance.comes_from(observed.input_sha256):
        findings = [warning("calibration-before-retake", str(session.path)), *findings]
    rows = [patch_row(name, observed, calibration) for name in observed.names]
    luminance = {row.region.name: row for row in rows}
    require_patches(
        [name for pair in pairs for name in (pair.bright, pair.dark)],
        [*luminance],
        "for the contrast (it may have been left out)",
    )
    return SessionEvaluation(
        observed=observed,
        calibration=calibration,
        patches=rows,
        contrasts=[
            contrast_row(session, observed, calibration, pair, luminance[pair.bright], luminance[pair.dark])
            for pair in pairs
        ],
        map=target_map(session, observed, calibration),
        findings=unique([*findings, *calibration.findings, *(one for row in rows for one in row.calibrated.findings)]),
    )


def mismatch(configuration: SessionConfiguration, calibration: AnyCalibration) -> list[Finding]:
    """Refuse a calibration with another lens or f-number; return a finding if the light was another."""
    require_lens(calibration.lens, lens_of(configuration))
    sensitivity = calibration.sensitivity if not isinstance(calibration, Calibration) else _of_camera(configuration)
    return mismatch_findings(calibration.light, configuration.source.light, sensitivity)


def _of_camera(configuration: SessionConfiguration) -> SpectralTable | None:
    """Spectral sensitivity of a monochrome camera, if it is given."""
    given = configuration.camera.spectral_sensitivity
    return None if given is None else given.spectra.get(ONLY)
