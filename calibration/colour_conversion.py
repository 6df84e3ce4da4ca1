"""From Bayer frames and their patches to luminance, by the combination of planes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..frame import Frame
from ..luminance import RANGE_MARGIN, WHOLE, CommonError, Invalid, LuminanceMap, Window
from .colour import ColourCalibration
from .colour_combination import colourfulness
from .colour_planes import colours_of_planes
from .model import Calibration
from .observations import PatchObservation
from .patch import PatchLuminance, patch_luminance
from .place import slow_rel
from .planes import split

#: Errors that all planes of a frame share, so that they add with their signs.
_OF_ALL_PLANES = ("meter scale", "exposure time")


def to_luminance(calibration: ColourCalibration, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
    """Convert a Bayer frame, or a window of its map; see `ColourCalibration.to_luminance`."""
    frames = split(frame)
    maps = [plane.to_luminance(frames[f"{plane.state.plane}"], window) for plane in calibration.planes]
    return _Combined(calibration, maps).map()


def colour_patch_luminance(
    calibration: ColourCalibration, observations: Mapping[str, Sequence[PatchObservation]]
) -> PatchLuminance:
    """Luminance of one patch by the combination of planes.

    Parameters
    ----------
    calibration : ColourCalibration
        Of the same camera and settings.
    observations : mapping of str to sequence of PatchObservation
        Of one patch, by the name of the plane.

    Raises
    ------
    CalibrationError
        As `patch_luminance`, naming the plane; if a plane is missing, or the planes give no light together.
    """
    seen = []
    for plane in calibration.planes:
        name = f"{plane.state.plane}"
        if name not in observations:
            raise CalibrationError(f"there are no observations of plane {name}: observe all planes of the frames")
        try:
            seen.append(patch_luminance(plane, observations[name]))
        except CalibrationError as error:
            raise CalibrationError(f"plane {name}: {error}") from error
    by_plane = np.array([one.luminance_cd_m2 for one in seen])
    luminance = float(np.array(calibration.weights) @ by_plane)
    if luminance <= 0:
        raise CalibrationError(
            f"patch {seen[0].patch!r} has {luminance:.3g} cd/m^2 by the combination of planes: its light is not of the "
            "kind the weights are for; calibrate with a patch of this colour"
        )
    shares = np.array(calibration.weights) * by_plane / luminance
    pairs = list(zip(calibration.planes, seen, strict=True))
    own = [own_rel(plane, one) for plane, one in pairs]
    of_colour = calibration.spectral_rel * float(colourfulness(by_plane @ colours_of_planes(calibration.planes)))
    of_field = max(slow_rel(plane.vignetting) for plane in calibration.planes)
    random_rel = hypot(float(np.linalg.norm(shares * own)), calibration.scatter_rel, of_field, of_colour)
    low, high = calibration.range_cd_m2
    margin = RANGE_MARGIN * random_rel * luminance
    warnings = [
        f"plane {plane.state.plane}: {warning}"
        for plane, one in pairs
        for warning in one.warnings
        if "left out there" in warning or "degC" in warning
    ]
    if luminance < low - margin or luminance > high + margin:
        warnings.append(
            f"patch {seen[0].patch!r} has {luminance:.4g} cd/m^2, the calibrated range is {low:.4g} to {high:.4g} "
            "cd/m^2: calibrate with a patch as bright or as dark"
        )
    weight_errors = (CommonError("fit", float(row @ by_plane / luminance)) for row in calibration.weight_errors)
    planes = [_kept(plane, one.common) for plane, one in pairs]
    return PatchLuminance(
        patch=seen[0].patch,
        luminance_cd_m2=luminance,
        random_rel=random_rel,
        common=(*weight_errors, *_joined(planes, [float(share) for share in shares])),
        exposures_s=tuple(sorted({t for one in seen for t in one.exposures_s})),
        warnings=tuple(warnings),
    )


def own_rel(plane: Calibration, seen: PatchLuminance) -> float:
    """Relative standard uncertainty of a patch that its plane does not share with the others."""
    # A source that was uneven when the flat field was taken was so in all planes.
    shared_rel = hypot(plane.responsivity.scatter_rel, slow_rel(plane.vignetting))
    return sqrt(max(seen.random_rel**2 - shared_rel**2, 0.0))


def _kept(plane: Calibration, common: Sequence[CommonError]) -> list[CommonError]:
    """Errors of a plane that stay: its scale is part of the weights, the shape of its response is not."""
    return [e for e in common if e.source != "fit" or plane.response.kind != "linear"]


def _joined(planes: Sequence[Sequence[CommonError]], shares: Sequence[Any]) -> list[CommonError]:
    """Errors of the planes times their shares of the luminance; those that all planes share are added up."""
    shared: dict[str, CommonError] = {}
    result: list[CommonError] = []
    for errors, share in zip(planes, shares, strict=True):
        for error in errors:
            relative = share * error.relative
            if not error.source.startswith(_OF_ALL_PLANES):
                result.append(replace(error, relative=relative))
            elif error.source in shared:
                sum_of_both = shared[error.source].relative + relative
                shared[error.source] = replace(error, relative=sum_of_both)
            else:
                shared[error.source] = replace(error, relative=relative)
    # The meter's scale is one number for all planes, and so for the sum of their shares.
    scale = next(e for errors in planes for e in errors if e.rectangular)
    return [scale, *(e for e in shared.values() if not e.rectangular), *result]


@dataclass(frozen=True, eq=False)
class _Combined:
    """Map of a frame, of the maps of its planes; all but the luminance is computed when it is asked for."""

    calibration: ColourCalibration
    maps: Sequence[LuminanceMap]

    def map(self) -> LuminanceMap:
        return LuminanceMap(
            self._luminance(),
            self._random_rel,
            self._common,
            self._invalid,
            slow_rel=max(one.slow_rel for one in self.maps),
            slow_cd_m2=np.sqrt(self._sum_of_squares([one.slow_cd_m2 for one in self.maps])),
            fixed_rel=max(one.fixed_rel for one in self.maps),
            fixed_cd_m2=lambda: np.sqrt(self._sum_of_squares([one.fixed_cd_m2 for one in self.maps])),
            step=2,
        )

    def _luminance(self) -> NDArray[np.floating[Any]]:
        total = np.zeros(self.maps[0].shape, dtype=np.float32)
        for weight, one in zip(self.calibration.weights, self.maps, strict=True):
            total += np.float32(weight) * one.luminance_cd_m2
        return total

    def _magnitude(self, window: Window = WHOLE) -> NDArray[np.floating[Any]]:
        magnitude: NDArray[np.floating[Any]] = np.maximum(np.abs(self._luminance()[window]), np.float32(1e-30))
        return magnitude

    def _random_rel(self) -> NDArray[np.floating[Any]]:
        variance = self._sum_of_squares([one.luminance_cd_m2 * one.random_rel for one in self.maps])
        random_rel: NDArray[np.floating[Any]] = np.sqrt(variance) / self._magnitude()
        return random_rel

    def _sum_of_squares(self, of_planes: Sequence[NDArray[np.floating[Any]] | float]) -> NDArray[np.floating[Any]]:
        """Variance of the weighted sum of independent errors of the planes."""
        variance = np.zeros(self.maps[0].shape, dtype=np.float32)
        for weight, one in zip(self.calibration.weights, of_planes, strict=True):
            variance += np.square(np.float32(weight) * one)
        return variance

    def _common(self, window: Window) -> tuple[CommonError, ...]:
        planes = self.calibration.planes
        by_plane = np.stack([one.luminance_cd_m2[window] for one in self.maps], axis=-1)
        magnitude = self._magnitude(window)
        shares = [w * by_plane[..., i] / magnitude for i, w in enumerate(self.calibration.weights)]
        errors = [CommonError("fit", by_plane @ row / magnitude) for row in self.calibration.weight_errors]
        kept = [_kept(plane, one.common_in(window)) for plane, one in zip(planes, self.maps, strict=True)]
        errors += _joined(kept, shares)
        if self.calibration.spectral_rel > 0:
            of_colour = self.calibration.spectral_rel * colourfulness(by_plane @ colours_of_planes(planes))
            errors.append(CommonError("spectral mismatch", of_colour))
        return tuple(errors)

    def _invalid(self) -> NDArray[np.uint8]:
        luminance, margin = self._luminance(), RANGE_MARGIN * self._random_rel() * self._magnitude()
        low, high = self.calibration.range_cd_m2
        invalid = np.where(luminance < 0, Invalid.BELOW_BLACK, 0).astype(np.uint8)
        invalid[(luminance + margin < low) | (luminance - margin > high)] |= np.uint8(Invalid.OUTSIDE_CALIBRATED)
        for one in self.maps:
            invalid |= one.invalid & np.uint8(Invalid.SATURATED | Invalid.DEFECT)
        return invalid
