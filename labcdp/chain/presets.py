"""Chains of known cameras."""

from __future__ import annotations

from .imaging import ImagingChain
from .optics import Optics
from .sensor import Sensor

# Shape typical of Sony's interline CCDs with 3.45 um pixels, with the 57 % at 525 nm that EMVA 1288 sheets of
# cameras with them state. An assumption, not a measurement of this camera.
_ICX655_QUANTUM_EFFICIENCY = (
    (380.0, 0.25),
    (400.0, 0.36),
    (430.0, 0.46),
    (460.0, 0.52),
    (500.0, 0.57),
    (530.0, 0.57),
    (560.0, 0.53),
    (600.0, 0.46),
    (640.0, 0.38),
    (680.0, 0.30),
    (720.0, 0.22),
    (780.0, 0.14),
)


def manta_g505() -> ImagingChain:
    """Allied Vision Manta G-505B with a Kowa LM6NCL at f/2.6, in D65, without a windscreen.

    The monochrome sister of the camera of the thesis' experiment, with its lens. Size, pitch and bits are the
    data sheet's, f-number and focal length the thesis'; the rest is typical of such cameras and not a measurement.
    Use `dataclasses.replace` for another spectrum, a smaller sensor or another specimen.
    """
    return ImagingChain(
        spectrum="D65",
        windscreen=None,
        optics=Optics(
            f_number=2.6,  # thesis, section 3.2.2
            transmittance=0.9,  # assumed: a coated multi-element lens
            focal_length_m=6e-3,  # data sheet of the LM6NCL
        ),
        sensor=Sensor(
            pixel_pitch_m=3.45e-6,  # data sheet: Sony ICX655, 2/3 inch
            width=2452,  # data sheet
            height=2056,  # data sheet
            quantum_efficiency=_ICX655_QUANTUM_EFFICIENCY,
            full_well_e=7000.0,  # typical: EMVA 1288 sheets of such CCDs state 5900 to 8000 e-
            k_dn_per_e=0.6,  # assumed: the converter ends just before the full well
            read_noise_e=10.0,  # typical: EMVA 1288 sheets of such CCDs state 8 to 13 e-
            dark_current_e_s=5.0,  # assumed, an interline CCD at 25 degC
            bits=12,  # data sheet
            black_level_dn=64.0,  # assumed: ten times the dark noise, so that it is not clipped
            reference_temperature_c=25.0,
            doubling_temperature_c=8.0,  # typical of silicon near room temperature
            prnu_rel=0.01,  # typical of EMVA 1288 sheets of CCDs
            dsnu_e=2.0,  # typical of EMVA 1288 sheets of CCDs
            dsnu_e_s=2.0,  # assumed
            device_seed=503363706,  # serial number of the thesis' camera
        ),
    )
