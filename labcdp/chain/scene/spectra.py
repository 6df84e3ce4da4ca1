"""Spectra of the regions of a scene, where they have another than the light of the chain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk.files import shown
from ...core.errors import InputError, naming
from ...core.photometry import (
    Light,
    as_reflectance,
    holds_truth_value,
    photon_radiance_per_cd_m2,
    spectral_weights,
)
from ...core.spectra import SpectralTable, read_spectral_file
from ..fixed_pattern import kept
from ..parameters import Parameters, file_state

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class RegionSpectrum(Parameters):
    """Spectrum of a region: an emission, or the light of the chain reflected.

    Parameters
    ----------
    region : str
        Name of the region.
    emission : str or sequence of (float, float)
        Spectrum of a light of its own: a name, as that of the chain, or pairs of wavelength in nm and relative radiant
        power, such as W/nm (not photons), over any scale: linear between, 0 outside. Empty for the light of the chain.
    emission_path : str, Path or None
        The same from a file, CSV or spreadsheet, as `labcdp.core.spectra.read_spectral_file` reads: ``wavelength_nm``
        and a column of values. In a chain file, relative to it.
    reflectance : tuple of (float, float)
        Wavelength in nm and reflectance over any scale, by which the light is multiplied: linear between, 0 outside; ()
        for a neutral surface. The luminance of the region is stated, so only the shape counts.

    Raises
    ------
    InputError
        If the emission is not known, given twice, or no table of wavelengths that rise and values of at least 0 that
        covers 380 to 780 nm or vanishes at its ends; or the reflectance no table of numbers of at least 0. On first
        use, if the file is no such table.

    Examples
    --------
    >>> from labcdp.chain import RegionSpectrum
    >>> RegionSpectrum("lamp", emission="monochromatic 630 nm").emission
    'monochromatic 630 nm'
    >>> RegionSpectrum("lamp", emission=[[600, 0.0], [625, 1.0], [650, 0.0]]).emission[1]
    (625.0, 1.0)
    """

    region: str
    emission: Light = ""
    emission_path: Path | None = field(default=None, metadata={"path": True})
    reflectance: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.region, str):
            raise InputError(f"region is {shown(self.region)}: give a name in quotes", key="region")
        object.__setattr__(self, "reflectance", as_reflectance(self.reflectance))
        object.__setattr__(self, "emission", _as_emission(self.emission))
        if self.emission_path is None:
            return
        if self.emission:
            raise InputError("emission_path is given beside emission: leave out one of both", key="emission_path")
        if not isinstance(self.emission_path, str | PathLike):
            raise InputError(
                f"emission_path is {shown(self.emission_path)}: give the path of a table", key="emission_path"
            )
        object.__setattr__(self, "emission_path", Path(self.emission_path))

    @property
    def light(self) -> Light:
        """The emission, read from its file if it has one; empty for the light of the chain."""
        if self.emission_path is None:
            return self.emission
        return _emission_of(self.emission_path, file_state(self.emission_path))


@kept
def _emission_of(path: Path, _state: tuple[int, int] | None) -> Light:
    """Return the emission in a file; raises InputError."""
    with naming("emission_path"):
        return _pairs(read_spectral_file(path).only)


def _as_emission(value: Any) -> Light:
    """Return an emission in its hashable form; raises InputError."""
    if isinstance(value, str):
        if value:
            photon_radiance_per_cd_m2(value)
        return value
    if isinstance(value, SpectralTable):
        return _pairs(value)
    wrong = InputError(
        f"emission is {shown(value)}: give the name of a spectrum in quotes, or pairs of wavelength in nm and relative "
        "radiant power",
        key="emission",
    )
    if holds_truth_value(value):
        raise wrong
    try:
        table = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise wrong from None
    if table.ndim != 2 or table.shape[1] != 2:
        raise wrong
    with naming("emission"):
        return _pairs(SpectralTable(*(tuple(column.tolist()) for column in table.T)))


def _pairs(table: SpectralTable) -> Light:
    """Return a table as pairs; raises InputError for values below 0."""
    lowest = min(table.values)
    if lowest < 0:
        raise InputError(f"a spectrum of light has {lowest:g}: give values of at least 0")
    pairs = tuple(zip(table.wavelength_nm, table.values, strict=True))
    _, power, visibility = spectral_weights(pairs)
    if not power @ visibility > 0:
        first, last = table.wavelength_nm[0], table.wavelength_nm[-1]
        raise InputError(f"nothing from {first:g} to {last:g} nm is seen: give wavelengths in nm, from 380 to 780")
    return pairs


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


def spectral_samples(scene: Any) -> Iterator[tuple[RegionSpectrum, Mask]]:
    """Yield the spectra of a scene with the samples that have them, masks of the shape of its luminance map."""
    spectra = {spectrum.region: spectrum for spectrum in spectra_of(scene)}
    masks = scene.spectral_regions() if hasattr(scene, "spectral_regions") else level_samples(scene)
    for name, mask in masks.items():
        if name in spectra:
            yield spectra[name], mask


def level_samples(scene: Any) -> Mapping[str, Mask]:
    """Return which samples are of each level of a scene, masks of the shape of its luminance map."""
    if hasattr(scene, "is_bright"):
        bright = scene.is_bright()
        return {"dark": ~bright, "bright": bright}
    return dict(scene.regions())
