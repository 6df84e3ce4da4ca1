"""Spectra of the regions of a scene, where they have another than the light of the chain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk.files import shown
from ...core.errors import InputError
from ...core.photometry import as_reflectance, photon_radiance_per_cd_m2
from ..parameters import Parameters

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class RegionSpectrum(Parameters):
    """Spectrum of a region: an emission, or the light of the chain reflected.

    Parameters
    ----------
    region : str
        Name of the region.
    emission : str
        Spectrum of a light of its own, as that of the chain; empty for the light of the chain.
    reflectance : tuple of (float, float)
        Wavelength in nm and reflectance over any scale, by which the light is multiplied: linear between, 0 outside; ()
        for a neutral surface. The luminance of the region is stated, so only the shape counts.

    Raises
    ------
    InputError
        If the emission is not known, or the reflectance no table of numbers of at least 0.

    Examples
    --------
    >>> from labcdp.chain import RegionSpectrum
    >>> RegionSpectrum("lamp", emission="monochromatic 630 nm").emission
    'monochromatic 630 nm'
    """

    region: str
    emission: str = ""
    reflectance: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.region, str) or not isinstance(self.emission, str):
            raise InputError(f"region is {shown(self.region)}: give names in quotes", key="region")
        object.__setattr__(self, "reflectance", as_reflectance(self.reflectance))
        if self.emission:
            photon_radiance_per_cd_m2(self.emission)


def checked_spectra(spectra: Any, regions: Sequence[str]) -> tuple[RegionSpectrum, ...]:
    """Return spectra of regions, each once; raises InputError for another region."""
    if not isinstance(spectra, list | tuple) or not all(isinstance(spectrum, RegionSpectrum) for spectrum in spectra):
        raise InputError(f"spectra is {shown(spectra)}: give a list of labcdp.chain.RegionSpectrum", key="spectra")
    names = [spectrum.region for spectrum in spectra]
    for name in names:
        if name not in regions or names.count(name) > 1:
            raise InputError(
                f"spectra names the region {shown(name)}: give each once, of {', '.join(regions)}", key="spectra"
            )
    return tuple(spectra)


def spectra_of(scene: Any) -> tuple[RegionSpectrum, ...]:
    """Return the spectra of a scene's regions; none of a scene that cannot have any."""
    found: tuple[RegionSpectrum, ...] = getattr(scene, "spectra", ())
    return found


def level_samples(scene: Any) -> Mapping[str, Mask]:
    """Return which samples are of each level of a scene, masks of the shape of its luminance map."""
    if hasattr(scene, "is_bright"):
        bright = scene.is_bright()
        return {"dark": ~bright, "bright": bright}
    return dict(scene.regions())
