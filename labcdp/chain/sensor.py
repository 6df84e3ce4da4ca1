"""Sensor: from the illuminance on the pixels to digital numbers, after EMVA 1288."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot, sqrt
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.photometry import QuantumEfficiency, as_quantum_efficiency, electron_radiance_per_cd_m2
from .fixed_pattern import (
    FixedPattern,
    Stream,
    block_generator,
    draw_dark_current,
    draw_offset,
    draw_photo_response,
    for_each_block,
)
from .parameters import COUNT, GAIN, TEMPERATURE, THREADS, Bits, ElectronRate, Number, Ratio, Sized, Temperature
from .signal import Capture, Context, Signal, check_shape, settings_of

FloatMap = NDArray[np.float32]
FloatArray = NDArray[np.floating[Any]]


def collect_electrons(mean_e: FloatMap, full_well_e: float, rng: np.random.Generator) -> FloatMap:
    """Draw the whole electrons each pixel holds, up to the full well (up to 1e7: float32 holds every count exactly)."""
    # 30 sigma above the full well the outcome is certain, and the Poisson sampler has a largest mean.
    certain_e = np.float32(4 * full_well_e + 1000)
    electrons = rng.poisson(np.minimum(mean_e, certain_e)).astype(np.float32)
    return np.minimum(electrons, np.float32(full_well_e), out=electrons)


def read_out(electrons: FloatMap, offset_e: FloatMap, read_noise_e: float, rng: np.random.Generator) -> FloatMap:
    """Add the fixed offset and the normal read noise, both in electrons."""
    signal = rng.standard_normal(electrons.shape, dtype=np.float32)
    signal *= np.float32(read_noise_e)
    signal += electrons
    signal += offset_e
    return signal


def digitise(signal_e: FloatMap, k_dn_per_e: float, black_level_dn: float, bits: int) -> NDArray[np.uint16]:
    """Digital numbers K e + black level, rounded to the nearest and clipped to 0 .. 2^bits - 1.

    Rounding adds a variance of 1/12 DN^2 and no bias.
    """
    dn: NDArray[Any] = signal_e * np.float32(k_dn_per_e)
    dn += np.float32(black_level_dn)
    np.rint(dn, out=dn)
    np.clip(dn, 0, 2**bits - 1, out=dn)
    return dn.astype(np.uint16)


#: Variance of rounding to whole digital numbers, DN^2; EMVA 1288 Release 3.1, section 2.2.
QUANTISATION_VARIANCE_DN2 = 1 / 12

# Ranges are those of real cameras with a margin, so that a value in another unit is outside.
PixelPitch: TypeAlias = Annotated[float, Number("m", 1e-7, 2e-4)]
# Wells are often stated in ke-; float32 holds whole numbers up to 1.6e7.
FullWell: TypeAlias = Annotated[float, Number("e⁻", 25, 1e7)]
SystemGain: TypeAlias = Annotated[float, Number("DN/e⁻", 1e-4, 1e4)]
Doubling: TypeAlias = Annotated[float, Number("K", 1, 100)]
_Noise: TypeAlias = Annotated[float, Number("e⁻", 0, 1e4)]


@dataclass(frozen=True, kw_only=True)
class Sensor(Sized):
    """A monochrome image sensor with its converter: the linear camera model of EMVA 1288.

    Parameters
    ----------
    pixel_pitch_m : float
        Distance of pixel centres in metres; the quantum efficiency includes the fill factor.
    width, height : int
        Size in pixels.
    quantum_efficiency : float or tuple of (float, float)
        Electrons per photon: a fraction, or (wavelength_nm, fraction) pairs.
    full_well_e : float
        Most electrons a pixel can hold.
    k_dn_per_e : float
        Overall system gain K at 0 dB, DN per electron.
    read_noise_e : float
        Standard deviation of the temporal noise of reading, electrons.
    dark_current_e_s : float
        Mean dark current at `reference_temperature_c`, electrons per second and pixel.
    bits : int
        Bits of the converter, 1 to 16.
    black_level_dn : float
        DN of dark signal without dark current.
    reference_temperature_c, doubling_temperature_c : float
        Temperature of `dark_current_e_s`, and the difference that doubles it.
    prnu_rel : float
        Standard deviation of the pixels' gains over their mean (PRNU).
    dsnu_e, column_dsnu_e, row_dsnu_e : float
        Standard deviation of the offsets of pixels, columns and rows, electrons (DSNU).
    dsnu_e_s : float
        Standard deviation of the pixels' dark currents at `reference_temperature_c`, electrons per second.
    device_seed : int
        Number of the specimen: sensors that differ only in it have different fixed patterns.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import Chain
    >>> ((name, sensor),) = Chain.load("manta-g505").sensors
    >>> sensor.bits, sensor.full_well_e
    (12, 7000.0)
    """

    #: Standard deviations of a full pixel between its full well and the DN from which it counts as saturated.
    SPREADS_BELOW_FULL: ClassVar[float] = 6.0

    pixel_pitch_m: PixelPitch
    quantum_efficiency: QuantumEfficiency
    full_well_e: FullWell
    k_dn_per_e: SystemGain
    read_noise_e: _Noise
    dark_current_e_s: ElectronRate
    bits: Bits
    black_level_dn: float = 0.0
    reference_temperature_c: Temperature = 25.0
    doubling_temperature_c: Doubling = 8.0
    # A gain of 0 is ten sigma away.
    prnu_rel: Annotated[float, Ratio("(a fraction)", 0, 0.1)] = 0.0
    dsnu_e: _Noise = 0.0
    column_dsnu_e: _Noise = 0.0
    row_dsnu_e: _Noise = 0.0
    dsnu_e_s: ElectronRate = 0.0
    device_seed: Annotated[int, COUNT] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        Number("DN", 0, 2**self.bits - 1).check("black_level_dn", self.black_level_dn)
        if self.dsnu_e_s > 0 and self.dark_current_e_s == 0:
            raise InputError(
                f"dsnu_e_s is {self.dsnu_e_s} e⁻/s, but dark_current_e_s is 0: a dark current that varies has a "
                "mean above 0",
                key="dsnu_e_s",
            )
        object.__setattr__(self, "quantum_efficiency", as_quantum_efficiency(self.quantum_efficiency))

    @cached_property
    def fixed_pattern(self) -> FixedPattern:
        """The pattern of this device, drawn when first needed (12 bytes a pixel at the most)."""
        spread_rel = self.dsnu_e_s / self.dark_current_e_s if self.dsnu_e_s else 0.0
        return FixedPattern(
            draw_photo_response(self.shape, self.device_seed, self.prnu_rel),
            draw_dark_current(self.shape, self.device_seed, spread_rel),
            draw_offset(self.shape, self.device_seed, self.dsnu_e, self.column_dsnu_e, self.row_dsnu_e),
        )

    def system_gain_dn_per_e(self, gain_db: float = 0.0) -> float:
        """K at a gain in dB: K(0 dB) * 10^(gain / 20); raises InputError beyond 100 dB."""
        GAIN.check("gain_db", gain_db)
        return float(self.k_dn_per_e * 10 ** (gain_db / 20))

    def dark_current_at(self, temperature_c: float) -> float:
        """Mean dark current in e-/s: mu(T) = mu_ref 2^((T - T_ref) / T_d), EMVA 1288 Release 3.1, section 3.2.

        Raises InputError if the temperature is not from -100 to 200 degC.
        """
        TEMPERATURE.check("temperature_c", temperature_c)
        doublings = (temperature_c - self.reference_temperature_c) / self.doubling_temperature_c
        return float(self.dark_current_e_s * 2**doublings)

    def dark_noise_dn(self, gain_db: float = 0.0) -> float:
        """Temporal noise at zero exposure, in DN: read noise and rounding."""
        return hypot(self.system_gain_dn_per_e(gain_db) * self.read_noise_e, sqrt(QUANTISATION_VARIANCE_DN2))

    def saturation_dn(self, gain_db: float = 0.0) -> float:
        """DN from which a pixel counts as saturated: the converter's end, or below the full well.

        A full pixel still has the noise of reading and its offset; all but 1 in 10^9 lie above the limit. A merge takes
        those below for pixels that are not full.
        """
        spread_e = hypot(self.read_noise_e, self.dsnu_e, self.column_dsnu_e, self.row_dsnu_e)
        full_e = self.full_well_e - self.SPREADS_BELOW_FULL * spread_e
        full_dn = self.black_level_dn + self.system_gain_dn_per_e(gain_db) * full_e
        return float(min(2**self.bits - 1, full_dn))

    def electrons_per_lx_s(self, spectrum: str) -> float:
        """Photo-electrons one pixel collects in a second at 1 lux.

        Raises
        ------
        InputError
            If the spectrum is not known, or the sensor sees nothing of it.
        """
        electrons = electron_radiance_per_cd_m2(spectrum, self.quantum_efficiency) * self.pixel_pitch_m**2
        if electrons == 0:
            raise InputError(
                f"quantum_efficiency is 0 wherever {spectrum!r} has light: give values there", key="quantum_efficiency"
            )
        return electrons

    def electron_rate(self, illuminance_lx: FloatArray, spectrum: str) -> FloatArray:
        """Mean photo-electrons per second and pixel, shape as the illuminance in lux."""
        return illuminance_lx * self.electrons_per_lx_s(spectrum)

    def expose(
        self,
        electron_rate: ArrayLike,
        exposure_s: float,
        gain_db: float = 0.0,
        *,
        temperature_c: float,
        seed: int,
        exposure_index: int,
        threads: int | None = None,
    ) -> NDArray[np.uint16]:
        """Take one exposure.

        Parameters
        ----------
        electron_rate : array_like, shape (height, width), or float
            Mean photo-electrons per second for each pixel, or for all; 0.0 is the lens cap.
        exposure_s : float
            Exposure time in seconds.
        gain_db : float
            Analogue gain in dB.
        temperature_c : float
            Temperature of the sensor in degrees Celsius.
        seed, exposure_index : int
            Together they fix the noise: the same two give the same exposure, on any number of threads.
        threads : int or None
            Number of threads, None for one a processor.

        Returns
        -------
        ndarray of uint16, shape (height, width)
            Digital numbers.

        Raises
        ------
        InputError
            If a value is out of its range, or the rate has another shape than the sensor.
        """
        Number("s", 0, above=True).check("exposure_s", exposure_s)
        COUNT.check("seed", seed)
        COUNT.check("exposure_index", exposure_index)
        THREADS.check("threads", 1 if threads is None else threads)
        rate = self._checked_rate(electron_rate)
        k_dn_per_e = self.system_gain_dn_per_e(gain_db)
        dark_e = np.float32(self.dark_current_at(temperature_c) * exposure_s)
        pattern = self.fixed_pattern
        dn = np.empty(self.shape, dtype=np.uint16)

        def expose_rows(block: int, rows: slice) -> None:
            rng = block_generator(seed, Stream.NOISE, exposure_index, block)
            mean_e = rate[rows] * pattern.photo_response[rows]
            mean_e *= np.float32(exposure_s)
            mean_e += dark_e * pattern.dark_current[rows]
            electrons = collect_electrons(mean_e, self.full_well_e, rng)
            signal_e = read_out(electrons, pattern.offset_e[rows], self.read_noise_e, rng)
            dn[rows] = digitise(signal_e, k_dn_per_e, self.black_level_dn, self.bits)

        for_each_block(self.height, expose_rows, threads)
        return dn

    def capture(self, signal: Signal, context: Context, index: int) -> Capture:
        """Take the exposure `index` of the context's settings; see `SensorModel.capture`."""
        check_shape(signal, self.shape)
        settings = settings_of(context)
        exposure_s, gain_db, temperature_c = settings.exposure_s[index], settings.gain_db, settings.temperature_c
        k_dn_per_e = self.system_gain_dn_per_e(gain_db)
        dn = self.expose(
            self.electron_rate(signal.values, context.spectrum),
            exposure_s,
            gain_db,
            temperature_c=temperature_c,
            seed=context.seed,
            exposure_index=index,
            threads=context.threads,
        )
        return Capture(
            dn=dn,
            exposure_s=exposure_s,
            black_level_dn=self.black_level_dn,
            dark_dn=self.black_level_dn + k_dn_per_e * self.dark_current_at(temperature_c) * exposure_s,
            dn_per_lx=k_dn_per_e * self.electrons_per_lx_s(context.spectrum) * exposure_s,
            saturation_dn=self.saturation_dn(gain_db),
            k_dn_per_e=k_dn_per_e,
            dark_noise_dn=self.dark_noise_dn(gain_db),
        )

    def _checked_rate(self, electron_rate: ArrayLike) -> NDArray[np.float32]:
        rate = np.asarray(electron_rate, dtype=np.float32)
        if rate.shape not in ((), self.shape):
            raise InputError(
                f"electron_rate has the shape {rate.shape}, the sensor has {self.shape}: give one value for each "
                "pixel, or a single number"
            )
        low, high = rate.min(), rate.max()
        if not (low >= 0 and high < np.inf):
            raise InputError(f"electron_rate is from {low:g} to {high:g} e⁻/s: give finite numbers of at least 0")
        return np.broadcast_to(rate, self.shape)
