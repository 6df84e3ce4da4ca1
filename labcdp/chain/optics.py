"""Windscreen and optics: from the luminance of the scene to the illuminance on the sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.photometry import axial_illuminance_per_cd_m2
from ..core.vignetting import Cos4Vignetting
from . import point_spread
from .parameters import Flag, Fraction, Luminance, Number, Parameters, Ratio
from .signal import Context, Signal

FloatArray = NDArray[np.floating[Any]]
Glare: TypeAlias = Annotated[float, Ratio("(a fraction; 1.0 is 100 %)", 0, 4)]


@dataclass(frozen=True)
class Windscreen(Parameters):
    """A windscreen of uniform transmittance whose glare is a fraction of the mean scene luminance, or stated in cd/m².

    Behind it is transmittance * (luminance + glare); the thesis, section on the windscreen. The photons, scene and veil
    together, get their noise where the sensor collects them.

    Parameters
    ----------
    transmittance : float
        Fraction of the light that passes, above 0 up to 1.
    glare_fraction : float
        Veiling luminance, as a luminance in front of the windscreen, over mean scene luminance, at least 0 (1.0 is
        100 %).
    glare_subtracted : bool
        Whether the inverse subtracts the mean glare, as a camera can that knows it. Otherwise the glare stays in the
        measured luminance and lowers the contrast.
    glare_cd_m2 : float
        Further veiling luminance that does not depend on the scene, likewise in front of the windscreen, such as that
        of the sun beside it, in cd/m^2.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import Windscreen
    >>> Windscreen(transmittance=0.8, glare_cd_m2=0.5)
    Windscreen(transmittance=0.8, glare_fraction=0.0, glare_subtracted=False, glare_cd_m2=0.5)
    """

    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "luminance"

    transmittance: Fraction
    glare_fraction: Glare = 0.0
    glare_subtracted: Annotated[bool, Flag()] = False
    glare_cd_m2: Luminance = 0.0

    def process(self, signal: Signal, _context: Context) -> Signal:
        """Luminance behind the windscreen, with its inverse."""
        glare_cd_m2 = self.glare_fraction * signal.scene_mean() + self.glare_cd_m2
        subtracted_cd_m2 = glare_cd_m2 if self.glare_subtracted else 0.0
        return replace(
            signal,
            values=self.transmittance * (signal.values + glare_cd_m2),
            to_luminance=lambda behind: signal.to_luminance(behind / self.transmittance - subtracted_cd_m2),
        )


@dataclass(frozen=True)
class Optics(Parameters):
    """A symmetric lens centred on the sensor: E = L t pi cos^4(theta) / (4 N^2 (1 + m)^2).

    Equation 3.1 of the thesis, but with the square that it lacks (see `axial_illuminance_per_cd_m2`).

    Parameters
    ----------
    f_number : float
        N, 0.5 to 128; a lens in air cannot be below 0.5.
    transmittance : float
        t, fraction of the light the lens passes, above 0 up to 1.
    focal_length_m : float or None
        Focal length in metres; with the pixel pitch it gives theta. None for theta = 0 everywhere, a lens without
        vignetting.
    magnification : float
        m, image size over object size, at least 0; 0 for a distant scene.
    diffraction_nm : float or None
        Wavelength whose diffraction at the working f-number spreads each point, in nm; None for none.
    blur_sigma_m : float
        Standard deviation of a Gaussian point spread on the sensor, in metres.
    defocus_disc_m : float
        Diameter of the disc a point becomes on the sensor out of focus, in metres.
    mtf : tuple of (float, float)
        Measured MTF: line pairs per mm on the sensor and modulation; () for none.

    Raises
    ------
    InputError
        If a value is out of its range.

    Notes
    -----
    The transfer functions of the last four multiply; with none of them a point of the scene stays a point. A pixel is
    as sensitive on its whole square. The inverse takes off no point spread, so the measured contrast has it.

    Examples
    --------
    >>> from labcdp.chain import Optics
    >>> Optics(f_number=2.0, transmittance=0.9, focal_length_m=0.016).mtf
    ()
    """

    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "illuminance"

    f_number: Annotated[float, Number("", 0.5, 128)]
    transmittance: Fraction
    focal_length_m: Annotated[float | None, Number("m", 1e-4, 1)] = None
    magnification: Annotated[float, Number("(image over object)", 0, 100)] = 0.0
    diffraction_nm: Annotated[float | None, Number("nm", 100, 2000)] = None
    blur_sigma_m: Annotated[float, Number("m", 0, 1e-3)] = 0.0
    defocus_disc_m: Annotated[float, Number("m", 0, 1e-3)] = 0.0
    mtf: point_spread.MtfTable = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "mtf", point_spread.checked_mtf(self.mtf))

    @property
    def working_f_number(self) -> float:
        """N (1 + m), that of the cone of light behind the lens."""
        return self.f_number * (1 + self.magnification)

    @property
    def axial_illuminance_per_cd_m2(self) -> float:
        """Illuminance in lux on the axis for 1 cd/m^2."""
        return axial_illuminance_per_cd_m2(self.f_number, self.transmittance, self.magnification)

    def vignetting(self, pixel_pitch_m: float) -> Cos4Vignetting | None:
        """Vignetting cos^4(theta) on a sensor, or None; the image lies f (1 + m) behind a thin lens."""
        if self.focal_length_m is None:
            return None
        return Cos4Vignetting(self.focal_length_m * (1 + self.magnification), pixel_pitch_m)

    @property
    def spreads_points(self) -> bool:
        """Whether it has a point spread."""
        return self.diffraction_nm is not None or bool(self.blur_sigma_m or self.defocus_disc_m or self.mtf)

    def transfer(self, frequency_per_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Optical transfer function over the spatial frequency on the sensor in 1/m, without that of the pixel."""
        transfer = np.ones(np.shape(frequency_per_m))
        if self.diffraction_nm is not None:
            transfer = point_spread.diffraction_mtf(frequency_per_m, 1e-9 * self.diffraction_nm, self.working_f_number)
        transfer = transfer * point_spread.gaussian_mtf(frequency_per_m, self.blur_sigma_m)
        transfer *= point_spread.disc_mtf(frequency_per_m, self.defocus_disc_m)
        return transfer * point_spread.measured_mtf(frequency_per_m, self.mtf) if self.mtf else transfer

    def spread(self, scene: FloatArray, pixel_pitch_m: float | None, oversampling: int = 1) -> FloatArray:
        """Mean on each pixel of the image of a scene, shape (height, width), in the unit of the scene.

        Parameters
        ----------
        scene : ndarray of float, shape (height * oversampling, width * oversampling)
            Luminance, or anything in proportion to it.
        pixel_pitch_m : float or None
            Of the sensor, which a point spread needs.
        oversampling : int
            Samples on each side of a pixel.

        Raises
        ------
        InputError
            If there is a point spread and no pixel pitch.
        """
        if self.spreads_points:
            if pixel_pitch_m is None:
                raise InputError("the point spread needs the pixel pitch: add a sensor, or leave the point spread out")
            scene = point_spread.blurred(scene, _kernel(self, pixel_pitch_m / oversampling))
        return point_spread.pixel_means(scene, oversampling)

    def process(self, signal: Signal, context: Context) -> Signal:
        """Illuminance on the sensor, with its inverse; levels of a scene are taken as on the axis.

        Raises
        ------
        InputError
            If vignetting or point spread need the pixel pitch of a sensor and there is none.
        """
        pitch_m, is_image = context.pixel_pitch_m, signal.shares is None
        if is_image and self.focal_length_m is not None and pitch_m is None:
            raise InputError(
                f"focal_length_m is {self.focal_length_m:g} m, but no sensor tells the pixel pitch: add a "
                "sensor, or leave focal_length_m out",
                key="focal_length_m",
            )

        vignetting = self.vignetting(pitch_m) if is_image and pitch_m else None

        def slope(like: FloatArray) -> FloatArray | float:
            if vignetting is None:
                return self.axial_illuminance_per_cd_m2
            # The map of the vignetting is made anew each time instead of being kept.
            relative = vignetting.relative_illuminance((like.shape[0], like.shape[1]))
            relative *= self.axial_illuminance_per_cd_m2
            return relative.astype(like.dtype, copy=False)

        seen = self.spread(signal.values, pitch_m, signal.oversampling) if is_image else signal.values
        return replace(
            signal,
            values=seen * slope(seen),
            quantity="illuminance",
            oversampling=1,
            to_luminance=lambda illuminance_lx: signal.to_luminance(illuminance_lx / slope(illuminance_lx)),
        )

    def _spread_width_m(self) -> float:
        """Width that holds nearly all of a point's light."""
        airy_m = 20e-9 * (self.diffraction_nm or 0.0) * self.working_f_number
        # A measured MTF that falls quickly first has a wide point spread.
        measured_m = 4e-3 / self.mtf[1][0] if self.mtf else 0.0
        return airy_m + 8 * self.blur_sigma_m + self.defocus_disc_m + measured_m


@lru_cache(maxsize=4)
def _kernel(optics: Optics, sample_m: float) -> NDArray[np.float64]:
    """Kernel of a lens on samples of a size; kept, as a run, a prediction and cells of a sweep have the same."""
    kernel = point_spread.blur_kernel(optics.transfer, sample_m, optics._spread_width_m())
    kernel.setflags(write=False)
    return kernel
