"""Evaluation of a bench session: patches, the CDP of its contrasts, and the luminance of the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...calibration import AnyCalibration, Calibration
from ...calibration.convert.conversion import require_lens
from ...core.errors import CalibrationError
from ...core.luminance import Invalid, LuminanceMap, chosen
from ...core.result import Finding, unique, warning
from ...core.roi import Roi
from ...core.spectra import ONLY, SpectralTable, mismatch_findings
from ...session import ContrastConfiguration, FrameRecord, Session, SessionConfiguration
from .observe import ObservedSession
from .recorded import by_exposure, by_patch, lens_of, measured_in, require_patches
from .rows import ContrastRow, PatchRow, contrast_row, patch_row


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


def target_map(session: Session, observed: ObservedSession, calibration: AnyCalibration) -> LuminanceMap:
    """Merge the frames of the target, for each pixel from the longest exposure that does not saturate it.

    Where patches were shown one by one, each region shows its patch, and the rest what was around the first one;
    of regions that overlap the last one shows.

    Raises
    ------
    CalibrationError
        If there are no light frames.
    SessionError
        If a file is missing or altered.
    """
    frames: dict[str | None, list[FrameRecord]] = {}
    for group in by_exposure(session, "light").values():
        for patch, records in by_patch(group).items():
            frames.setdefault(patch, []).append(records[0])
    if not frames:
        raise CalibrationError("the session has no light frames: uncover the lens and resume the acquisition")
    first, *others = frames
    target = _merged(session, calibration, frames[first])
    regions = {patch.name: patch.region() for patch in observed.configuration.target.patches}
    for name in others:
        assert name is not None, "a session has patches together or one by one"
        alone = _merged(session, calibration, frames[name])
        target = chosen(_whole_mask(target.scaled(regions[name]), target.shape), alone, target)
    return target


def _merged(session: Session, calibration: AnyCalibration, records: Sequence[FrameRecord]) -> LuminanceMap:
    """Merge frames, the shortest exposure first."""
    merged = calibration.to_luminance(session.load(records[0]))
    for record in records[1:]:
        longer = calibration.to_luminance(session.load(record))
        merged = chosen(longer.invalid & Invalid.SATURATED == 0, longer, merged)
    return merged


def _whole_mask(region: Roi, shape: tuple[int, int]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, dtype=np.bool_)
    mask[region.window(shape)] = region.mask(shape)
    return mask
