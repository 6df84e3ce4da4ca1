"""Settings of the evaluation of a video."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.companding import Companding
from ...core.disk import file_sha256, reason
from ...core.disk.files import shown
from ...core.disk.journal import Row
from ...core.errors import InputError
from ...core.result import Finding, InputFile, warning
from ...core.roi import Roi
from ...files.picture import OF_VALUES
from ...files.transfer import as_encoding
from ...files.video.selection import Selection
from ...metrics import Epsilon
from ...metrics.contrast import checked_contrast
from ...report.files import read_dataset
from ...tracking import TrackedRoi, methods_of
from ..verdict import CDP_LIMIT, require_limit

if TYPE_CHECKING:
    from ..requirement import Requirement

#: Called for each evaluated frame: its number, the frame in 8 bits, where the regions are in it, and its results by
#: the names they have in the dataset. It has no regions for nearest-neighbour CDP.
Observer: TypeAlias = Callable[[int, NDArray[np.uint8], Sequence[TrackedRoi], Mapping[str, Any]], None]
#: Called with the frames that are done, and how many there are going to be as far as that is known.
Progress: TypeAlias = Callable[[int, "int | None"], None]
#: A measured contrast; that of the first frame; or the results of another video, by a calibrated camera for example.
Reference: TypeAlias = "float | Literal['first'] | Path"


@dataclass(frozen=True)
class VideoSettings:
    """Settings of the evaluation of a video, which can be sent to another process.

    Parameters
    ----------
    contrasts : tuple of float or None
        Contrasts to be detected, fractions; at least one, none twice. None for the contrast that is measured in the
        first frame in which both regions are seen; without regions, between neighbouring pixels.
    rois : tuple of Roi
        The two regions in the first frame of the selection; none for nearest-neighbour CDP.
    method : str
        Tracking method: one of `labcdp.tracking.METHODS`, or as `labcdp.tracking.methods_of` takes it.
    epsilon : float or DetectionInterval
        Tolerance of the contrasts.
    reference : float, 'first', Path or None
        Contrast that each frame is compared with besides: a measured one, that of the first frame in which the regions
        are seen, or that in the results of another video, for the frame of the same number or time.
    reference_by : {'number', 'time'}
        Whether the frames of the other video are matched by number or time.
    selection : Selection
        Frames that are evaluated.
    calibration, camera : Path or None
        Calibration file, or camera specification; at most one. Neither for relative values.
    encoding : {'linear', 'srgb'} or None
        How values are encoded; None for what the camera specification or the file says, else the usual one.
    image_size : (int, int) or None
        Width and height of the image the regions were drawn on, which must be those of the frames; None if not known.
    exposure_s, gain_db, temperature_c, bit_depth : float or int or None
        Of the video; they count before what it or the calibration says. Bits are those of 16-bit values.
    black_level_dn, bayer, focal_length_m, pixel_pitch_m, no_vignetting
        As of `labcdp.files.picture.PictureOptions`; None for what the video or the camera specification says.
    frame_rate_hz : float or None
        Frames a second of images, which state no times.
    damaged : bool
        Whether frames that are damaged, or build on damaged ones, are evaluated, with a note.
    cdp_limit : float
        CDP from which a contrast counts as detected in a frame.
    colours : bool
        Whether the colours of the regions are to be separated in each frame.
    requirement : Requirement or None
        Requirement by which the pair is judged, with contrast, tolerance and limit of its own.

    Raises
    ------
    InputError
        If something is out of range or does not fit together.
    """

    contrasts: tuple[float, ...] | None = None
    rois: tuple[Roi, ...] = ()
    method: str = "follow"
    epsilon: Epsilon = 0.5
    reference: Reference | None = None
    reference_by: Literal["number", "time"] = "number"
    selection: Selection = field(default_factory=Selection)
    calibration: Path | None = None
    camera: Path | None = None
    encoding: str | Companding | None = None
    image_size: tuple[int, int] | None = None
    exposure_s: float | None = None
    gain_db: float | None = None
    temperature_c: float | None = None
    bit_depth: int | None = None
    damaged: bool = False
    black_level_dn: float | None = None
    bayer: str | None = None
    focal_length_m: float | None = None
    pixel_pitch_m: float | None = None
    no_vignetting: bool | None = None
    frame_rate_hz: float | None = None
    cdp_limit: float = CDP_LIMIT
    requirement: Requirement | None = None
    colours: bool = False

    def __post_init__(self) -> None:
        require_limit(self.cdp_limit)
        for name in ("calibration", "camera"):
            self._hold_path(name)
        if self.reference is not None and self.reference != "first":
            if isinstance(self.reference, int | float) and not isinstance(self.reference, bool):
                object.__setattr__(self, "reference", float(self.reference))
            else:
                self._hold_path("reference")
        if self.contrasts == ():
            raise InputError("no contrast is given: give at least one, for example 100%")
        # Any contrast shows whether the tolerance is possible.
        for contrast in self.contrasts or (1.0,):
            checked_contrast(contrast, self.epsilon)
        if self.contrasts is not None and len(set(self.contrasts)) != len(self.contrasts):
            raise InputError("a contrast is given twice: give each once")
        self._check_number()
        methods_of(self.method, [roi.name for roi in self.rois])
        if self.reference is not None and not self.rois:
            raise InputError("a reference contrast needs regions: give two, or give the contrast itself")
        if isinstance(self.reference, float):
            checked_contrast(self.reference, self.epsilon)
        if self.colours and not isinstance(self.epsilon, int | float):
            raise InputError("the tolerance has two ends: give one number for the colours of regions")

    def _check_number(self) -> None:
        """Refuse a number of regions that cannot be evaluated."""
        if len(self.rois) not in (0, 2):
            raise InputError(f"{len(self.rois)} regions are given: give two, or none for nearest-neighbour CDP")

    def _hold_path(self, name: str) -> None:
        given = getattr(self, name)
        if isinstance(given, str):
            object.__setattr__(self, name, Path(given))
        elif given is not None and not isinstance(given, Path):
            raise InputError(f"{name} is {shown(given)}: give the path of a file")

    @property
    def stated(self) -> dict[str, Any]:
        """Statements about the video by the user, None for what is not stated."""
        names = ("exposure_s", "gain_db", "temperature_c", "bit_depth", *OF_VALUES, "frame_rate_hz")
        return {name: getattr(self, name) for name in names}

    @property
    def n_contrasts(self) -> int:
        """Number of target contrasts in each frame."""
        return 1 if self.contrasts is None else len(self.contrasts)

    @property
    def methods(self) -> tuple[str, ...]:
        """How each region is followed."""
        return methods_of(self.method, [roi.name for roi in self.rois])

    @property
    def mode(self) -> Literal["regions", "neighbours"]:
        """Whether regions are compared, or pixels with their neighbours."""
        return "regions" if self.rois else "neighbours"


#: How far the time of a frame of the other video may be off, in parts of the usual distance of its frames.
_NEAR = 0.5


class VideoReference:
    """Contrast that another video measured in its frame of the same number or time.

    Parameters
    ----------
    path : Path
        Its results as NetCDF, as `labcdp video` wrote them.
    by : {'number', 'time'}
        What frames are matched by. By time, the nearest one counts, up to half the usual distance of its frames.

    Raises
    ------
    InputError
        If there are no such results at `path`, or they have no contrasts.
    """

    def __init__(self, path: Path, by: Literal["number", "time"]) -> None:
        dataset = _load(path)
        self.sha256 = file_sha256(path, "results.nc of another video")
        name = "frame" if by == "number" else "time_s"
        order = np.argsort(dataset[name], kind="stable")
        self._at: NDArray[np.float64] = dataset[name][order]
        self._contrasts: NDArray[np.float64] = dataset["measured_contrast"][order]
        self._by, self._path = by, path
        steps = np.diff(self._at)
        self._tolerance = 0.0 if by == "number" else _NEAR * float(np.median(steps)) if steps.size else 1e-3

    def contrast(self, number: int, time_s: float) -> tuple[float | None, Finding | None]:
        """Return the contrast for a frame, or why there is none."""
        at = number if self._by == "number" else time_s
        nearest = int(np.argmin(np.abs(self._at - at)))
        if abs(self._at[nearest] - at) > self._tolerance:
            if self._by == "time":
                return None, warning("reference-without-time", time_s=time_s)
            return None, warning("reference-without-frame", number=number)
        contrast = float(self._contrasts[nearest])
        if not (isfinite(contrast) and contrast > 0):
            return None, warning("reference-without-contrast")
        return contrast, None


def load_reference(settings: VideoSettings) -> VideoReference | None:
    """Read the results of the other video that frames are compared with, if any; raises InputError."""
    path = settings.reference
    return VideoReference(path, settings.reference_by) if isinstance(path, Path) else None


def _load(path: Path) -> Mapping[str, NDArray[Any]]:
    """Frame numbers, times and contrasts of results on disk."""
    names = ("frame", "time_s", "measured_contrast")
    dataset = read_dataset(path, "result of another video")
    shapes = {name: dataset[name].shape if name in dataset.variables else () for name in names}
    if len(set(shapes.values())) != 1 or len(shapes["frame"]) != 1 or shapes["frame"][0] == 0:
        raise InputError(
            f"the reference {path} holds no contrasts of a video's frames: give results.nc that labcdp video wrote for "
            "two regions"
        )
    try:
        return {name: np.asarray(dataset[name].values, dtype=float) for name in names}
    except (ValueError, TypeError) as error:
        raise InputError(f"the reference {path} holds no numbers ({reason(error)}): give results.nc") from error


#: Format of the journal, and packages on which results depend to the last bit.
_FORMAT = 4
_PACKAGES = ("labcdp", "numpy", "numba", "scipy", "av", "opencv-contrib-python-headless")


def evaluation_head(settings: VideoSettings, reference: VideoReference | None) -> Row:
    """Return all inputs of the results other than the video, as in the journal."""
    return {"format": _FORMAT, "settings": video_configuration(settings, reference), "versions": package_versions()}


def package_versions() -> dict[str, str]:
    """Return the versions of the packages on which results depend to the last bit."""
    return {name: version(name) for name in _PACKAGES}


def video_configuration(settings: VideoSettings, reference: VideoReference | None) -> dict[str, Any]:
    """Return the settings that determine the results, as values JSON can hold."""
    epsilon = settings.epsilon
    stated: Any = settings.reference
    if reference is not None:
        stated = {"sha256": reference.sha256, "by": settings.reference_by}
    as_they_are = ("damaged", "cdp_limit")
    encoding = as_encoding(settings.encoding) or _curve_of_camera(settings.camera)
    return {
        "contrasts": None if settings.contrasts is None else list(settings.contrasts),
        "rois": [{"name": roi.name, "corners": [list(corner) for corner in roi.corners]} for roi in settings.rois],
        "method": settings.method if settings.rois else None,
        "epsilon": epsilon if isinstance(epsilon, float | int) else asdict(epsilon),
        "reference": stated,
        "selection": settings.selection.to_dict(),
        "calibration_sha256": None if settings.calibration is None else _calibration_sha256(settings.calibration),
        "camera_sha256": None if settings.camera is None else InputFile.of("camera", settings.camera).sha256,
        "encoding": asdict(encoding) if isinstance(encoding, Companding) else encoding,
        **{name: getattr(settings, name) for name in as_they_are},
        **({"colours": True} if settings.colours else {}),
        **({} if settings.requirement is None else {"requirement": settings.requirement.model_dump(mode="json")}),
        **settings.stated,
    }


def _curve_of_camera(path: Path | None) -> Companding | None:
    """Return the curve that a camera specification names; its file may change while that of the camera does not."""
    if path is None:
        return None
    from ..picture.camera_specification import CameraSpecification

    encoding = as_encoding(CameraSpecification.load(path).encoding)
    return encoding if isinstance(encoding, Companding) else None


def _calibration_sha256(path: Path) -> str:
    # Relative light needs no calibration.
    from ...calibration.record import calibration_sha256

    return calibration_sha256(path)
