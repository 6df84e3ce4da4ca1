"""Light of a still scene from pictures at several exposures, which are merged where a source saturates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.disk.files import SESSION_JOURNAL
from ...core.errors import InputError
from ...core.luminance import Invalid, LuminanceMap, MergedMap
from ...core.result import Finding, InputFile, unique
from ...files.picture import Picture
from ...files.read import picture_paths, read_picture
from ..picture.converter import Converter, PictureSource


@dataclass(frozen=True, eq=False)
class SceneLight:
    """Light of a still scene.

    Parameters
    ----------
    map : LuminanceMap
        Its light, of each pixel from the longest exposures at which it is not saturated.
    sources : tuple of PictureSource
        Facts about each picture.
    exposures_s : tuple of float
        Exposures that were merged, the shortest first; empty for a picture whose exposure is not known.
    """

    map: LuminanceMap
    sources: tuple[PictureSource, ...]
    exposures_s: tuple[float, ...]

    @property
    def unit(self) -> str:
        """Unit of the light."""
        return self.sources[0].unit

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about the pictures."""
        return unique([finding for source in self.sources for finding in source.findings])

    def inputs(self, role: str) -> tuple[InputFile, ...]:
        """Return the records of the files."""
        return tuple(InputFile(role, str(source.path), source.sha256) for source in self.sources)


def scene_paths(paths: Sequence[Path]) -> list[Path]:
    """Return the pictures of files, folders, and sessions, of which those with light count; raises InputError.

    Examples
    --------
    >>> from labcdp.evaluate.flare.light import scene_paths
    >>> from labcdp.session import example_session
    >>> len(scene_paths([example_session()]))
    6
    """
    files: list[Path] = []
    for path in paths:
        if (path / SESSION_JOURNAL).is_file():
            # Sessions are needed for this alone.
            from ...session import Session

            with Session.open(path) as session:
                files += [path / frame.file.name for frame in session.frames("light")]
        else:
            files += picture_paths([path])
    if not files:
        raise InputError("there is no picture with light: give some")
    return list(dict.fromkeys(files))


def scene_light(paths: Sequence[Path], converter: Converter, is_compared: bool = False) -> SceneLight:
    """Return the light of a still scene from one or several pictures.

    Parameters
    ----------
    paths : sequence of Path
        Pictures from one place; those of one exposure are averaged.
    converter : Converter
        Converter of values to light.
    is_compared : bool
        Whether the light is compared with that of other pictures; relative light is then that per exposure and gain.

    Raises
    ------
    InputError
        If a picture cannot be read, they differ in size or unit, or the exposure of relative light is needed and not
        known.
    """
    pictures = [read_picture(path, converter.options) for path in paths]
    sources = tuple(converter.source(picture) for picture in pictures)
    if len({source.unit for source in sources}) > 1:
        raise InputError("some pictures are in cd/m², others are relative: give those of one kind")
    is_relative = sources[0].unit == "relative"
    several = len(pictures) > 1 or is_compared
    by_exposure: dict[float, list[LuminanceMap]] = {}
    for picture, source in zip(pictures, sources, strict=True):
        exposure, luminance = _exposure_s(picture), converter.luminance(picture)
        if is_relative and several:
            if exposure is None:
                raise InputError(
                    f"the exposure of {source.path} is not known: state it (--exposure, of a direct picture "
                    "--direct-exposure), or calibrate"
                )
            luminance = _over(luminance, exposure)
        by_exposure.setdefault(exposure or 0.0, []).append(luminance)
    shortest, *longer = (_averaged(by_exposure[exposure]) for exposure in sorted(by_exposure))
    merged = shortest
    for luminance in longer:
        if luminance.shape != merged.shape:
            raise InputError(f"pictures have {merged.shape} and {luminance.shape} pixels: give those of one camera")
        merged = MergedMap((luminance.invalid & Invalid.SATURATED) == 0, luminance, merged)
    return SceneLight(merged, sources, tuple(sorted(exposure for exposure in by_exposure if exposure)))


def _exposure_s(picture: Picture) -> float | None:
    """Exposure of a picture, longer by its gain; None where it is not known."""
    if picture.frame is None or not picture.exposure_known:
        return None
    return float(picture.frame.exposure_s * 10 ** (picture.frame.gain_db / 20))


def _over(luminance: LuminanceMap, exposure_s: float) -> LuminanceMap:
    """Return relative light per second."""
    light = np.asarray(luminance.luminance_cd_m2, dtype=np.float64) / exposure_s
    return LuminanceMap(light, luminance.random_rel, luminance.common, luminance.invalid, step=luminance.step)


def _averaged(maps: Sequence[LuminanceMap]) -> LuminanceMap:
    """Return the mean of maps of one exposure; a pixel is invalid if it is so in one of them."""
    first = maps[0]
    if len(maps) == 1:
        return first
    if any(luminance.shape != first.shape for luminance in maps):
        raise InputError("the pictures differ in size: give those of one camera")
    light = np.mean([np.asarray(luminance.luminance_cd_m2, dtype=np.float64) for luminance in maps], axis=0)
    invalid = np.bitwise_or.reduce([luminance.invalid for luminance in maps])
    return LuminanceMap(
        light, first.random_rel / len(maps) ** 0.5, first.common, invalid, slow_rel=first.slow_rel,
        slow_cd_m2=first.slow_cd_m2, fixed_rel=first.fixed_rel, fixed_cd_m2=first.fixed_cd_m2, step=first.step,
    )  # fmt: skip
