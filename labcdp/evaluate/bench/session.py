"""Evaluation of a bench session: patches, the CDP of its contrasts, and the luminance of the target."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...calibration import AnyCalibration, Calibration
from ...calibration.convert.conversion import require_lens
from ...calibration.fit_records import summarised
from ...calibration.in_session import in_session, other_conditions_findings
from ...calibration.verify.verify import changes_since
from ...core.errors import CalibrationError
from ...core.luminance import Invalid, LuminanceMap, MergedMap
from ...core.result import Finding, warning
from ...core.spectra import ONLY, mismatch_findings
from ...session import ContrastConfiguration, FrameRecord, MeterCertificate, Session, SessionConfiguration
from .calibrate import calibrate_session
from .corrections import calibration_corrections, calibration_for
from .kept import OBSERVATIONS, kept_session
from .observe import ObservedSession, frame_maps, observe_session
from .recorded import (
    NO_LIGHT,
    Report,
    by_exposure,
    by_patch,
    certificate_from_calibration,
    configured_lens,
    lens_findings,
    measured_in,
    require_patches,
)
from .rows import ContrastRow, PatchRow, contrast_row, patch_row

if TYPE_CHECKING:
    from ..chart.measure import MeasuredChart
    from ..colour.measure import PairColours
    from ..flicker.measure import RegionFlicker


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
    chart : MeasuredChart or None
        The target as a chart, if one was asked for.
    colours : tuple of PairColours
        Colours of the pairs, if they were asked for.
    flicker : tuple of RegionFlicker
        Flicker of the patches, if it was asked for.
    """

    observed: ObservedSession
    calibration: AnyCalibration
    patches: Sequence[PatchRow]
    contrasts: Sequence[ContrastRow]
    map: LuminanceMap
    findings: tuple[Finding, ...]
    chart: MeasuredChart | None = None
    colours: tuple[PairColours, ...] = ()
    flicker: tuple[RegionFlicker, ...] = ()

    @property
    def simulated(self) -> list[str]:
        """Simulated parts of the bench, for the user; empty on a real one."""
        camera, meter = self.calibration.state.camera, self.calibration.meter_scale.meter
        named = ((camera, f"camera {camera.model}"), (meter, f"luminance meter {meter.model}"))
        parts = [name for device, name in named if device.simulated]
        return [*parts, "target"] if parts else []


def observe_calibrated(
    session: Session,
    calibration: AnyCalibration | None = None,
    without: Sequence[str] = (),
    report: Report = lambda _done, _total: None,
    certificate: MeterCertificate | None = None,
    beside: Path | None = None,
) -> tuple[ObservedSession, AnyCalibration]:
    """Observe a session as its calibration was made; without one calibrate with the session itself.

    Parameters
    ----------
    session, without, report, certificate
        As for `observe_session`; without a certificate that of the calibration holds, if it is the same meter.
    calibration : Calibration, ColourCalibration or None
        Of the same camera.
    beside : Path or None
        File of the calibration; observations that are kept beside it are not measured again if they are of this
        session and what it was measured with is the same.

    Returns
    -------
    ObservedSession, Calibration or ColourCalibration
        The session, and the calibration for the part of the sensor that its frames show.

    Raises
    ------
    CalibrationError, SessionError, InputError
        As `observe_session` and `calibrate_session`.
    """
    if calibration is None:
        observed = observe_session(session, without, report, certificate=certificate)
        return observed, calibrate_session(observed, all_used=False)
    in_part = calibration_for(session, calibration)
    certificate, corrections = (
        certificate or certificate_from_calibration(in_part, session),
        calibration_corrections(in_part),
    )
    kept = None
    if beside is not None:
        kept = kept_session(session, corrections, beside.with_name(OBSERVATIONS), without, report, certificate)
    return kept or observe_session(session, without, report, corrections, certificate), in_part


def evaluate_session(
    observed: ObservedSession, calibration: AnyCalibration, contrasts: Sequence[ContrastConfiguration] | None = None
) -> SessionEvaluation:
    """Evaluate a session.

    Parameters
    ----------
    observed : ObservedSession
        What `observe_session` returned for it.
    calibration : Calibration or ColourCalibration
        Of the same camera and settings.
    contrasts : sequence of ContrastConfiguration or None
        Pairs and contrasts; None takes those of the session's configuration.

    Raises
    ------
    CalibrationError
        If the calibration is not for these frames.
    SessionError
        If a file is missing or altered.
    """
    configuration, session = observed.configuration, observed.session
    pairs = configuration.contrasts if contrasts is None else contrasts
    findings = mismatch(configuration, calibration)
    is_calibrated_with = calibration.provenance.comes_from(observed.input_sha256)
    if is_calibrated_with:
        calibration = calibration.at_their_temperature()
    else:
        if measured_in(session, calibration):
            findings = [warning("calibration-before-retake", str(session.path)), *findings]
        calibration, of_session = in_session(calibration, observed.by_plane, observed.darks_by_plane)
        findings += of_session
        seen_c = [o.temperature_c for group in observed.by_plane.values() for o in group]
        calibration = calibration.for_use(observed.times, seen_c)
        findings += other_conditions_findings(calibration)
    measured = [patch for patch in configuration.target.patches if patch.name in observed.names]
    patches = {patch.name: patch_row(patch, observed, calibration) for patch in measured}
    if not is_calibrated_with:
        # A bound contradicts no reading.
        seen = [row.calibrated for row in patches.values() if not row.bound]
        rest = observed.by_plane, seen, observed.readings, observed.meter_scale
        calibration, deviating, of_change = changes_since(calibration, *rest)
        findings += of_change
        patches = {name: patch_row(row.patch, observed, calibration) for name, row in patches.items()}
        patches |= {name: patches[name].doubted(deviation) for name, deviation in deviating.items()}
    names = [name for pair in pairs for name in (pair.bright, pair.dark)]
    require_patches(names, [*patches], "for the contrast (it may have been left out)")
    of_patches = [finding for row in patches.values() for finding in row.calibrated.findings]
    maps = frame_maps(observed, calibration)
    rows = [contrast_row(observed, calibration, maps, pair, patches) for pair in pairs]
    of_pairs = [finding for row in rows for finding in row.findings]
    return SessionEvaluation(
        observed,
        calibration,
        [*patches.values()],
        rows,
        target_map(observed, maps),
        summarised([*findings, *calibration.findings, *of_patches, *of_pairs]),
    )


def chosen_contrasts(
    configuration: SessionConfiguration,
    pairs: Sequence[tuple[str, str]] | None,
    contrasts: Sequence[float] | None,
    epsilon: float | None,
    cdp_limit: float | None = None,
) -> list[ContrastConfiguration]:
    """Return pairs of patches with contrasts, tolerance and limit as given, or else as configured."""
    chosen = configuration.contrasts
    if pairs is not None:
        names = [patch.name for patch in configuration.target.patches]
        require_patches([name for pair in pairs for name in pair], names, "for the contrast")
        given = [{"bright": bright, "dark": dark, "contrast": 1.0} for bright, dark in pairs]
        chosen = tuple(map(ContrastConfiguration.model_validate, given))
    if epsilon is not None:
        chosen = tuple(contrast.model_copy(update={"epsilon": float(epsilon)}) for contrast in chosen)
    if cdp_limit is not None:
        chosen = tuple(contrast.model_copy(update={"cdp_limit": cdp_limit}) for contrast in chosen)
    if contrasts is None:
        return list(chosen)
    different = dict.fromkeys(contrast.model_copy(update={"contrast": 1.0}) for contrast in chosen)
    return [contrast.model_copy(update={"contrast": value}) for contrast in different for value in contrasts]


def mismatch(configuration: SessionConfiguration, calibration: AnyCalibration) -> list[Finding]:
    """Refuse a calibration with another lens or f-number; return findings if lens or light may be another."""
    lens = configured_lens(configuration)
    require_lens(calibration.lens, lens)
    given = configuration.camera.spectral_sensitivity
    of_camera = None if given is None else given.spectra.get(ONLY)
    sensitivity = of_camera if isinstance(calibration, Calibration) else calibration.sensitivity
    of_light = mismatch_findings(calibration.light, configuration.source.light, sensitivity)
    return [*lens_findings(calibration.lens, lens), *of_light]


def target_map(observed: ObservedSession, maps: Callable[[FrameRecord], LuminanceMap]) -> LuminanceMap:
    """Merge the frames of the target, for each pixel from the longest exposure that does not saturate it.

    Where patches were shown one by one, each region shows its patch, and the rest what was around the first one;
    of regions that overlap the last one shows. The maps are from `frame_maps`.

    Raises
    ------
    CalibrationError
        If there are no light frames.
    SessionError
        If a file is missing or altered.
    """
    frames: dict[str | None, list[FrameRecord]] = {}
    for group in by_exposure(observed.session, "light").values():
        for patch, records in by_patch(group).items():
            frames.setdefault(patch, []).append(records[0])
    if not frames:
        raise CalibrationError(NO_LIGHT)
    merged = ((name, _merged(maps, records)) for name, records in frames.items())
    regions = {patch.name: patch.region() for patch in observed.configuration.target.patches}
    _, target = next(merged)
    for name, alone in merged:
        assert name is not None, "a session has patches together or one by one"
        region, mask = target.scaled(regions[name]), np.zeros(target.shape, dtype=np.bool_)
        mask[region.window(target.shape)] = region.mask(target.shape)
        target = MergedMap(mask, alone, target)
    return target


def _merged(maps: Callable[[FrameRecord], LuminanceMap], records: Sequence[FrameRecord]) -> LuminanceMap:
    """Merge frames, the shortest exposure first."""
    merged = maps(records[0])
    for record in records[1:]:
        longer = maps(record)
        merged = MergedMap(longer.invalid & Invalid.SATURATED == 0, longer, merged)
    return merged
