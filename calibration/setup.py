"""Meter, lens, light and provenance of a calibration."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date, datetime, timedelta
from math import hypot, inf, isfinite, sqrt
from statistics import fmean
from typing import TypeAlias

from ..core.errors import CalibrationError, InputError, require_not_negative
from ..core.photometry import THESIS_SPECTRUM
from ..core.reading import MeterIdentity, Reading
from ..core.result import Finding, FindingValue, info, warning
from ..core.spectra import SpectralTable, chromaticity
from ..session import MeterCertificate
from ..session.tables import EXPOSURE_JITTER_S, STABILITY_REL
from .meter_lag import lag_findings

#: Sources of common errors that belong to the meter and cancel in contrasts.
METER_SOURCES = ("meter scale", "meter f1'", "meter drift")


#: Difference of x or y that no error of a chroma meter explains: their data sheets state 0.004 in illuminant A, and
#: they err by some more in the light of LEDs. D65 and D50 differ by 0.03.
_CHROMATICITY_TOLERANCE = 0.02
#: Time between a calibration and what is of its day: less than to the evening, more than to the next morning.
_WITHIN_A_DAY = timedelta(hours=12)
#: Readings of the meter by patch.
Readings: TypeAlias = Mapping[str, Sequence[Reading]]


@dataclass(frozen=True)
class MeterScale:
    """The meter, and the error that all its readings have in common.

    Parameters
    ----------
    meter : MeterIdentity
        Which meter.
    limits_rel : float
        Limits of the relative scale error by the data sheet (rectangular); a certificate takes their place.
    certificate : MeterCertificate or None
        Calibration certificate.
    f1_prime : float or None
        f1' of the meter, as a fraction; None if not stated.
    light : str
        Light of the patches. In another light than that of the meter's calibration, f1' limits the mismatch error.
    step_rel : float
        Relative change of the readings at once that may have been one of the scale; 0 for none.
    drift_rel : float
        Limits of the relative change of the scale since the certificate (rectangular); 0 if none is stated.
    chromaticity : (float, float) or None
        x and y of the brightest patch as a chroma meter saw them; None of a luminance meter.

    Examples
    --------
    >>> from labcdp.calibration import MeterScale
    >>> from labcdp.core.reading import MeterIdentity
    >>> MeterScale(MeterIdentity("LS-110", "73323007"), limits_rel=0.02).common_rel
    0.011547005383792516
    """

    meter: MeterIdentity
    limits_rel: float
    certificate: MeterCertificate | None = None
    f1_prime: float | None = None
    light: str = ""
    step_rel: float = 0.0
    drift_rel: float = 0.0
    chromaticity: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        stated = {"limits_rel": self.limits_rel, "step_rel": self.step_rel, "drift_rel": self.drift_rel}
        require_not_negative(**stated, f1_prime=self.f1_prime or 0.0)

    def __str__(self) -> str:
        return f"{self.meter.model} {self.meter.serial}, {self.state}"

    @property
    def half_width_rel(self) -> float:
        """Limits of the rectangular scale error; 0 with a certificate, whose error is normal."""
        return self.limits_rel if self.certificate is None else 0.0

    @property
    def normal_rel(self) -> float:
        """Relative standard uncertainty of the normal scale error; 0 without a certificate."""
        return 0.0 if self.certificate is None else self.certificate.standard_uncertainty_rel

    @property
    def u_rel(self) -> float:
        """Relative standard uncertainty of the scale, without mismatch."""
        return hypot(self.half_width_rel / sqrt(3), self.normal_rel)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the scale's uncertainty; infinite by a data sheet."""
        return inf if self.certificate is None else self.certificate.degrees_of_freedom or inf

    @property
    def illuminant(self) -> str:
        """Light the meter was calibrated in; meters are adjusted in illuminant A (CIE 244)."""
        return "A" if self.certificate is None else self.certificate.illuminant

    @property
    def in_own_light(self) -> bool:
        """Whether the patches are lit as the meter was at its calibration, and its chromaticity does not deny it."""
        return self.light.casefold() == self.illuminant.casefold() and self.contradicted_light is None

    @property
    def contradicted_light(self) -> tuple[float, float] | None:
        """X and y of the stated light if the chroma meter saw another one; None if not, or if nothing says so."""
        if self.chromaticity is None or self.light in ("", THESIS_SPECTRUM):
            return None
        try:
            stated = chromaticity(self.light)
        except InputError:
            return None  # a measured spectrum is not known by its name
        apart = max(abs(seen - expected) for seen, expected in zip(self.chromaticity, stated, strict=True))
        return stated if apart > _CHROMATICITY_TOLERANCE else None

    @property
    def mismatch_rel(self) -> float:
        """Relative standard uncertainty by the meter's spectral mismatch: limits of f1', 0 in the light of its own."""
        return 0.0 if self.f1_prime is None or self.in_own_light else self.f1_prime / sqrt(3)

    @property
    def rectangular_rel(self) -> tuple[float, float, float]:
        """Relative standard uncertainties of the scale's rectangular errors: data sheet, mismatch and drift."""
        return self.half_width_rel / sqrt(3), self.mismatch_rel, self.drift_rel / sqrt(3)

    @property
    def common_rel(self) -> float:
        """Relative standard uncertainty of all that the readings have in common."""
        return hypot(self.normal_rel, *self.rectangular_rel)

    def is_as_in(self, other: MeterScale) -> bool:
        """Whether it is the same meter in the same state of adjustment, so that its scale error is the same."""
        mine, theirs = self.certificate, other.certificate
        return self.meter == other.meter and (mine and mine.identity) == (theirs and theirs.identity)

    @property
    def state(self) -> str:
        """Date of calibration and certificate, in words."""
        if self.certificate is not None:
            return f"certificate {self.certificate.number} of {self.certificate.date}"
        return f"calibrated {self.meter.calibration_date}" if self.meter.calibration_date else "date not known"

    def findings(self, readings: Readings) -> list[Finding]:
        """Return what a user should know about the traceability of these readings, by patch."""
        name, certificate = f"{self.meter.model} {self.meter.serial}", self.certificate
        findings = lag_findings(name, readings)
        if self.chromaticity is not None and (expected := self.contradicted_light) is not None:
            both = zip(("x", "y", "light_x", "light_y"), (*self.chromaticity, *expected), strict=True)
            findings.append(warning("chromaticity-differs", name, light=self.light, **dict(both)))
        if self.f1_prime is None and self.light and not self.in_own_light:
            # A certificate's U does not hold in other light; the accuracy of a data sheet is no claim of traceability.
            severe = info if certificate is None else warning
            lights = {"light": self.light, "illuminant": self.illuminant}
            findings.append(severe("meter-mismatch-not-stated", name, **lights))
        if certificate is None:
            return [info("meter-without-certificate", name, limits_rel=self.limits_rel), *findings]
        number, times = certificate.number, _times(readings)
        if certificate.due_date is not None and times[-1].date() > certificate.due_date:
            due, at = f"{certificate.due_date}", f"{times[-1]:%Y-%m-%d}"
            findings.append(warning("certificate-overdue", name, number=number, due=due, measured=at))
        calibrated = (
            date.fromisoformat(self.meter.calibration_date) if self.meter.calibration_date else certificate.date
        )
        if certificate.date < calibrated <= times[-1].date():
            # A plan refuses such a certificate; the date of one given later may be that of its issue.
            since = {"date": f"{certificate.date}", "calibrated": f"{calibrated}"}
            findings.append(warning("certificate-of-earlier-calibration", name, number=number, **since))
        findings += _outside_certificate(name, certificate, readings)
        stated = {
            "serial": certificate.serial,
            "range_cd_m2": certificate.range_cd_m2,
            "due_date or drift_rel_per_year": certificate.due_date or certificate.drift_rel_per_year,
        }
        if missing := [key for key, value in stated.items() if value is None]:
            findings.append(info("certificate-not-checked", name, number=number, missing=missing))
        return findings


def _times(readings: Readings) -> list[datetime]:
    """Return the times of all readings, the first one first."""
    return sorted(reading.timestamp for group in readings.values() for reading in group)


def _outside_certificate(name: str, certificate: MeterCertificate, readings: Readings) -> Iterator[Finding]:
    """Warn of patches beyond the luminances of a certificate; a reading of 0 is not used."""
    if certificate.range_cd_m2 is None:
        return
    low, high = certificate.range_cd_m2
    values = {patch: [r.luminance_cd_m2 for r in group if r.luminance_cd_m2 > 0] for patch, group in readings.items()}
    outside = {patch: group for patch, group in values.items() if group and not low <= fmean(group) <= high}
    if outside:
        read_cd_m2 = [f(fmean(group) for group in outside.values()) for f in (min, max)]
        limits: dict[str, FindingValue] = {"patches": [*outside], "read_cd_m2": read_cd_m2, "range_cd_m2": [low, high]}
        yield warning("certificate-range-exceeded", name, number=certificate.number, **limits)


def meter_scale(
    readings: Readings, certificate: MeterCertificate | None = None, f1_prime: float | None = None, light: str = ""
) -> MeterScale:
    """Return the one meter of all readings, with its certificate or else the largest scale error stated with them.

    Raises
    ------
    CalibrationError
        If there is no reading, readings come from several meters or have different corrections, or the certificate is
        of another meter or later than a reading.
    """
    every = [
        (f"reading {number} of patch {patch!r}", reading)
        for patch, group in readings.items()
        for number, reading in enumerate(group, start=1)
    ]
    if not every:
        raise CalibrationError("there are no meter readings: measure every patch with the luminance meter")
    first = every[0][1].meter
    for _, reading in every:
        if reading.meter != first and (reading.meter.model, reading.meter.serial) == (first.model, first.serial):
            dates = "; ".join(meter.calibration_date or "date not known" for meter in (first, reading.meter))
            raise CalibrationError(
                f"the meter {first.model} {first.serial} was calibrated or adjusted between the readings ({dates}): "
                "calibrate with readings of one state, its scale error is common to all patches"
            )
        if reading.meter != first:
            raise CalibrationError(
                f"readings come from meters {first.model} {first.serial} and {reading.meter.model} "
                f"{reading.meter.serial}: calibrate with one meter, its scale error is common to all patches"
            )
    require_one_correction(every)
    drift_rel = 0.0
    if certificate is not None:
        _require_certificate_for(certificate, first, _times(readings)[0])
        drift_rel = max(certificate.drift_rel(reading.timestamp) for _, reading in every)
    limits_rel = max(r.scale_half_width_rel for _, r in every)
    coloured = [reading for _, reading in every if reading.chromaticity is not None]
    colour = max(coloured, key=lambda reading: reading.luminance_cd_m2).chromaticity if coloured else None
    return MeterScale(first, limits_rel, certificate, f1_prime, light, drift_rel=drift_rel, chromaticity=colour)


def _require_certificate_for(certificate: MeterCertificate, meter: MeterIdentity, first: datetime) -> None:
    """Refuse a certificate whose correction says nothing about readings of a meter, the first one at a time."""
    if other := certificate.mismatched_meter(meter):
        raise CalibrationError(f"{other}, which took the readings: give the certificate of that meter")
    if not certificate.holds_at(first):
        raise CalibrationError(
            f"the certificate {certificate.number} of {certificate.date} is later than the readings of the meter, the "
            f"first of {first:%Y-%m-%d}: give the certificate that was valid then, or state as_found = true in it if "
            "its values are those before any adjustment"
        )


def require_one_correction(readings: Iterable[tuple[str, Reading]]) -> None:
    """Refuse readings, with their names, that the meter took with different user corrections."""
    known = [(name, reading) for name, reading in readings if reading.correction is not None]
    for name, reading in known[1:]:
        if reading.correction != known[0][1].correction:
            raise CalibrationError(
                f"{known[0][0]} was taken with the correction {known[0][1].correction!r}, {name} with "
                f"{reading.correction!r}: do not change the meter's correction, and repeat one of them"
            )


def corrected(reading: Reading, certificate: MeterCertificate | None) -> Reading:
    """Apply the correction of a certificate to a reading; `raw` stays as it was."""
    if certificate is None or certificate.correction == 1:
        return reading
    factor = certificate.correction
    scaled = {name: getattr(reading, name) * factor for name in ("value", "resolution", "digits_half_width")}
    return replace(reading, **scaled)


@dataclass(frozen=True)
class LensIdentity:
    """The lens on the camera.

    Parameters
    ----------
    model, serial : str
        As engraved; the serial number may be empty.
    focal_length_m : float
        Focal length.
    f_number : float
        The f-number; the responsivity is proportional to its inverse square.
    focus_distance_m : float or None
        Distance of focus, which changes the responsivity too; None if not known.
    refocus_rel : float
        Relative standard uncertainty of the responsivity after focus and aperture are set anew; 0 if locked.
    stability_rel : float
        The same of camera and lens on another day.

    Raises
    ------
    InputError
        If a number is not positive.

    Examples
    --------
    >>> from labcdp.calibration import LensIdentity
    >>> LensIdentity("Kowa LM16", "0001", focal_length_m=0.016, f_number=2.8).stability_rel
    0.003
    """

    model: str
    serial: str
    focal_length_m: float
    f_number: float
    focus_distance_m: float | None = None
    refocus_rel: float = field(default=0.0, compare=False)
    stability_rel: float = field(default=STABILITY_REL, compare=False)

    def __post_init__(self) -> None:
        for name in ("focal_length_m", "f_number", "focus_distance_m"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise InputError(f"{name} of the lens is {value}: give a positive number")

    def __str__(self) -> str:
        focus = "" if self.focus_distance_m is None else f"focused at {self.focus_distance_m:g} m"
        known = (self.serial, f"{1e3 * self.focal_length_m:g} mm", f"f/{self.f_number:g}", focus)
        return f"{self.model} ({', '.join(one for one in known if one)})"

    def is_as_in(self, other: LensIdentity) -> bool:
        """Whether the lens and its settings are the same; an unknown serial number or distance of focus is any."""
        known = self
        if None in (self.focus_distance_m, other.focus_distance_m):
            known = replace(known, focus_distance_m=other.focus_distance_m)
        if self.serial_is_open(other):
            known = replace(known, serial=other.serial)
        return known == other

    def serial_is_open(self, other: LensIdentity) -> bool:
        """Whether one of two states a serial number and the other one does not."""
        return bool(self.serial) != bool(other.serial)


@dataclass(frozen=True)
class Setup:
    """Metadata of a calibration that is not in frames or readings.

    Parameters
    ----------
    lens : LensIdentity
        The lens.
    source_spectrum : str
        Light of the patches, for example ``LED-B4``. A camera without a V(lambda) filter is calibrated for this
        spectrum only.
    input_sha256 : str
        Hash of the frames and readings, as the caller keeps them.
    sessions_sha256 : tuple of str
        That of each session, if frames and readings are of several.
    frames_sha256 : tuple of str
        Hash of the pixels of each frame, by which frames are known again in other files.
    measured_spectrum : SpectralTable or None
        Spectral power of that light, if measured.
    certificate : MeterCertificate or None
        Of the meter, its correction applied to the readings; None for the accuracy of the data sheet.
    meter_f1_prime : float or None
        f1' of the meter, if stated.
    exposure_jitter_s : float
        Standard uncertainty of one exposure time relative to the others.
    black_level_drift_dn : float or None
        Standard deviation of the black level from frame to frame; None for what the dark frames show.

    Examples
    --------
    >>> from labcdp.calibration import LensIdentity, Setup
    >>> Setup(LensIdentity("Kowa LM16", "0001", focal_length_m=0.016, f_number=2.8), "LED-B4", "4f2a").source_spectrum
    'LED-B4'
    """

    lens: LensIdentity
    source_spectrum: str
    input_sha256: str
    measured_spectrum: SpectralTable | None = None
    sessions_sha256: tuple[str, ...] = ()
    frames_sha256: tuple[str, ...] = ()
    certificate: MeterCertificate | None = None
    meter_f1_prime: float | None = None
    exposure_jitter_s: float = EXPOSURE_JITTER_S
    black_level_drift_dn: float | None = None


@dataclass(frozen=True)
class Provenance:
    """Provenance of a calibration.

    Parameters
    ----------
    measured : datetime
        Time of the last meter reading, with time zone; the age of the calibration counts from here.
    input_sha256 : str
        Hash of frames and readings given by the caller.
    versions : dict of str to str
        Versions of the programs that computed it.
    sessions_sha256 : tuple of str
        Hash of the frames and readings of each session, if they are of several.
    frames_sha256 : tuple of str
        Hash of the pixels of each frame; empty in files of labcdp 0.2.0.

    Examples
    --------
    >>> from datetime import UTC, datetime, timedelta
    >>> from labcdp.calibration import Provenance
    >>> made = Provenance(datetime(2026, 3, 1, tzinfo=UTC), input_sha256="4f2a", versions={"labcdp": "0.3.0"})
    >>> made.comes_from("4f2a"), made.is_of_another_day(made.measured + timedelta(days=3))
    (True, True)
    """

    measured: datetime
    input_sha256: str
    versions: dict[str, str]
    sessions_sha256: tuple[str, ...] = ()
    frames_sha256: tuple[str, ...] = ()

    def is_of_another_day(self, recorded: datetime) -> bool:
        """Whether a night is between it and what was recorded at a time."""
        return abs(recorded - self.measured) > _WITHIN_A_DAY

    def comes_from(self, sha256: str) -> bool:
        """Whether frames and readings with this hash are among the inputs."""
        return sha256 in (self.input_sha256, *self.sessions_sha256)
