"""The simulated target: the patches of a session's configuration as the sensor sees them."""

from __future__ import annotations

from collections.abc import Hashable
from itertools import combinations
from math import ceil, floor
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...chain import ImagingChain, Patch, PatchScene
from ...chain.sensor import Sensor
from ...core.errors import ConfigurationError
from ...core.photometry import electron_radiance_per_cd_m2
from ...session import PatchConfiguration, SessionConfiguration
from .faults import Drifts
from .noise import announced, running

#: Wavelength in nm and transmittance of pigment filters as of Bayer sensors, behind the infrared block of a colour
#: camera: their typical shape, not a measurement.
_TRANSMITTANCE: Final = {
    "R": ((380, 0.08), (450, 0.04), (540, 0.04), (570, 0.12), (590, 0.55), (610, 0.8), (650, 0.7), (700, 0)),
    "G": ((380, 0.05), (450, 0.08), (480, 0.2), (510, 0.7), (535, 0.8), (560, 0.7), (590, 0.4), (650, 0), (700, 0)),
    "B": ((380, 0.3), (420, 0.6), (450, 0.75), (480, 0.6), (510, 0.25), (540, 0.07), (580, 0.03), (700, 0)),
}  # fmt: skip


def mosaic(sensor: Sensor, spectrum: str, colour_filter: str | None) -> NDArray[np.float32]:
    """Return the electrons of each pixel relative to those without filters, for light of a spectrum.

    Parameters
    ----------
    sensor : Sensor
        Monochrome.
    spectrum : str
        Of the light.
    colour_filter : str or None
        First two pixels of the Bayer pattern; None for no filters.

    Returns
    -------
    ndarray of float32, shape (height, width), or (1, 1) without filters
    """
    if colour_filter is None:
        return np.ones((1, 1), np.float32)
    below = {"RG": "GB", "GR": "BG", "GB": "RG", "BG": "GR"}[colour_filter]
    shares = {colour: _share(sensor, spectrum, colour) for colour in "RGB"}
    cell = np.array([[shares[colour] for colour in row] for row in (colour_filter, below)], np.float32)
    height, width = sensor.shape
    return np.tile(cell, (-(-height // 2), -(-width // 2)))[:height, :width]


def _share(sensor: Sensor, spectrum: str, colour: str) -> float:
    filter_nm, transmittance = np.array(_TRANSMITTANCE[colour]).T
    bare = sensor.quantum_efficiency
    known = ((filter_nm[0], bare), (filter_nm[-1], bare)) if isinstance(bare, float) else bare
    sensor_nm, efficiency = np.array(known).T
    # Finer than both tables: a product of two straight lines is none.
    nm = np.arange(sensor_nm[0], sensor_nm[-1] + 1)
    filtered = np.interp(nm, sensor_nm, efficiency) * np.interp(nm, filter_nm, transmittance)
    both = tuple(zip(nm.tolist(), filtered.tolist(), strict=True))
    return electron_radiance_per_cd_m2(spectrum, both) / electron_radiance_per_cd_m2(spectrum, bare)


#: Margin of a patch of the simulated target around its region on each side, relative to the region.
_MARGIN_REL = 0.15

#: Luminance around the patches relative to the darkest of them: dark grey cardboard, which a calibration covers.
_BACKGROUND_REL = 4.0


class SimulatedTarget:
    """Exposures of the target, or of the lens cap; a frame source.

    The patches are shown together or one by one, as configured; in the latter case starting with the first.

    Parameters
    ----------
    configuration : SessionConfiguration
        Its patches, each with a nominal luminance.
    chain : ImagingChain
        Camera and lens.
    drifts : Drifts
        Temperature and light.
    seed : int
        Random seed of the noise.
    colour_filter : str or None
        First two pixels of the sensor's Bayer pattern; None for a monochrome one.

    Raises
    ------
    ConfigurationError
        If a patch has no nominal luminance, lies outside the sensor, or overlaps another shown with it.
    """

    def __init__(
        self,
        configuration: SessionConfiguration,
        chain: ImagingChain,
        drifts: Drifts,
        seed: int,
        colour_filter: str | None = None,
    ) -> None:
        self.covered = False
        self.luminance_cd_m2 = {patch.name: _nominal_cd_m2(patch) for patch in configuration.target.patches}
        self.shown: str | None = None
        self._chain = chain
        self._drifts = drifts
        self._seed = seed
        self._colour_filter = colour_filter
        height, width = chain.sensor.shape
        self._bounds = {patch.name: patch.region().bounds for patch in configuration.target.patches}
        for name, (_, _, x1, y1) in self._bounds.items():
            if x1 > width or y1 > height:
                raise ConfigurationError(
                    f"patch {name!r} reaches x {x1:g}, y {y1:g}, the simulated sensor has {width} x {height} "
                    "pixels: move it inside"
                )
        if configuration.target.presentation == "one by one":
            self.shown = next(iter(self._bounds))
        else:
            _refuse_overlap(self._bounds)
        self._keys = running()
        self._rendered: tuple[str | None, NDArray[np.float32]] | None = None
        self._kept: tuple[Hashable, NDArray[np.float32]] | None = None

    def show(self, patch: str) -> None:
        """Replace the shown patch; does nothing where all are shown together."""
        if self.shown is not None:
            self.shown = patch

    def scene(self) -> PatchScene:
        """Return the scene in front of the camera, by nominal luminance."""
        height, width = self._chain.sensor.shape
        surroundings: list[Patch] = []
        regions: list[Patch] = []
        for name, (x0, y0, x1, y1) in self._bounds.items():
            if self.shown not in (None, name):
                continue
            dx, dy = _MARGIN_REL * (x1 - x0), _MARGIN_REL * (y1 - y0)
            for drawn, mx, my in ((surroundings, dx, dy), (regions, 0.0, 0.0)):
                left, top = max(0, floor(x0 - mx)), max(0, floor(y0 - my))
                right, bottom = min(width, ceil(x1 + mx)), min(height, ceil(y1 + my))
                drawn.append(Patch(left, top, right - left, bottom - top, self.luminance_cd_m2[name]))
        background_cd_m2 = _BACKGROUND_REL * min(self.luminance_cd_m2.values())
        # Regions last, so that margins of close neighbours do not cover them.
        patches = (*surroundings, *regions)
        return PatchScene(width=width, height=height, background_cd_m2=background_cd_m2, patches=patches)

    def seen_cd_m2(self, patch: str) -> float:
        """Return the current luminance at the position of a patch, whichever patch is shown there."""
        return self._drifts.light_rel() * self.luminance_cd_m2[self.shown or patch]

    @property
    def state(self) -> Hashable:
        """State that the pixels depend on besides exposure and gain, in steps of 0.1 % of light and 0.1 degrees C."""
        drifts = self._drifts
        return self.covered, self.shown, round(drifts.light_rel(), 3), round(drifts.temperature_c(), 1), self._keys

    def announce(self, series: str, first: int, n_before: int) -> None:
        """Give the next exposures the noise of a series; see `labcdp.drivers.simulated.noise.announced`."""
        self._keys = announced(series, first, n_before)

    def next_key(self) -> tuple[int, ...]:
        """Return the key of the noise of the next exposure."""
        return next(self._keys)

    def expose(self, exposure_s: float, gain_db: float, key: tuple[int, ...]) -> NDArray[np.uint16]:
        """Render an exposure, with the noise of a key."""
        from .noise_kernel import QUANTILES, draw_exposure

        sensor = self._chain.sensor
        noise = np.random.SeedSequence(self._seed, spawn_key=key).generate_state(1, np.uint64)[0]
        return draw_exposure(
            self._mean_e(exposure_s),
            sensor.fixed_pattern.offset_e,
            (sensor.full_well_e, 2.0**sensor.bits - 1),
            sensor.read_noise_e,
            sensor.system_gain_dn_per_e(gain_db),
            sensor.black_level_dn,
            noise,
            QUANTILES,
        )

    def _mean_e(self, exposure_s: float) -> NDArray[np.float32]:
        """Mean electrons of each pixel, kept until exposure, light or temperature change."""
        shown, light_rel, temperature_c = self.shown, self._drifts.light_rel(), self._drifts.temperature_c()
        kind = self.covered, shown, exposure_s, light_rel, temperature_c
        if self._kept is None or self._kept[0] != kind:
            sensor, pattern = self._chain.sensor, self._chain.sensor.fixed_pattern
            mean_e = pattern.dark_current * np.float32(sensor.dark_current_at(temperature_c) * exposure_s)
            if not self.covered:
                mean_e += self._electron_rate(shown) * pattern.photo_response * np.float32(light_rel * exposure_s)
            self._kept = kind, mean_e
        return self._kept[1]

    def _electron_rate(self, shown: str | None) -> NDArray[np.float32]:
        if self._rendered is None or self._rendered[0] != shown:
            filters = mosaic(self._chain.sensor, self._chain.spectrum, self._colour_filter)
            self._rendered = shown, filters * self._chain.electron_rate(self.scene().luminance_map())
        return self._rendered[1]


def _refuse_overlap(bounds: dict[str, tuple[float, float, float, float]]) -> None:
    for (name, (ax0, ay0, ax1, ay1)), (other, (bx0, by0, bx1, by1)) in combinations(bounds.items(), 2):
        if ceil(ax1) > floor(bx0) and ceil(bx1) > floor(ax0) and ceil(ay1) > floor(by0) and ceil(by1) > floor(ay0):
            raise ConfigurationError(
                f"patches {name!r} and {other!r} overlap, so the simulated target cannot show both: move one, or say "
                'presentation = "one by one"'
            )


def _nominal_cd_m2(patch: PatchConfiguration) -> float:
    if patch.nominal_luminance_cd_m2 is None:
        raise ConfigurationError(
            f"patch {patch.name!r} has no nominal_luminance_cd_m2: give one, the simulated target shows it"
        )
    return patch.nominal_luminance_cd_m2
