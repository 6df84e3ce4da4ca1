"""What is corrected in frames before a patch is measured: vignetting, defects, the dark pattern."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import prod, sqrt

from ...calibration import AnyCalibration, Calibration
from ...calibration.convert.region import of_region
from ...calibration.dark.library import DarkLibrary
from ...calibration.defects import DefectMap
from ...calibration.frames.observations import CameraState
from ...calibration.frames.planes import plane_of
from ...core.finding import Finding
from ...core.frame import Readout
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
    def of(cls, calibration: Calibration) -> Corrections:
        """Those of a calibration: its patches are measured with nothing else."""
        return cls(calibration.vignetting, calibration.defects, calibration.dark_library)


def pixel_area_m2(pixel_pitch_m: float, readout: Readout | None) -> float:
    """Area of a sensor with this pitch that a pixel of its frames sums or averages."""
    return pixel_pitch_m**2 * (1 if readout is None else prod(readout.binning))


def natural_vignetting(configuration: SessionConfiguration, state: CameraState) -> Cos4Vignetting:
    """Natural vignetting of the configured lens: what is known without a flat field."""
    # The pixels of one colour are two pitches apart.
    readout = state.readout or Readout()
    # Where columns and rows differ, the geometric mean.
    apart = sqrt(prod((*readout.binning, *readout.decimation))) * (1 if state.plane is None else 2)
    pitch_m, axis_px = apart * configuration.camera.pixel_pitch_m, readout.axis_px(state.image_shape)
    return Cos4Vignetting(configuration.lens.focal_length_m, pitch_m, axis_px)


def calibration_for(session: Session, calibration: AnyCalibration) -> AnyCalibration:
    """Return a calibration for the part of the sensor that the frames of a session show."""
    frames = session.frames()
    if not frames or frames[0].metadata.get("readout") is None:
        return calibration
    states = _states(session)
    planes = tuple(of_region(plane, states.get(plane.state.plane, plane.state)) for plane in calibration.planes)
    return planes[0] if isinstance(calibration, Calibration) else replace(calibration, planes=planes)


def _states(session: Session) -> dict[str | None, CameraState]:
    first = session.load(session.frames()[0])
    return {plane: CameraState.of(plane_of(first, plane)) for plane in planes_of(session)}


def corrections_of(calibration: AnyCalibration) -> dict[str | None, Corrections]:
    """Corrections of each plane of a calibration."""
    return {plane.state.plane: Corrections.of(plane) for plane in calibration.planes}


def corrections_of_lens(session: Session) -> dict[str | None, Corrections]:
    """Natural vignetting of the session's lens for each plane: what is known without a measurement."""
    states = _states(session)
    return {plane: Corrections(natural_vignetting(session.configuration, state)) for plane, state in states.items()}
