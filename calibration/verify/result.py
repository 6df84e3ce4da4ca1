"""Result of a verification: patches and dark signal measured again, and a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from math import hypot, isfinite
from typing import Literal

from ...core.errors import InputError
from ...core.quantity import Z_95
from ...core.result import Finding
from ..frames.observations import CameraState
from ..readings import MeasuredPatch
from ..sensor.dark import DarkModel
from ..setup import LensIdentity, MeterScale
from ..uncertainty import expanded_half_width

#: Bound of normal black level drift (rectangular).
DRIFT_DN = 0.5
#: Standard uncertainties beyond which a difference is reported as a change; it is no part of the decision.
CLEAR_Z = 3.0
Verdict = Literal["conform", "undecided", "not conform"]


@dataclass(frozen=True)
class VerifiedPatch(MeasuredPatch):
    """A patch measured again by the calibrated camera and the meter.

    Parameters
    ----------
    deviation_rel : float
        Relative deviation of the camera from the meter.
    standard_uncertainty_rel, expanded_rel : float
        Standard uncertainty and U (95 %) of the deviation of an unchanged camera: random parts of both, the
        calibration's fit, and the scales of the meters if the calibration's was another one or in another state.
    guard_rel : float
        U (95 %) of what is measured now, the guard band: without the errors of the calibration, which are part of the
        deviation and of the tolerance.
    independent_rel : float
        The standard uncertainty without the scales of the meters, but with what a flat field leaves; times Student's t
        over the normal quantile.
    tolerance_rel : float
        Largest deviation that conforms.
    """

    deviation_rel: float
    standard_uncertainty_rel: float
    expanded_rel: float
    guard_rel: float
    independent_rel: float
    tolerance_rel: float

    @property
    def verdict(self) -> Verdict:
        """By the decision rule."""
        return decide(self.deviation_rel, self.guard_rel, self.tolerance_rel)

    @property
    def conformance_probability(self) -> float:
        """Probability that the true deviation is within the tolerance."""
        return conformance_probability(self.deviation_rel, self.guard_rel / Z_95, self.tolerance_rel)


@dataclass(frozen=True)
class VerifiedDark:
    """The dark signal measured again at one exposure.

    Parameters
    ----------
    plane : str or None
        The colour plane; None for a monochrome sensor.
    exposure_s : float
        Exposure time.
    mean_dn, expected_dn : float
        By the new dark frames, and by the calibration.
    standard_uncertainty_dn : float
        Of the difference: both statistics, and normal black level drift (`DRIFT_DN`).
    effect_rel_per_dn : float
        Relative error of the lowest calibrated luminance by a difference of 1 DN; for a plane, in the combination.
    """

    plane: str | None
    exposure_s: float
    mean_dn: float
    expected_dn: float
    standard_uncertainty_dn: float
    effect_rel_per_dn: float

    @property
    def difference_dn(self) -> float:
        """New less expected."""
        return self.mean_dn - self.expected_dn

    @property
    def effect_rel(self) -> float:
        """Relative error by the difference at the lowest calibrated luminance."""
        return self.effect_rel_per_dn * self.difference_dn

    @property
    def moved(self) -> bool:
        """Whether the dark signal has clearly changed."""
        return abs(self.difference_dn) > CLEAR_Z * self.standard_uncertainty_dn


@dataclass(frozen=True)
class Drift:
    """Change of the responsivity of a plane.

    Parameters
    ----------
    relative, expanded_rel : float
        Change against the meter since the calibration, and the expanded uncertainty U (95 %).
    responsivity_dn_s_cd_m2 : float
        The calibration's responsivity with this change.
    responsivity_expanded_rel, responsivity_own_rel : float
        Relative expanded uncertainty U (95 %) of that with the meter's scale, and without where it is the calibration's
        meter.
    """

    relative: float
    expanded_rel: float
    responsivity_dn_s_cd_m2: float
    responsivity_expanded_rel: float
    responsivity_own_rel: float


@dataclass(frozen=True)
class VerifiedPlane:
    """A colour plane, or a monochrome sensor, measured again.

    Parameters
    ----------
    plane : str or None
        The plane; None for a monochrome sensor.
    dark : DarkModel
        Of the new dark frames.
    drift : Drift or None
        By the grey patches of the calibration; None if none was measured again.
    balance_rel, balance_expanded_rel : float or None
        Deviation of the plane from the luminance of all planes on these patches, and its U (95 %). No meter is needed
        for it. None for a monochrome sensor, or without a grey patch.
    share : float
        Of the plane in the luminance of grey light.
    """

    plane: str | None
    dark: DarkModel
    drift: Drift | None
    balance_rel: float | None = None
    balance_expanded_rel: float | None = None
    share: float = 1.0

    @property
    def balance_excess_rel(self) -> float:
        """Excess of the deviation over its U; 0 if it is within."""
        return max(abs(self.balance_rel or 0.0) - (self.balance_expanded_rel or 0.0), 0.0)


@dataclass(frozen=True)
class Verification:
    """Result of a verification of a calibration.

    Parameters
    ----------
    findings : tuple of Finding
        Findings, the verdict first.
    state : CameraState
        Camera and settings.
    lens : LensIdentity
        The calibration's.
    measured, calibration_measured : datetime
        Time of the last meter reading, of this verification and of the calibration.
    calibration_sha256 : str
        Hash of the calibration's frames and readings.
    meter, calibration_meter : MeterScale
        The meters of the verification and of the calibration, with their certificates.
    tolerance_rel : float
        Largest relative deviation that conforms.
    tolerance_stated : bool
        Whether the user stated it; else it is the U (95 %) of the calibration.
    patches : tuple of VerifiedPatch
        In the order of the observations.
    unusable : tuple of str
        Patches that could not be measured.
    darks : tuple of VerifiedDark
        By plane, then by exposure, the shortest first.
    planes : tuple of VerifiedPlane
        The four of a sensor with colour filters, or one.
    mean_rel, mean_expanded_rel : float
        Weighted mean of the deviations, and its U (95 %).
    frames_sha256 : tuple of str
        Hash of the pixels of each frame; empty in files of labcdp 0.2.0.
    calibration_number : str
        Number of the calibration's file, as its certificate has it; empty where it was in no file.
    """

    findings: tuple[Finding, ...]
    state: CameraState
    lens: LensIdentity
    measured: datetime
    calibration_measured: datetime
    calibration_sha256: str
    meter: MeterScale
    calibration_meter: MeterScale
    tolerance_rel: float
    tolerance_stated: bool
    patches: tuple[VerifiedPatch, ...]
    unusable: tuple[str, ...]
    darks: tuple[VerifiedDark, ...]
    planes: tuple[VerifiedPlane, ...]
    mean_rel: float
    mean_expanded_rel: float
    frames_sha256: tuple[str, ...] = ()
    calibration_number: str = ""

    @property
    def same_meter(self) -> bool:
        """Whether both meters are one in the same state of adjustment, so that its scale error cancels."""
        return self.meter.is_as_in(self.calibration_meter)

    @property
    def verdict(self) -> Verdict:
        """Of all patches, the dark signal and the colour balance together.

        Not conform if a patch is not, or if dark signal or colour balance alone make a luminance wrong by more than the
        tolerance; undecided if a patch is, or could not be measured; else conform.
        """
        of_patches = {row.verdict for row in self.patches}
        if "not conform" in of_patches or self.dark_not_conform or self.balance_not_conform:
            return "not conform"
        return "undecided" if self.unusable or "undecided" in of_patches else "conform"

    @property
    def dark_not_conform(self) -> bool:
        """Whether the dark signal at one exposure makes the lowest luminance wrong by more than the tolerance."""
        at = [[row for row in self.darks if row.exposure_s == t] for t in {row.exposure_s for row in self.darks}]
        return any(decide(*_effect(rows), self.tolerance_rel) == "not conform" for rows in at)

    @property
    def balance_not_conform(self) -> bool:
        """Whether a coloured patch may be wrong by more than the tolerance."""
        return sum(abs(plane.share) * plane.balance_excess_rel for plane in self.planes) > self.tolerance_rel


def _effect(rows: Sequence[VerifiedDark]) -> tuple[float, float]:
    """Effect of the dark signals of all planes at one exposure, with its U (95 %)."""
    u = hypot(*(row.effect_rel_per_dn * row.standard_uncertainty_dn for row in rows))
    return sum(row.effect_rel for row in rows), expanded_half_width(0.0, u)


def decide(deviation_rel: float, U_rel: float, tolerance_rel: float) -> Verdict:  # noqa: N803 - the symbol of the GUM
    """Decide whether a deviation conforms to a tolerance, with a guard band as wide as its U (95 %).

    Conform if the size of d plus U is at most T, not conform if that minus U exceeds T, else undecided: guarded
    acceptance and rejection of JCGM 106:2012, 8.3, with the guard band w = U of ILAC-G8:09/2019. The probability of a
    wrong decision is at most 2.5 %, whatever the true deviation.

    Parameters
    ----------
    deviation_rel, U_rel : float
        d, and its expanded uncertainty U (95 %), as fractions.
    tolerance_rel : float
        T, as a fraction.
    """
    if abs(deviation_rel) + U_rel <= tolerance_rel:
        return "conform"
    return "not conform" if abs(deviation_rel) - U_rel > tolerance_rel else "undecided"


def conformance_probability(deviation_rel: float, u_rel: float, tolerance_rel: float) -> float:
    """Probability that the true deviation is within the tolerance (JCGM 106:2012, 7.2, for a normal distribution)."""
    from scipy.special import ndtr

    if u_rel == 0:
        return float(abs(deviation_rel) <= tolerance_rel)
    return float(ndtr((tolerance_rel - deviation_rel) / u_rel) - ndtr((-tolerance_rel - deviation_rel) / u_rel))


def require_tolerance(tolerance_rel: float) -> float:
    """Refuse a tolerance that is not above 0 and up to 1."""
    if not (isfinite(tolerance_rel) and 0 < tolerance_rel <= 1):
        raise InputError(f"tolerance_rel is {tolerance_rel}: give a fraction above 0, up to 1, such as 0.03")
    return tolerance_rel
