"""Conversion from guessed camera parameters: what one has without a calibration."""

from __future__ import annotations

from math import inf

from ...chain.optics import axial_illuminance_per_cd_m2
from ...chain.sensor.conversion import LinearConversion
from ...core.spectral.photometry import photon_radiance_per_cd_m2
from ...core.vignetting import AnyVignetting
from ...session import GuessConfiguration


def guessed_conversion(
    guess: GuessConfiguration, spectrum: str, vignetting: AnyVignetting | None, gain_db: float = 0.0
) -> LinearConversion:
    """Conversion that follows from guessed parameters, without any uncertainty to state.

    The electrons of a pixel are L t QE p^2 tau pi / (4 N^2) times the photons per cd/m^2 of the spectrum
    (the 2018 thesis' equation 3.1 and its sensor, solved for the luminance; the thesis' program multiplies where it
    must divide).

    Parameters
    ----------
    guess : GuessConfiguration
        Quantum efficiency, K, f-number, transmittance, pixel pitch and dark signal.
    spectrum : str
        Light of the target.
    vignetting : AnyVignetting or None
        Vignetting of the lens.
    gain_db : float
        Gain of the frames; K is taken to be for 0 dB.

    Raises
    ------
    InputError
        If the spectrum is not known.
    """
    photons_s_m2 = photon_radiance_per_cd_m2(spectrum) * axial_illuminance_per_cd_m2(
        guess.f_number, guess.transmittance, magnification=0.0
    )
    k_dn_per_e = guess.k_dn_per_e * 10 ** (gain_db / 20)
    return LinearConversion(
        responsivity_dn_s_cd_m2=photons_s_m2 * guess.pixel_pitch_m**2 * guess.quantum_efficiency * k_dn_per_e,
        responsivity_common_rel=inf,
        dark_offset_dn=guess.dark_dn,
        dark_rate_dn_s=0.0,
        k_dn_per_e=k_dn_per_e,
        dark_noise_dn=0.0,
        vignetting=vignetting,
        gain_db=gain_db,
        range_cd_m2=(0.0, inf),
    )
