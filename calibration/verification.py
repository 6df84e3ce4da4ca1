"""What a verification found: patches and darkness measured again, and a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from ..errors import InputError
from ..reading import MeterIdentity
from .dark import DarkModel
from .observations import CameraState
from .setup import LensIdentity
from .uncertainty import expanded_half_width

#: z of one comparison that is worth a warning, and that is no chance; more for several comparisons (`z_limits`).
WARN_Z, FAIL_Z = 2.0, 3.0
#: The black level of a sound camera wanders by up to this much, evenly distributed.
WANDER_DN = 0.5

Verdict = Literal["valid", "doubtful", "not valid"]


@dataclass(frozen=True)
class VerifiedPatch:
    """A patch by the calibrated camera and by the meter, both anew.

    Parameters
    ----------
    patch : str
        Name of the patch.
    reading_cd_m2, reading_random_cd_m2 : float
        By the meter: mean of the readings, and its standard uncertainty without the scale.
    n_readings : int
        How many readings.
    luminance_cd_m2 : float
        By the calibrated camera.
    difference_rel : float
        Camera over meter, less one.
    standard_uncertainty_rel : float
        Of the difference, combined: random parts of both, the calibration's fit, and for another meter than that of
        the calibration both meters' scales.
    with_new_dark_rel : float or None
        The difference with the darkness of the new dark frames in place of the calibration's; None if the patch is
        then no brighter than the dark.
    exposures_s : tuple of float
        Exposures that were used.
    """

    patch: str
    reading_cd_m2: float
    reading_random_cd_m2: float
    n_readings: int
    luminance_cd_m2: float
    difference_rel: float
    standard_uncertainty_rel: float
    with_new_dark_rel: float | None
    exposures_s: tuple[float, ...]

    @property
    def z(self) -> float:
        """Difference over its combined standard uncertainty."""
        return self.difference_rel / self.standard_uncertainty_rel

    @property
    def half_width_95_rel(self) -> float:
        """Half width of the 95 % interval of the difference."""
        return expanded_half_width(0.0, self.standard_uncertainty_rel)


@dataclass(frozen=True)
class VerifiedDark:
    """The darkness at one exposure, anew.

    Parameters
    ----------
    plane : str or None
        The colour plane; None for a monochrome sensor.
    exposure_s : float
        Exposure time.
    mean_dn, expected_dn : float
        By the new dark frames, and by the calibration.
    standard_uncertainty_dn : float
        Of the difference: both statistics, and the wander of a sound camera's black level (`WANDER_DN`).
    effect_rel : float
        Relative error that the difference makes at the lowest calibrated luminance; of a plane, in the combination.
    """

    plane: str | None
    exposure_s: float
    mean_dn: float
    expected_dn: float
    standard_uncertainty_dn: float
    effect_rel: float

    @property
    def difference_dn(self) -> float:
        """New less expected."""
        return self.mean_dn - self.expected_dn

    @property
    def z(self) -> float:
        """Difference over its standard uncertainty."""
        return self.difference_dn / self.standard_uncertainty_dn


@dataclass(frozen=True)
class Drift:
    """How the responsivity of a plane has changed.

    Parameters
    ----------
    relative, half_width_95_rel : float
        Change since the calibration, and the half width of its 95 % interval.
    responsivity_dn_s_cd_m2 : float
        The calibration's responsivity with this change.
    responsivity_half_width_95_rel : float
        Relative half width of its 95 % interval, the meter's scale included.
    """

    relative: float
    half_width_95_rel: float
    responsivity_dn_s_cd_m2: float
    responsivity_half_width_95_rel: float


@dataclass(frozen=True)
class VerifiedPlane:
    """A colour plane anew, or all of a monochrome sensor.

    Parameters
    ----------
    plane : str or None
        The plane; None for a monochrome sensor.
    dark : DarkModel
        Of the new dark frames.
    drift : Drift or None
        By the grey patches of the calibration; None if there is none among those that were measured again.
    """

    plane: str | None
    dark: DarkModel
    drift: Drift | None


@dataclass(frozen=True)
class ColourBalance:
    """Whether the colours have changed alike.

    Parameters
    ----------
    odd : {'red', 'green', 'blue'}
        The colour that deviates most from the others.
    against : str
        The others that it is compared with.
    change_rel, half_width_95_rel : float
        Change of its responsivity against theirs since the calibration, and the half width of its 95 % interval.
    chance : float
        Probability that colours differ at least so much if nothing has changed: chi^2 with two degrees of freedom.
    effect_rel : float
        Sum of what the planes' deviations from each other make of the luminance, without their signs.
    """

    odd: Literal["red", "green", "blue"]
    against: str
    change_rel: float
    half_width_95_rel: float
    chance: float
    effect_rel: float


@dataclass(frozen=True)
class Verification:
    """Whether a calibration still holds.

    Parameters
    ----------
    verdict : {'valid', 'doubtful', 'not valid'}
        All together.
    findings : tuple of str
        What was found, in plain words, the verdict first.
    state : CameraState
        Camera and settings.
    lens : LensIdentity
        The calibration's.
    measured, calibration_measured : datetime
        Time of the last meter reading, of this verification and of the calibration.
    calibration_sha256 : str
        Hash of the calibration's frames and readings.
    meter : MeterIdentity
        The meter of the verification.
    same_meter : bool
        Whether it is the calibration's, in the same state of adjustment, so that its scale error cancels.
    patches : tuple of VerifiedPatch
        In the order of the observations.
    darks : tuple of VerifiedDark
        By plane, then by exposure, the shortest first.
    planes : tuple of VerifiedPlane
        The four of a sensor with colour filters, or one.
    balance : ColourBalance or None
        Of a sensor with colour filters; None for a monochrome one, or if no grey patch of the calibration is among
        those that were measured again.
    chi_squared : float
        Of the differences, what they share respected; the degrees of freedom are the number of patches.
    chance : float
        Probability of a chi^2 at least this large if nothing has changed.
    drift_rel, drift_half_width_95_rel : float
        Change of the luminance of one light since the calibration: weighted mean of the differences, and its 95 %
        interval.
    """

    verdict: Verdict
    findings: tuple[str, ...]
    state: CameraState
    lens: LensIdentity
    measured: datetime
    calibration_measured: datetime
    calibration_sha256: str
    meter: MeterIdentity
    same_meter: bool
    patches: tuple[VerifiedPatch, ...]
    darks: tuple[VerifiedDark, ...]
    planes: tuple[VerifiedPlane, ...]
    balance: ColourBalance | None
    chi_squared: float
    chance: float
    drift_rel: float
    drift_half_width_95_rel: float


def z_limits(n: int) -> tuple[float, float]:
    """Limits of |z| for a warning and for a failure among `n` comparisons (C. E. Bonferroni, 1936).

    The probability that any of n sound comparisons passes them is at most that of a single one to pass `WARN_Z` and
    `FAIL_Z`.

    Raises
    ------
    InputError
        If there is no comparison.
    """
    from scipy.special import ndtr, ndtri

    if n < 1:
        raise InputError(f"n is {n}: give at least 1 comparison")
    warn, fail = (float(-ndtri(ndtr(-z) / n)) for z in (WARN_Z, FAIL_Z))
    return warn, fail


def chance_limits() -> tuple[float, float]:
    """Probability of a chi^2 below which there is a warning, and a failure: those of `WARN_Z` and `FAIL_Z`."""
    from scipy.special import ndtr

    return 2 * float(ndtr(-WARN_Z)), 2 * float(ndtr(-FAIL_Z))
