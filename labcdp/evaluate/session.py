"""Evaluation of a bench session: patches by meter and camera, and the CDP of the configured contrasts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calibration import (
    AnyCalibration,
    Calibration,
    PatchLuminance,
    PatchObservation,
    colour_patch_luminance,
    contrast_uncertainty,
    expanded_half_width,
    patch_luminance,
)
from ..calibration.conversion import require_lens
from ..calibration.readings import combine_readings
from ..contrast import CalibratedCdp, CdpResult, ContrastDistribution, cdp_with_common_errors, contrast_distribution
from ..errors import CalibrationError, InputError
from ..luminance import LuminanceMap
from ..roi import Roi
from ..session import ContrastConfiguration, Session, SessionConfiguration
from ..spectral_mismatch import mismatch_warning
from ..spectral_table import ONLY, SpectralTable
from .guess import guessed_conversion
from .observe import ObservedSession
from .pair import paired_errors
from .recorded import by_exposure, lens_of, shows
from .target_map import target_map

#: Bars of the contrast histogram.
_N_BINS = 200


@dataclass(frozen=True)
class PatchRow:
    """A patch by the meter, by guessed parameters, and by the calibrated camera.

    Parameters
    ----------
    region : Roi
        Where it is in the image.
    measured_cd_m2, measured_random_rel, measured_half_width_95_rel : float
        Mean of the meter's readings, its standard uncertainty without the scale, and the half width of its 95 %
        interval with the scale.
    calculated_cd_m2 : float or None
        From guessed camera parameters; None without a guess.
    calibrated : PatchLuminance
        By the calibrated camera.
    """

    region: Roi
    measured_cd_m2: float
    measured_random_rel: float
    measured_half_width_95_rel: float
    calculated_cd_m2: float | None
    calibrated: PatchLuminance

    @property
    def deviation_rel(self) -> float:
        """Calibrated over measured, less one."""
        return self.calibrated.luminance_cd_m2 / self.measured_cd_m2 - 1

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        low, high = self.calibrated.interval_95_cd_m2
        return {
            "patch": self.region.name,
            "measured_cd_m2": self.measured_cd_m2,
            "measured_half_width_95_rel": self.measured_half_width_95_rel,
            "calculated_cd_m2": self.calculated_cd_m2,
            "calibrated_cd_m2": self.calibrated.luminance_cd_m2,
            "calibrated_interval_95_cd_m2": [low, high],
            "calibrated_half_width_95_rel": self.calibrated.half_width_95_rel,
            "deviation_rel": self.deviation_rel,
            "exposures_s": list(self.calibrated.exposures_s),
            "warnings": list(self.calibrated.warnings),
        }


@dataclass(frozen=True)
class ContrastRow:
    """Detection probability of the contrast between two patches, in one frame.

    Parameters
    ----------
    bright, dark : str
        The patches.
    calibrated_cdp : CalibratedCdp
        At the contrast asked for, with what pixels and calibration leave uncertain.
    distribution : ContrastDistribution
        Of all pairs of pixels, for plots.
    measured_contrast, measured_standard_uncertainty : float
        Weber contrast by the meter; its scale error cancels.
    camera_contrast, camera_standard_uncertainty : float
        Weber contrast of the calibrated patch luminances; scale and fit cancel.
    exposure_s : float
        Exposure of the frame.
    frame_number, dark_frame_number : int
        Numbers of the frames in the session with the bright and the dark patch: one frame, unless patches were
        shown one by one.
    """

    bright: str
    dark: str
    calibrated_cdp: CalibratedCdp
    distribution: ContrastDistribution
    measured_contrast: float
    measured_standard_uncertainty: float
    camera_contrast: float
    camera_standard_uncertainty: float
    exposure_s: float
    frame_number: int
    dark_frame_number: int

    @property
    def cdp(self) -> CdpResult:
        """CDP with its 95 % interval by pixels and calibration; its standard error is by the pixels alone."""
        both = self.calibrated_cdp
        return replace(both.result, confidence_interval=both.confidence_interval)

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        result = self.cdp
        other = {} if self.dark_frame_number == self.frame_number else {"dark_frame_number": self.dark_frame_number}
        return {
            "bright": self.bright,
            "dark": self.dark,
            "contrast": result.contrast,
            "epsilon": result.epsilon,
            "interval": list(result.interval),
            "cdp": result.cdp,
            "standard_error": result.standard_error,
            "calibration_standard_uncertainty": self.calibrated_cdp.calibration_standard_uncertainty,
            "confidence_interval_95": list(result.confidence_interval),
            "below": result.below,
            "above": result.above,
            "undefined": result.undefined,
            "bright_pixels": result.bright_size,
            "dark_pixels": result.dark_size,
            "measured_contrast": self.measured_contrast,
            "measured_standard_uncertainty": self.measured_standard_uncertainty,
            "camera_contrast": self.camera_contrast,
            "camera_standard_uncertainty": self.camera_standard_uncertainty,
            "exposure_s": self.exposure_s,
            "frame_number": self.frame_number,
            **other,
        }


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
    warnings : tuple of str
        What to mind: where calibration and session do not match, and the calibration's own warnings.
    """

    observed: ObservedSession
    calibration: AnyCalibration
    patches: Sequence[PatchRow]
    contrasts: Sequence[ContrastRow]
    map: LuminanceMap
    warnings: tuple[str, ...]

    @property
    def simulated(self) -> list[str]:
        """What of the bench was simulated, for a person; empty on a real one."""
        parts = []
        if self.calibration.state.camera.simulated:
            parts.append(f"camera {self.calibration.state.camera.model}")
        meter = self.calibration.meter_scale.meter
        if meter.simulated:
            parts.append(f"luminance meter {meter.model}")
        return [*parts, "target"] if parts else []

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold: the numbers, and where they come from."""
        calibration = self.calibration
        return {
            "session": self.observed.configuration.name,
            "simulated": self.simulated,
            "camera": str(calibration.state.camera),
            "meter": f"{calibration.meter_scale.meter.model} ({calibration.meter_scale.meter.serial})",
            **calibration_values(calibration),
            "range_cd_m2": list(calibration.range_cd_m2),
            "patches": [row.to_dict() for row in self.patches],
            "contrasts": [row.to_dict() for row in self.contrasts],
            "warnings": list(self.warnings),
            "configuration": self.observed.configuration.model_dump(mode="json", by_alias=True, exclude_none=True),
            "input_sha256": self.observed.input_sha256,
            "calibration_input_sha256": calibration.provenance.input_sha256,
            "versions": calibration.provenance.versions,
        }


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
    warnings = mismatch(observed.configuration, calibration)
    rows = [_patch_row(name, observed, calibration) for name in observed.names]
    luminance = {row.region.name: row for row in rows}
    for pair in pairs:
        for name in (pair.bright, pair.dark):
            if name not in luminance:
                raise InputError(
                    f"there is no patch {name!r} for the contrast: choose from {', '.join(luminance)} "
                    "(a patch may have been left out)"
                )
    return SessionEvaluation(
        observed=observed,
        calibration=calibration,
        patches=rows,
        contrasts=[
            _contrast_row(session, observed, calibration, pair, luminance[pair.bright], luminance[pair.dark])
            for pair in pairs
        ],
        map=target_map(session, observed, calibration),
        warnings=tuple(dict.fromkeys([*warnings, *calibration.warnings])),
    )


def calibration_values(calibration: AnyCalibration) -> dict[str, Any]:
    """Responsivity of a monochrome camera, or weights of the planes of another; values JSON can hold."""
    if isinstance(calibration, Calibration):
        return {
            "responsivity_dn_s_cd_m2": calibration.responsivity.responsivity_dn_s_cd_m2,
            "responsivity_common_rel": calibration.responsivity_common_rel,
        }
    return {"rate_weights_cd_m2_s_dn": calibration.rate_weights, "spectral_rel": calibration.spectral_rel}


def mismatch(configuration: SessionConfiguration, calibration: AnyCalibration) -> list[str]:
    """Refuse a calibration with another lens or f-number; return a warning if the light was another."""
    require_lens(calibration.lens, lens_of(configuration))
    sensitivity = calibration.sensitivity if not isinstance(calibration, Calibration) else _of_camera(configuration)
    warning = mismatch_warning(calibration.light, configuration.source.light, sensitivity)
    return [] if warning is None else [warning]


def _of_camera(configuration: SessionConfiguration) -> SpectralTable | None:
    """Spectral sensitivity of a monochrome camera, if it is given."""
    given = configuration.camera.spectral_sensitivity
    return None if given is None else given.spectra.get(ONLY)


def _patch_row(name: str, observed: ObservedSession, calibration: AnyCalibration) -> PatchRow:
    measured, _ = combine_readings(name, observed.readings.get(name, []))
    if measured.luminance_cd_m2 == 0:
        raise CalibrationError(
            f"patch {name!r} reads 0 cd/m^2, below the meter's range: leave it out with --without {name!r}"
        )
    scale = max(reading.scale_half_width_rel for reading in observed.readings[name])
    region = next(p.region() for p in observed.configuration.target.patches if p.name == name)
    return PatchRow(
        region=region,
        measured_cd_m2=measured.luminance_cd_m2,
        measured_random_rel=measured.random_cd_m2 / measured.luminance_cd_m2,
        measured_half_width_95_rel=expanded_half_width(scale, measured.random_cd_m2 / measured.luminance_cd_m2),
        calculated_cd_m2=_calculated_cd_m2(observed, name),
        calibrated=_calibrated(observed, name, calibration),
    )


def _calibrated(observed: ObservedSession, name: str, calibration: AnyCalibration) -> PatchLuminance:
    if isinstance(calibration, Calibration):
        return patch_luminance(calibration, observed.patches[name])
    by_plane = {plane: seen.patches[name] for plane, seen in observed.planes.items() if plane is not None}
    return colour_patch_luminance(calibration, by_plane)


def _calculated_cd_m2(observed: ObservedSession, name: str) -> float | None:
    guess = observed.configuration.guess
    # A guess is of one responsivity: for colour filters it says nothing.
    if guess is None or None not in observed.planes:
        return None
    unsaturated = [o for o in observed.patches[name] if o.saturated_share == 0]
    if not unsaturated:
        return None
    o = max(unsaturated, key=lambda o: o.exposure_s)
    conversion = guessed_conversion(
        guess, observed.configuration.source.spectrum, observed.monochrome.corrections.vignetting, o.state.gain_db
    )
    net_dn = o.signal_dn - o.mean_inverse_v * conversion.dark_dn(o.exposure_s)
    return net_dn / (conversion.responsivity_dn_s_cd_m2 * o.exposure_s)


def _contrast_row(
    session: Session,
    observed: ObservedSession,
    calibration: AnyCalibration,
    pair: ContrastConfiguration,
    bright: PatchRow,
    dark: PatchRow,
) -> ContrastRow:
    exposure_s = _longest_unsaturated(observed, pair)
    records = by_exposure(session, "light")[exposure_s]
    bright_record, dark_record = (next(r for r in records if shows(r, name)) for name in (pair.bright, pair.dark))
    seen = {
        record.number: calibration.to_luminance(session.load(record))
        for record in {r.number: r for r in (bright_record, dark_record)}.values()
    }
    bright_map, dark_map = seen[bright_record.number], seen[dark_record.number]
    a, b = bright_map.select(bright.region), dark_map.select(dark.region)
    result = cdp_with_common_errors(
        a,
        b,
        pair.contrast,
        pair.epsilon,
        paired_errors(bright_map, bright.region, dark_map, dark.region),
    )
    if result.result.bright == "b":
        raise InputError(f"patch {pair.bright!r} is darker than {pair.dark!r}: give the brighter one as bright")
    measured, camera = (
        _ratio_less_one(bright.measured_cd_m2, dark.measured_cd_m2),
        _ratio_less_one(bright.calibrated.luminance_cd_m2, dark.calibrated.luminance_cd_m2),
    )
    measured_rel = [row.measured_random_rel for row in (bright, dark)]
    return ContrastRow(
        bright=pair.bright,
        dark=pair.dark,
        calibrated_cdp=result,
        distribution=contrast_distribution(a, b, _edges(result.result, camera, a, b)),
        measured_contrast=measured,
        measured_standard_uncertainty=(1 + measured) * hypot(*measured_rel),
        camera_contrast=camera,
        camera_standard_uncertainty=contrast_uncertainty(bright.calibrated, dark.calibrated),
        exposure_s=exposure_s,
        frame_number=bright_record.number,
        dark_frame_number=dark_record.number,
    )


def _ratio_less_one(bright: float, dark: float) -> float:
    return bright / dark - 1


def _edges(result: CdpResult, contrast: float, a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.float64]:
    """Edges of the histogram: the interval and four standard deviations of the contrast around its middle."""
    spread = 4 * (1 + contrast) * sqrt(np.var(a) / np.mean(a) ** 2 + np.var(b) / np.mean(b) ** 2)
    low, high = result.interval
    start = max(-1.0, min(low - 0.1 * (high - low), contrast - spread))
    stop = max(high + 0.1 * (high - low), min(contrast + spread, contrast + 2 * (high - low)))
    return np.linspace(start, stop, _N_BINS + 1)


def _longest_unsaturated(observed: ObservedSession, pair: ContrastConfiguration) -> float:
    at: dict[float, list[PatchObservation]] = {}
    for name in (pair.bright, pair.dark):
        for o in observed.of_patch(name):
            at.setdefault(o.exposure_s, []).append(o)
    fitting = [t for t, group in at.items() if all(o.saturated_share == 0 for o in group)]
    if not fitting:
        raise CalibrationError(
            f"patch {pair.bright!r} or {pair.dark!r} has saturated pixels at every exposure: acquire a shorter one"
        )
    return max(fitting)
