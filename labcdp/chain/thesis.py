"""Windscreen and sensor of the 2018 thesis, with their deviations from physics, to repeat its published values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.photometry import electron_radiance_per_cd_m2
from .fixed_pattern import Stream, block_generator
from .optics import Glare, Windscreen
from .parameters import (
    Bits,
    Doubling,
    ElectronRate,
    Fraction,
    FullWell,
    Parameters,
    PixelPitch,
    Sized,
    SystemGain,
    Temperature,
)
from .signal import Capture, Context, Signal, check_shape, settings_of


@dataclass(frozen=True)
class ThesisWindscreen(Parameters):
    """The windscreen of the 2018 thesis, whose inverse subtracts the glare and does not quite undo the loss.

    It takes off glare / transmittance and does not divide by the transmittance, so a luminance L comes back as
    transmittance * L + glare * (transmittance - 1 / transmittance). The published CDP values need it.

    Parameters
    ----------
    transmittance, glare_fraction : float
        As those of `Windscreen`.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import ThesisWindscreen
    >>> ThesisWindscreen(transmittance=0.8)
    ThesisWindscreen(transmittance=0.8, glare_fraction=0.0)
    """

    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "luminance"

    transmittance: Fraction
    glare_fraction: Glare = 0.0

    def process(self, signal: Signal, context: Context) -> Signal:
        """Luminance behind the windscreen, with the thesis' inverse."""
        taken_off_cd_m2 = self.glare_fraction * signal.scene_mean() / self.transmittance
        behind = Windscreen(self.transmittance, self.glare_fraction).process(signal, context)
        return replace(behind, to_luminance=lambda values: signal.to_luminance(values - taken_off_cd_m2))


@dataclass(frozen=True, kw_only=True)
class ThesisSensor(Sized):
    """Sensor model of L. Ebbert, Implementierung von CDP, HS Düsseldorf, 2018, section 3.2.1, eq. 3.2 and 3.3.

    It differs from EMVA 1288 (`Sensor`) in this: photons have no noise of their own; the dark noise is drawn on the
    rate and then scaled with temperature and time; the fixed pattern is drawn anew for each exposure; there is no
    read noise; the converter cuts off instead of rounding and ends at 2^bits instead of 2^bits - 1.

    Parameters
    ----------
    pixel_pitch_m : float
        Distance of pixel centres in metres.
    width, height : int
        Size in pixels.
    quantum_efficiency : float
        Electrons per photon.
    full_well_e : float
        Most electrons a pixel can hold.
    k_dn_per_e : float
        K, DN per electron, at 0 dB.
    dark_current_e_s, row_dark_current_e_s, column_dark_current_e_s : float
        Mean dark current of pixels, rows and columns at the reference temperature, electrons per second; each is
        a Poisson process of one second. (The thesis prints electrons; its program uses electrons per second.)
    doubling_temperature_c : float
        Temperature difference that doubles the dark current.
    bits : int
        Bits of the converter, 1 to 16.
    reference_temperature_c : float
        Temperature of the dark currents.
    pixel_pattern_e_s, row_pattern_e_s, column_pattern_e_s : float
        Standard deviation of the fixed pattern of pixels, rows and columns, electrons per second, normal.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import Chain, ThesisSensor
    >>> ((_, sensor),) = Chain.load("thesis-2018").sensors
    >>> isinstance(sensor, ThesisSensor), sensor.pixel_pattern_e_s
    (True, 5)
    """

    takes: ClassVar[str] = "illuminance"

    pixel_pitch_m: PixelPitch
    quantum_efficiency: Fraction
    full_well_e: FullWell
    k_dn_per_e: SystemGain
    dark_current_e_s: ElectronRate
    row_dark_current_e_s: ElectronRate
    column_dark_current_e_s: ElectronRate
    doubling_temperature_c: Doubling
    bits: Bits
    reference_temperature_c: Temperature = 25.0
    pixel_pattern_e_s: ElectronRate = 5.0
    row_pattern_e_s: ElectronRate = 5.0
    column_pattern_e_s: ElectronRate = 10.0

    def capture(self, signal: Signal, context: Context, index: int) -> Capture:
        """Take the exposure `index` of the context's settings; its inverse takes off the mean dark signal drawn."""
        check_shape(signal, self.shape)
        settings = settings_of(context)
        exposure_s = settings.exposure_s[index]
        electrons_per_lx = (
            electron_radiance_per_cd_m2(context.spectrum, self.quantum_efficiency) * self.pixel_pitch_m**2 * exposure_s
        )
        k_dn_per_e = self.k_dn_per_e * 10 ** (settings.gain_db / 20)
        doublings = (settings.temperature_c - self.reference_temperature_c) / self.doubling_temperature_c
        rng = block_generator(context.seed, Stream.NOISE, index, 0)
        dark_e = self._dark_current_e_s(rng) * (2**doublings * exposure_s)
        electrons = np.minimum(signal.values * electrons_per_lx + dark_e, self.full_well_e)
        return Capture(
            dn=np.clip(np.trunc(electrons * k_dn_per_e), 0, 2**self.bits).astype(np.int32),
            exposure_s=exposure_s,
            black_level_dn=0.0,
            dark_dn=k_dn_per_e * float(dark_e.mean()),
            dn_per_lx=k_dn_per_e * electrons_per_lx,
            saturation_dn=float(min(2**self.bits, np.trunc(k_dn_per_e * self.full_well_e))),
            k_dn_per_e=k_dn_per_e,
            dark_noise_dn=k_dn_per_e * float(dark_e.std()),
        )

    def _dark_current_e_s(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw the dark current of each pixel at the reference temperature, patterns included."""
        pixels = rng.normal(rng.poisson(self.dark_current_e_s, self.shape), self.pixel_pattern_e_s)
        rows = rng.normal(rng.poisson(self.row_dark_current_e_s, (self.height, 1)), self.row_pattern_e_s)
        columns = rng.normal(rng.poisson(self.column_dark_current_e_s, (1, self.width)), self.column_pattern_e_s)
        total: NDArray[np.float64] = pixels + rows + columns
        return total
