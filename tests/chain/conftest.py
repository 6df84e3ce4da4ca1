import pytest

from labcdp.chain import Sensor


@pytest.fixture
def sensor():
    """A noiseless sensor of one DN per electron; tests add the one effect they look at with `replace`."""
    ideal = {"read_noise_e": 0.0, "dark_current_e_s": 0.0, "k_dn_per_e": 1.0, "quantum_efficiency": 0.5}
    return Sensor(pixel_pitch_m=3e-6, width=300, height=200, full_well_e=50_000, bits=16, **ideal)
