"""Sensor: from the illuminance on the pixels to digital numbers, after EMVA 1288."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import hypot, sqrt
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.disk.files import shown
from ..core.errors import InputError, naming
from ..core.photometry import QuantumEfficiency, as_quantum_efficiency, electron_radiance_per_cd_m2
from .captures import CaptureSettings, ColourPlane, Photodiode, checked_parts
from .fixed_pattern import (
    FixedPattern,
    Stream,
    block_generator,
    draw_dark_current,
    draw_offset,
    draw_photo_response,
    for_each_block,
)
from .parameters import (
    COUNT,
    GAIN,
    TEMPERATURE,
    THREADS,
    Bits,
    Doubling,
    ElectronRate,
    FullWell,
    Noise,
    Number,
    PixelPitch,
    Ratio,
    Sized,
    SystemGain,
    Temperature,
)
from .signal import Capture, Context, ExposureSettings, Signal, check_shape, settings_of

FloatMap = NDArray[np.float32]
FloatArray = NDArray[np.floating[Any]]


def collect_electrons(
    mean_e: FloatMap, full_well_e: float, rng: np.random.Generator, largest_well_e: float | None = None
) -> FloatMap:
    """Draw the whole electrons each pixel holds, up to the full well (up to 1e7: float32 holds every count exactly).

    Readouts of one charge draw the same electrons, from equal generators and with the same `largest_well_e`, that of
    the one which sees most of them.
    """
    # 30 sigma above the full well the outcome is certain, and the Poisson sampler has a largest mean.
    certain_e = np.float32(4 * (full_well_e if largest_well_e is None else largest_well_e) + 1000)
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
    photodiodes : tuple of Photodiode
        Further photodiodes of each pixel, beside the one that the values above are of.
    captures : tuple of CaptureSettings
        Captures of each exposure, that differ in photodiode, gain or time; none for one as above.
    colour_filter : str
        ``RGGB``, ``RCCB`` or ``RCCC``, the filters of the first 2 x 2 pixels, these shifted, or ``RGB-IR``; empty for a
        monochrome sensor.
    planes : tuple of ColourPlane
        Quantum efficiency behind each filter, which then stands for that of the sensor.
    plane : str
        Plane that is looked at, as if all pixels were of it; empty for each pixel as it is. ``luminance`` for the
        luminance that is combined of a cell of 2 x 2 pixels, as if each pixel were such a cell.

    Raises
    ------
    InputError
        If a value is out of its range, or captures name what there is not.

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
    read_noise_e: Noise
    dark_current_e_s: ElectronRate
    bits: Bits
    black_level_dn: float = 0.0
    reference_temperature_c: Temperature = 25.0
    doubling_temperature_c: Doubling = 8.0
    # A gain of 0 is ten sigma away.
    prnu_rel: Annotated[float, Ratio("(a fraction)", 0, 0.1)] = 0.0
    dsnu_e: Noise = 0.0
    column_dsnu_e: Noise = 0.0
    row_dsnu_e: Noise = 0.0
    dsnu_e_s: ElectronRate = 0.0
    device_seed: Annotated[int, COUNT] = 0
    photodiodes: tuple[Photodiode, ...] = field(default=(), metadata={"table": Photodiode})
    captures: tuple[CaptureSettings, ...] = field(default=(), metadata={"table": CaptureSettings})
    colour_filter: str = ""
    planes: tuple[ColourPlane, ...] = field(default=(), metadata={"table": ColourPlane})
    plane: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_parts(self)
        Number("DN", 0, 2**self.bits - 1).check("black_level_dn", self.black_level_dn)
        if self.dsnu_e_s > 0 and self.dark_current_e_s == 0:
            raise InputError(
                f"dsnu_e_s is {self.dsnu_e_s} e⁻/s, but dark_current_e_s is 0: a dark current that varies has a "
                "mean above 0",
                key="dsnu_e_s",
            )
        object.__setattr__(self, "quantum_efficiency", as_quantum_efficiency(self.quantum_efficiency))
        for capture in self.captures:
            with naming(f"capture {shown(capture.name)}"):
                _alone(self, capture)

    @cached_property
    def fixed_pattern(self) -> FixedPattern:
        """The pattern of this device, drawn when first needed (12 bytes a pixel at the most)."""
        return self.pattern_of(0, 0)

    def pattern_of(self, photodiode: int, readout: int) -> FixedPattern:
        """Return the pattern of a photodiode and a readout by their numbers, with the spreads of this sensor."""
        spread_rel = self.dsnu_e_s / self.dark_current_e_s if self.dsnu_e_s else 0.0
        return FixedPattern(
            draw_photo_response(self.shape, self.device_seed, self.prnu_rel, photodiode),
            draw_dark_current(self.shape, self.device_seed, spread_rel, photodiode),
            draw_offset(self.shape, self.device_seed, self.dsnu_e, self.column_dsnu_e, self.row_dsnu_e, readout),
        )

    def _photodiode(self, name: str) -> tuple[int, Photodiode | None]:
        """Return number and values of a photodiode; 0 and None for that of the sensor itself."""
        found = ((number, part) for number, part in enumerate(self.photodiodes, 1) if part.name == name)
        return next(found, (0, None))

    def capture_models(self, settings: ExposureSettings, spectrum: str) -> tuple[CaptureModel, ...]:
        """Return what is taken of a scene: the captures of this sensor, or without any the exposures of the settings.

        Parameters
        ----------
        settings : ExposureSettings
            Exposure settings.
        spectrum : str
            Spectrum of the light, of which photodiodes with other quantum efficiencies have other shares.

        Raises
        ------
        InputError
            If there are captures and several exposure times.
        """
        if not self.captures:
            gain_db, temperature_c = settings.gain_db, settings.temperature_c
            return tuple(
                CaptureModel(self, time, gain_db, temperature_c, index, self.full_well_e, time)
                for index, time in enumerate(settings.exposure_s)
            )
        if len(settings.exposure_s) > 1:
            raise InputError(
                f"exposure_s has {len(settings.exposure_s)} times and the sensor captures of its own: give one time, "
                "and exposure_s of each capture that has another",
                key="exposure_s",
            )
        return self._own_models(settings, spectrum)

    def _own_models(self, settings: ExposureSettings, spectrum: str) -> tuple[CaptureModel, ...]:
        sensors = [_alone(self, capture) for capture in self.captures]
        times = [capture.exposure_s or settings.exposure_s[0] for capture in self.captures]
        charges = [
            (capture.photodiode, time, capture.start_s) for capture, time in zip(self.captures, times, strict=True)
        ]
        readouts = [(c.photodiode, sensor.k_dn_per_e) for c, sensor in zip(self.captures, sensors, strict=True)]
        own_e_lx_s = self.electrons_per_lx_s(spectrum)
        models = []
        for index, (capture, sensor, time) in enumerate(zip(self.captures, sensors, times, strict=True)):
            number, photodiode = self._photodiode(capture.photodiode)
            share = 1.0 if photodiode is None else sensor.electrons_per_lx_s(spectrum) / own_e_lx_s
            largest_e = max(s.full_well_e for s, c in zip(sensors, charges, strict=True) if c == charges[index])
            readout = list(dict.fromkeys(readouts)).index(readouts[index])
            first = charges.index(charges[index])
            sensitivity_s = time * share * sensor.k_dn_per_e / self.k_dn_per_e
            models.append(
                CaptureModel(
                    sensor,
                    time,
                    settings.gain_db,
                    settings.temperature_c,
                    first,
                    largest_e,
                    sensitivity_s,
                    number,
                    readout,
                    share,
                )
            )
        return tuple(models)

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
        model = CaptureModel(self, exposure_s, gain_db, temperature_c, exposure_index, self.full_well_e, exposure_s)
        return model.expose(self._checked_rate(electron_rate), seed, exposure_index, threads)

    def capture(self, signal: Signal, context: Context, index: int) -> Capture:
        """Take the exposure or capture `index` of the context's settings; see `SensorModel.capture`."""
        check_shape(signal, self.shape)
        model = self.capture_models(settings_of(context), context.spectrum)[index]
        rate = model.sensor._checked_rate(model.sensor.electron_rate(signal.values, context.spectrum))
        return model.described(model.expose(rate, context.seed, index, context.threads), context.spectrum)

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


@dataclass(frozen=True, eq=False)
class CaptureModel:
    """A capture with all that it has of sensor, photodiode and exposure settings.

    Parameters
    ----------
    sensor : Sensor
        A sensor that takes this capture only.
    exposure_s, gain_db, temperature_c : float
        Exposure time in seconds, gain in dB and temperature of the sensor in degrees Celsius.
    charge : int
        Index of the first capture that reads the same charge; its own if there is none before.
    charge_well_e : float
        Largest full well of the captures that read this charge, electrons.
    sensitivity_s : float
        Signal in DN over that of a second with photodiode and K of the whole sensor.
    photodiode, readout : int
        Numbers of photodiode and readout, whose fixed patterns it has.
    light_share : float
        Electrons per second over those of the photodiode of the whole sensor.
    """

    sensor: Sensor
    exposure_s: float
    gain_db: float
    temperature_c: float
    charge: int
    charge_well_e: float
    sensitivity_s: float
    photodiode: int = 0
    readout: int = 0
    light_share: float = 1.0

    @property
    def settings(self) -> ExposureSettings:
        """Exposure settings of this capture alone."""
        return ExposureSettings((self.exposure_s,), self.gain_db, self.temperature_c)

    @property
    def k_dn_per_e(self) -> float:
        """Overall system gain at this gain."""
        return self.sensor.system_gain_dn_per_e(self.gain_db)

    @property
    def dark_e(self) -> float:
        """Mean dark electrons."""
        return self.sensor.dark_current_at(self.temperature_c) * self.exposure_s

    def expose(
        self, electron_rate: NDArray[np.float32], seed: int, index: int, threads: int | None = None
    ) -> NDArray[np.uint16]:
        """Take this capture.

        Parameters
        ----------
        electron_rate : ndarray of float32, shape (height, width)
            Mean photo-electrons per second of each pixel's photodiode.
        seed, index : int
            Seed of the run, and number of this capture; they fix the noise.
        threads : int or None
            Number of threads, None for one a processor.
        """
        sensor, k_dn_per_e, dark_e = self.sensor, self.k_dn_per_e, np.float32(self.dark_e)
        pattern = sensor.pattern_of(self.photodiode, self.readout)
        dn = np.empty(sensor.shape, dtype=np.uint16)

        def expose_rows(block: int, rows: slice) -> None:
            rng = block_generator(seed, Stream.NOISE, self.charge, block)
            mean_e = electron_rate[rows] * pattern.photo_response[rows]
            mean_e *= np.float32(self.exposure_s)
            mean_e += dark_e * pattern.dark_current[rows]
            electrons = collect_electrons(mean_e, sensor.full_well_e, rng, self.charge_well_e)
            if index != self.charge:
                # The charge is drawn as for its first readout, the noise of reading is another.
                rng = block_generator(seed, Stream.NOISE, index, block)
            signal_e = read_out(electrons, pattern.offset_e[rows], sensor.read_noise_e, rng)
            dn[rows] = digitise(signal_e, k_dn_per_e, sensor.black_level_dn, sensor.bits)

        for_each_block(sensor.height, expose_rows, threads)
        return dn

    def described(self, dn: NDArray[Any], spectrum: str) -> Capture:
        """Return digital numbers of this capture with its scales."""
        sensor, gain_db = self.sensor, self.gain_db
        return Capture(
            dn=dn,
            exposure_s=self.exposure_s,
            black_level_dn=sensor.black_level_dn,
            dark_dn=sensor.black_level_dn + self.k_dn_per_e * self.dark_e,
            dn_per_lx=self.k_dn_per_e * sensor.electrons_per_lx_s(spectrum) * self.exposure_s,
            saturation_dn=sensor.saturation_dn(gain_db),
            k_dn_per_e=self.k_dn_per_e,
            dark_noise_dn=sensor.dark_noise_dn(gain_db),
            sensitivity_s=self.sensitivity_s,
        )


@lru_cache(maxsize=256)
def _alone(sensor: Sensor, capture: CaptureSettings) -> Sensor:
    """Return a sensor that takes this capture only."""
    values: dict[str, Any] = {"photodiodes": (), "captures": (), "colour_filter": "", "planes": (), "plane": ""}
    _, photodiode = sensor._photodiode(capture.photodiode)
    if photodiode is not None:
        own = photodiode.quantum_efficiency
        efficiency = sensor.quantum_efficiency if own is None else own
        values["quantum_efficiency"] = scaled_efficiency(efficiency, photodiode.light_share)
        values |= _stated(photodiode, "full_well_e", "dark_current_e_s", "prnu_rel", "dsnu_e_s")
        dark_e_s = values.get("dark_current_e_s")
        if dark_e_s is not None and "dsnu_e_s" not in values and sensor.dsnu_e_s > 0:
            values["dsnu_e_s"] = sensor.dsnu_e_s * dark_e_s / sensor.dark_current_e_s
    values |= _stated(capture, "k_dn_per_e", "read_noise_e", "full_well_e", "dsnu_e", "bits", "black_level_dn")
    return replace(sensor, **values)


def _stated(part: Any, *names: str) -> dict[str, Any]:
    """Return the values of a part that are not None."""
    return {name: getattr(part, name) for name in names if getattr(part, name) is not None}


def scaled_efficiency(efficiency: QuantumEfficiency, share: float) -> QuantumEfficiency:
    """Return a quantum efficiency times a share."""
    if isinstance(efficiency, float):
        return efficiency * share
    return tuple((wavelength_nm, value * share) for wavelength_nm, value in efficiency)
