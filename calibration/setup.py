"""Lens, light and provenance of a calibration."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime
from math import isfinite

from ..core.errors import InputError
from ..core.spectra import Source, SpectralTable
from ..session import MeterCertificate


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

    Raises
    ------
    InputError
        If a number is not positive.
    """

    model: str
    serial: str
    focal_length_m: float
    f_number: float
    focus_distance_m: float | None = None
    refocus_rel: float = field(default=0.0, compare=False)

    def __post_init__(self) -> None:
        for name in ("focal_length_m", "f_number", "focus_distance_m"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise InputError(f"{name} of the lens is {value}: give a positive number")

    def __str__(self) -> str:
        focus = "" if self.focus_distance_m is None else f", focused at {self.focus_distance_m:g} m"
        return f"{self.model} ({self.serial}, {1e3 * self.focal_length_m:g} mm, f/{self.f_number:g}{focus})"

    def is_as_in(self, other: LensIdentity) -> bool:
        """Whether the lens and its settings are the same; an unknown distance of focus is any."""
        if None in (self.focus_distance_m, other.focus_distance_m):
            return replace(self, focus_distance_m=None) == replace(other, focus_distance_m=None)
        return self == other


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
    measured_spectrum : SpectralTable or None
        Spectral power of that light, if measured.
    certificate : MeterCertificate or None
        Of the meter, its correction applied to the readings; None for the accuracy of the data sheet.
    meter_f1_prime : float or None
        f1' of the meter, if stated.
    """

    lens: LensIdentity
    source_spectrum: str
    input_sha256: str
    measured_spectrum: SpectralTable | None = None
    sessions_sha256: tuple[str, ...] = ()
    certificate: MeterCertificate | None = None
    meter_f1_prime: float | None = None

    @property
    def light(self) -> Source:
        """The spectrum as measured, else its name."""
        return self.source_spectrum if self.measured_spectrum is None else self.measured_spectrum


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
    """

    measured: datetime
    input_sha256: str
    versions: dict[str, str]
    sessions_sha256: tuple[str, ...] = ()

    def comes_from(self, sha256: str) -> bool:
        """Whether frames and readings with this hash are among the inputs."""
        return sha256 in (self.input_sha256, *self.sessions_sha256)
