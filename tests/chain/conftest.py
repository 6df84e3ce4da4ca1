import pytest

from labcdp.chain import Optics, Sensor


@pytest.fixture
def sensor() -> Sensor:
    """A noiseless sensor of one DN per electron; tests add the one effect they look at with `replace`."""
    return Sensor(
        pixel_pitch_m=3e-6,
        width=300,
        height=200,
        quantum_efficiency=0.5,
        full_well_e=50_000,
        k_dn_per_e=1.0,
        read_noise_e=0.0,
        dark_current_e_s=0.0,
        bits=16,
    )


@pytest.fixture
def optics() -> Optics:
    return Optics(f_number=2.0, transmittance=0.9, focal_length_m=6e-3)
