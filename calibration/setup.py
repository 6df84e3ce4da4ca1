"""What neither frames nor readings say about a calibration: lens, light, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from math import isfinite

from ..errors import InputError
from ..spectral_mismatch import Source
from ..spectral_table import SpectralTable


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
        The f-number set; the responsivity goes with its inverse square.

    Raises
    ------
    InputError
        If a number is not positive.
    """

    model: str
    serial: str
    focal_length_m: float
    f_number: float

    def __post_init__(self) -> None:
        for name in ("focal_length_m", "f_number"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise InputError(f"{name} of the lens is {value}: give a positive number")

    def __str__(self) -> str:
        return f"{self.model} ({self.serial}, {1e3 * self.focal_length_m:g} mm, f/{self.f_number:g})"


@dataclass(frozen=True)
class Setup:
    """What neither frames nor readings say about a calibration.

    Parameters
    ----------
    lens : LensIdentity
        The lens.
    source_spectrum : str
        Light of the patches, for example ``LED-B4``. A camera without a V(lambda) filter is calibrated for this
        spectrum only.
    input_sha256 : str
        Hash of the frames and readings, as the caller keeps them.
    measured_spectrum : SpectralTable or None
        Power of that light, if it was measured.
    """

    lens: LensIdentity
    source_spectrum: str
    input_sha256: str
    measured_spectrum: SpectralTable | None = None

    @property
    def light(self) -> Source:
        """The spectrum as measured, else its name."""
        return self.source_spectrum if self.measured_spectrum is None else self.measured_spectrum


@dataclass(frozen=True)
class Provenance:
    """Where a calibration comes from.

    Parameters
    ----------
    measured : datetime
        Time of the last meter reading, with time zone; the age of the calibration counts from here.
    input_sha256 : str
        Hash of frames and readings given by the caller.
    versions : dict of str to str
        Versions of the programs that computed it.
    """

    measured: datetime
    input_sha256: str
    versions: dict[str, str]
