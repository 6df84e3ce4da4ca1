"""Parameters of a camera's twin with standard uncertainties, also with the corrections of its frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np

from ...calibration import DarkModel
from ...calibration.frames.rounding import mean_before_rounding
from ...calibration.sensor.dark_library import DarkLibrary
from ...chain import Sensor
from ...core.quantity import Quantity
from ...core.result import Finding
from ...core.vignetting import FlatField

#: Largest PRNU of a sensor in a chain.
MOST_PRNU_REL = 0.1
#: Variance of the dark signal above which the steps of the converter are dithered.
_COARSE_DN2 = 2.0
#: Values of the sensor of a chain that are parameters as they are.
_OF_SENSOR = ("k_dn_per_e", "read_noise_e", "dark_current_e_s", "doubling_temperature_c", "full_well_e",
              "dsnu_e", "column_dsnu_e", "row_dsnu_e")  # fmt: skip
#: Number of classes of pixels by dark signal, and the golden ratio.
_DARK_KINDS, _GOLDEN = 21, (1 + sqrt(5)) / 2


@dataclass(frozen=True)
class TwinParameters:
    """Parameters of a camera for an imaging chain, at the gain of the session.

    Parameters
    ----------
    k_dn_per_e : Quantity
        Overall system gain K.
    read_noise_dn : Quantity
        Temporal noise of a pixel at zero exposure, in DN before rounding.
    prnu_rel : Quantity
        Standard deviation of the pixels' gains over their mean.
    dsnu_dn, row_dsnu_dn, column_dsnu_dn : Quantity
        Standard deviation of the offsets of pixels, rows and columns at zero exposure.
    dsnu_dn_s : Quantity
        Standard deviation of the pixels' dark currents, DN per second.
    dark : DarkModel
        d(t), the mean dark signal.
    responsivity : Quantity
        R, DN s^-1 / (cd m^-2) on the optical axis. Its uncertainty is relative to the session's meter, whose scale
        error is common to R and the readings and cancels.
    dark_current_e_s : Quantity
        Mean dark current at `temperature_c`; 0 if the dark signal does not grow with the exposure.
    efficiency, full_well_e, doubling_temperature_c : Quantity
        Quantum efficiency times transmittance of the lens (electrons per photon that reaches the lens); full well in
        electrons (the note says if it is only a lower bound); difference of temperature that doubles the dark current.
    temperature_c : float
        Temperature of the sensor.
    transmittance : float
        The part of `efficiency` assigned to the lens.
    bits, pixel_pitch_m, gain_db : int, float, float
        Bits of the converter, distance of pixel centres, and gain of the session.
    findings : tuple of Finding
        Findings about effects that the twin cannot represent, or assumes.
    library : DarkLibrary or None
        Subtracted from the frames at the exposures where it removes more than it adds. Its own noise, the same in every
        frame, remains.
    flat_field : FlatField or None
        Removes the PRNU except for the noise of its own pixels.
    pattern_taken_off_dn : float
        Standard deviation of a dark pattern that is subtracted from the frames; 0 if none is.
    """

    k_dn_per_e: Quantity
    read_noise_dn: Quantity
    prnu_rel: Quantity
    dsnu_dn: Quantity
    row_dsnu_dn: Quantity
    column_dsnu_dn: Quantity
    dsnu_dn_s: Quantity
    dark: DarkModel
    responsivity: Quantity
    dark_current_e_s: Quantity
    efficiency: Quantity
    full_well_e: Quantity
    doubling_temperature_c: Quantity
    temperature_c: float
    transmittance: float
    bits: int
    pixel_pitch_m: float
    gain_db: float
    findings: tuple[Finding, ...]
    library: DarkLibrary | None = None
    flat_field: FlatField | None = None
    pattern_taken_off_dn: float = 0.0

    def dark_dn(self, exposure_s: float) -> float:
        """Mean dark signal at the temperature of the twin."""
        return self.dark.mean_dn(exposure_s, self.temperature_c)

    def dark_standard_uncertainty_dn(self, exposure_s: float) -> float:
        """Return the standard uncertainty of `dark_dn`."""
        return sqrt(self.dark.variance_dn2(exposure_s, self.temperature_c))

    @cached_property
    def quantities(self) -> dict[str, tuple[str, Quantity]]:
        """Label and value of each parameter with uncertainty, by its name in a chain file.

        In electrons and at the session's gain.
        """
        k = self.k_dn_per_e

        def in_electrons(quantity: Quantity, unit: str = "e-") -> Quantity:
            return quantity.over(k, unit, quantity.note)

        offset = self.dark.offset_dn, sqrt(self.dark.offset_variance_dn2)
        return {
            "k_dn_per_e": ("system gain K", k),
            "read_noise_e": ("read noise", in_electrons(self.read_noise_dn)),
            "black_level_dn": ("black level", Quantity(*offset, "DN", "dark frames at zero exposure")),
            "dark_current_e_s": ("dark current", self.dark_current_e_s),
            "doubling_temperature_c": ("doubling temperature", self.doubling_temperature_c),
            "prnu_rel": ("PRNU", self.prnu_rel),
            "dsnu_e": ("DSNU", in_electrons(self.dsnu_dn)),
            "column_dsnu_e": ("DSNU of columns", in_electrons(self.column_dsnu_dn)),
            "row_dsnu_e": ("DSNU of rows", in_electrons(self.row_dsnu_dn)),
            "dsnu_e_s": ("DSNU of the dark current", in_electrons(self.dsnu_dn_s, "e-/s")),
            "full_well_e": ("full well", self.full_well_e),
            "quantum efficiency x transmittance": ("quantum efficiency x transmittance", self.efficiency),
            "responsivity": ("responsivity", self.responsivity),
        }

    def sensor(self, shape: tuple[int, int], exposure_s: float | None = None) -> Sensor:
        """Return the sensor; its K at 0 dB is K at the session's gain.

        Parameters
        ----------
        shape : (int, int)
            Height and width in pixels.
        exposure_s : float or None
            Exposure at which the mean dark signal equals that of the calibration, whatever the dark current; None for
            the dark signal at zero exposure.
        """
        k = self.k_dn_per_e.value
        current_e_s = self.dark_current_e_s.value
        t = 0.0 if exposure_s is None else exposure_s
        lines = (self.row_dsnu_dn, self.column_dsnu_dn, self.read_noise_dn)
        pixel_spreads = (self.pattern_taken_off_dn or self.dsnu_dn.value, self.dsnu_dn_s.value * t)
        spread_dn2 = (
            sum(part**2 for part in (*pixel_spreads, *(line.value for line in lines))) + k * k * current_e_s * t
        )
        black_dn = mean_before_rounding(self.dark_dn(t), spread_dn2) - k * current_e_s * t
        height, width = shape
        same: dict[str, Any] = {name: self.quantities[name][1].value for name in _OF_SENSOR}
        return Sensor(
            **same,
            pixel_pitch_m=self.pixel_pitch_m,
            width=width,
            height=height,
            quantum_efficiency=self.efficiency.value / self.transmittance,
            bits=self.bits,
            black_level_dn=min(max(black_dn, 0.0), 2.0**self.bits - 1),
            reference_temperature_c=self.temperature_c,
            prnu_rel=min(self.prnu_rel.value, MOST_PRNU_REL),
            # A dark current that varies between pixels has a mean above 0.
            dsnu_e_s=self.dsnu_dn_s.value / k if current_e_s > 0 else 0.0,
        )

    def with_noise(self, **changes: Any) -> TwinParameters:
        """Return the twin with other K, noise or patterns; mean dark signal and signal in DN are unchanged."""
        twin = replace(self, **changes)
        by_k = self.k_dn_per_e.value / twin.k_dn_per_e.value
        current, well = (
            replace(quantity, value=quantity.value * by_k) for quantity in (self.dark_current_e_s, self.full_well_e)
        )
        return replace(twin, dark_current_e_s=current, full_well_e=well)

    def takes_pattern_off(self, exposure_s: float) -> bool:
        """Whether the dark pattern is subtracted at an exposure."""
        return self.library is not None and self.library.worth_applying(exposure_s, self.temperature_c)

    def at(self, exposure_s: float) -> TwinParameters:
        """Return the twin with the residual fixed pattern of the corrected frames of an exposure."""
        twin, left = self, {}
        if self.library is not None and self.takes_pattern_off(exposure_s):
            left = dict.fromkeys(("row_dsnu_dn", "column_dsnu_dn", "dsnu_dn_s"), (0.0, ""))
            left["dsnu_dn"] = self.library.noise_dn(exposure_s, self.temperature_c), "noise of the dark library"
            pattern_dn = self.library.nonuniformity_dn(exposure_s, self.temperature_c)
            twin = replace(self, pattern_taken_off_dn=pattern_dn)
        if self.flat_field is not None:
            left["prnu_rel"] = self.flat_field.random_rel, "noise of the flat field"
        exact: dict[str, Any] = {
            name: replace(getattr(self, name), value=value, u=0.0, note=note) for name, (value, note) in left.items()
        }
        return replace(twin, **exact)


def dark_kinds(twin: TwinParameters) -> list[tuple[float, float]]:
    """Equally frequent classes of pixels by dark signal: that of the frames, and that subtracted from them.

    Needed only where a pattern is subtracted and the noise does not dither the converter: the values of a pixel then
    lie on a grid of 1 DN whose offset differs from pixel to pixel. Empty where noise of more than about a DN makes the
    offset irrelevant.

    Parameters
    ----------
    twin : TwinParameters
        The twin at an exposure, by `TwinParameters.at`.
    """
    from scipy.special import ndtri

    if twin.pattern_taken_off_dn == 0 or twin.read_noise_dn.value**2 + twin.dsnu_dn.value**2 >= _COARSE_DN2:
        return []
    # A uniform lattice of two independent normal variables.
    number = np.arange(_DARK_KINDS) + 0.5
    both = ndtri(np.stack([number / _DARK_KINDS, (number * _GOLDEN) % 1]))
    pattern, left = both / both.std(axis=1, keepdims=True) * [[twin.pattern_taken_off_dn], [twin.dsnu_dn.value]]
    return list(zip(pattern.tolist(), (pattern + left).tolist(), strict=True))
