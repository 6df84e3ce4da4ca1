"""The chain that the tests of sweeps and simulations change."""

from labcdp.chain import Chain

_DOCUMENT = {
    "name": "board <b>&",
    "spectrum": "monochromatic 555 nm",
    "scene": {"type": "checkerboard", "width": 64, "height": 48, "luminance_cd_m2": 100.0, "contrast": 0.3,
              "square_px": 8},
    "windscreen": {"transmittance": 0.9},
    "optics": {"f_number": 2.0, "transmittance": 0.9},
    "exposure": {"exposure_s": 0.01},
    "sensor": {"pixel_pitch_m": 4e-6, "quantum_efficiency": 0.6, "full_well_e": 20000, "k_dn_per_e": 0.2,
               "read_noise_e": 5.0, "dark_current_e_s": 10.0, "bits": 12, "black_level_dn": 32.0},
}  # fmt: skip


def small(behind=None, **changes):
    """Return the chain with other parameters, and with tables behind the sensor."""
    return Chain.from_document(_DOCUMENT | (behind or {}), "small").with_(**changes)
