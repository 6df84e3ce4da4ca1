"""What is corrected in frames before a patch is measured: vignetting, defects, the dark pattern."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...calibration import AnyCalibration, Calibration
from ...calibration.dark.library import DarkLibrary
from ...calibration.defects import DefectMap
from ...core.finding import Finding
from ...core.vignetting import AnyVignetting, Cos4Vignetting
from ...session import Session, SessionConfiguration
from .recorded import planes_of

#: Corrections by colour plane; None stands for a monochrome sensor.
PlaneCorrections = Mapping[str | None, "Corrections"]


@dataclass(frozen=True)
class Corrections:
    """Corrections for the frames of one plane.

    Parameters
    ----------
    vignetting : Cos4Vignetting, RadialVignetting, FlatField or None
        Vignetting; None for none.
    defects : DefectMap or None
        Pixels that are left out of regions.
    dark_library : DarkLibrary or None
        Dark pattern.
    findings : tuple of Finding
        What was found when they were measured.
    """

    vignetting: AnyVignetting | None
    defects: DefectMap | None = None
    dark_library: DarkLibrary | None = None
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of_lens(cls, configuration: SessionConfiguration, plane: str | None) -> Corrections:
        """Natural vignetting of the configured lens: what is known without a flat field."""
        # The pixels of one colour are two pitches apart.
        pitch_m = configuration.camera.pixel_pitch_m * (1 if plane is None else 2)
        return cls(Cos4Vignetting(configuration.lens.focal_length_m, pitch_m))

    @classmethod
    def of(cls, calibration: Calibration) -> Corrections:
        """Those of a calibration: its patches are measured with nothing else."""
        return cls(calibration.vignetting, calibration.defects, calibration.dark_library)


def corrections_of(calibration: AnyCalibration) -> dict[str | None, Corrections]:
    """Corrections of each plane of a calibration."""
    return {plane.state.plane: Corrections.of(plane) for plane in calibration.planes}


def corrections_of_lens(session: Session) -> dict[str | None, Corrections]:
    """Natural vignetting of the session's lens for each plane: what is known without a measurement."""
    return {plane: Corrections.of_lens(session.configuration, plane) for plane in planes_of(session)}
