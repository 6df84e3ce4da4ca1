"""A scene from a file: any image whose values are luminance, or proportional to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk import read_bytes
from ...core.disk.arrays import parse_npy
from ...core.disk.files import shortened, shown
from ...core.disk.tiff import open_tiff, pixels_of
from ...core.errors import InputError, naming
from ..fixed_pattern import kept
from ..parameters import Number, Oversampling, Parameters, file_state
from ..point_spread import pixel_means
from .scene import FloatMap, Level, Mask, Patch, luminance_map
from .spectra import RegionSpectrum, checked_spectra

#: Name of the whole image among the regions that have spectra.
WHOLE = "image"
#: Size from which an image is refused.
_MOST_BYTES = 2**31


@dataclass(frozen=True)
class ImageScene(Parameters):
    """A luminance image from a file; its size, over the oversampling, is the scene's.

    Parameters
    ----------
    path : str or Path
        A grey image as NumPy array (``.npy``) or TIFF, 2-D, of integers or floats. In a chain file, relative to it.
    cd_m2_per_value : float
        Luminance of the value 1 in cd/m^2.
    regions_xywh : mapping of str to (int, int, int, int)
        Regions to be evaluated: name and x, y, width, height in pixels. The pairs are neighbours in mean luminance.
    oversampling : int
        Values of the image on each side of a pixel of the camera, 1 to 64.
    spectra : tuple of RegionSpectrum
        Spectra of the whole as ``image``, and of regions by their names, that are not those of the chain. Where regions
        overlap, that of the later one counts.

    Raises
    ------
    InputError
        If a value is out of its range; on first use, if the file is no such image or a region not inside it.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.chain import ImageScene
    >>> from pathlib import Path
    >>> np.save("scene.npy", np.full((30, 40), 5.0))
    >>> ImageScene(Path("scene.npy"), cd_m2_per_value=2.0).luminance_map().max()
    np.float32(10.0)
    """

    path: Path = field(metadata={"path": True})
    cd_m2_per_value: Annotated[float, Number("cd/m²", 0, above=True)] = 1.0
    regions_xywh: Mapping[str, tuple[int, int, int, int]] = field(default_factory=dict)
    oversampling: Oversampling = 1
    spectra: tuple[RegionSpectrum, ...] = field(default=(), metadata={"table": RegionSpectrum})

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.path, str | PathLike):
            raise InputError(f"path is {shown(self.path)}: give the path of a .npy, .tif or .tiff file", key="path")
        object.__setattr__(self, "path", Path(self.path))
        named = self.regions_xywh
        if not isinstance(named, Mapping) or not all(isinstance(name, str) for name in named):
            raise InputError(
                f"regions_xywh is {shown(self.regions_xywh)}: give a table of names and lists", key="regions_xywh"
            )
        regions = {name: self._checked(name, corners) for name, corners in self.regions_xywh.items()}
        object.__setattr__(self, "regions_xywh", regions)
        object.__setattr__(self, "spectra", checked_spectra(self.spectra, [WHOLE, *regions]))

    @cached_property
    def _luminance(self) -> FloatMap:
        scene = _luminance_of(self.path, file_state(self.path), self.cd_m2_per_value)
        if any(size % self.oversampling for size in scene.shape):
            raise InputError(
                f"path is {str(self.path)!r}, of {scene.shape[1]} x {scene.shape[0]} values, which {self.oversampling} "
                "samples on each side of a pixel do not divide: crop it, or give another oversampling",
                key="path",
            )
        height, width = (size // self.oversampling for size in scene.shape)
        for name in self.regions_xywh:
            rectangle = self._rectangle(name)
            with naming(f"regions_xywh.{shortened(name)}"):
                rectangle.check_inside(width, height)
        return scene

    def _checked(self, name: str, corners: Any) -> tuple[int, int, int, int]:
        corners = corners.tolist() if isinstance(corners, np.ndarray) else corners
        if not isinstance(corners, list | tuple) or len(corners) != 4:
            raise InputError(
                f"regions_xywh.{shortened(name)} is {shown(corners)}: give a list of x, y, width and height in pixels",
                key="regions_xywh",
            )
        x, y, width, height = corners
        with naming(f"regions_xywh.{shortened(name)}"):
            Patch(x, y, width, height, 0.0)
        return int(x), int(y), int(width), int(height)

    def _rectangle(self, name: str) -> Patch:
        return Patch(*self.regions_xywh[name], luminance_cd_m2=0.0)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        height, width = (size // self.oversampling for size in self._luminance.shape)
        return height, width

    def luminance_map(self) -> FloatMap:
        """Luminance of each sample in cd/m², read-only."""
        return self._luminance

    def regions(self) -> Mapping[str, Mask]:
        """Return the named regions."""
        masks = {}
        for name in self.regions_xywh:
            patch = self._rectangle(name)
            masks[name] = np.zeros(self.shape, bool)
            masks[name][patch.rows, patch.columns] = True
        return masks

    def spectral_regions(self) -> Mapping[str, Mask]:
        """Return the samples of the whole image and of the regions, shape of the luminance map."""
        whole = {WHOLE: np.ones(self._luminance.shape, bool)}
        samples = np.ones((self.oversampling, self.oversampling), bool)
        return whole | {name: np.kron(mask, samples) for name, mask in self.regions().items()}

    def levels(self) -> Sequence[Level]:
        """Return nothing: an image has any number of luminances."""
        return ()

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return each region with the next brighter one."""
        seen = pixel_means(self._luminance, self.oversampling)
        means = {name: float(seen[mask].mean()) for name, mask in self.regions().items()}
        ordered = sorted(means, key=lambda name: means[name])
        return tuple((a, b) for a, b in pairwise(ordered) if means[a] < means[b])


@kept
def _luminance_of(path: Path, _state: tuple[int, int] | None, cd_m2_per_value: float) -> FloatMap:
    values = _read(path)
    # What is not finite is refused then.
    with naming(f"path is {str(path)!r}"), np.errstate(over="ignore", invalid="ignore"):
        scene = luminance_map(values.astype(np.float64) * cd_m2_per_value)
    scene.flags.writeable = False
    return scene


def _read(path: Path) -> NDArray[Any]:
    """Return the values of an image file, 2-D; raises InputError naming the file."""
    suffix = path.suffix.lower()
    if suffix not in (".npy", ".tif", ".tiff"):
        raise InputError(f"path is {str(path)!r}: give a .npy, .tif or .tiff file of luminance", key="path")
    try:
        data = read_bytes(path, "a grey image", _MOST_BYTES)
        if suffix == ".npy":
            values = parse_npy(data)
        else:
            with open_tiff(data, path) as tiff:
                values = pixels_of(tiff.pages.first.aspage(), path)
    except InputError as error:
        raise InputError(f"path: {error}", key="path") from error
    if values.ndim != 2 or values.dtype.kind not in "uif":
        raise InputError(
            f"path is {str(path)!r}, which holds {values.dtype} of shape {values.shape}: give a 2-D grey image",
            key="path",
        )
    return values
